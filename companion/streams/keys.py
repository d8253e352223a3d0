"""`companion keys`: creates keys for network streams and for MAVLink 2 signatures."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path
from typing import Any, Final

from drivers.mavlink.signing_key import make_key

from ..argument_types import checked_by
from ..console import print_json, print_line
from ..usage_error import UsageError
from .curve_auth import check_client, make_keys

CLIENT: Final = "planner"


def add_parser(subparsers: Any) -> None:
    """The command line of `companion keys`."""
    parser = subparsers.add_parser("keys")
    parser.add_argument(
        "folder",
        type=Path,
        nargs="?",
        metavar="FOLDER",
        help="directory for the keys of network streams, such as /etc/osape-companion/keys",
    )
    parser.add_argument(
        "--client",
        type=checked_by(check_client),
        metavar="NAME",
        help=f"name of the client that gets a key (default: {CLIENT})",
    )
    parser.add_argument(
        "--signing", type=Path, metavar="FILE", help="write a key for MAVLink 2 signatures to FILE instead"
    )
    parser.add_argument(
        "--passphrase",
        action="store_true",
        help="with --signing: derive the key from a passphrase, as ground stations do",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Creates the server's keys, if missing, and those of a client. Raises UsageError, ValueError and OSError."""
    _check_usage(args)
    if args.signing is not None:
        return _signing(args)
    written = make_keys(args.folder, args.client or CLIENT)
    if args.json:
        print_json({"written": [str(f) for f in written]})
        return 0
    for file in written:
        print_line(f"{file} (mode {file.stat().st_mode & 0o777:o})")
    print_line(
        f"give {written[-1].name} and server.public to the client over a private channel, then delete {written[-1]} "
        "here"
    )
    print_line(f'in the configuration: [publish] keys = "{args.folder.absolute()}"')
    return 0


def _check_usage(args: argparse.Namespace) -> None:
    """Raises UsageError for options that exclude or need each other."""
    if args.signing is None and args.folder is None:
        raise UsageError("give the FOLDER of the keys, or --signing FILE")
    if args.signing is None and args.passphrase:
        raise UsageError("--passphrase needs --signing FILE")
    if args.signing is not None and args.client is not None:
        raise UsageError("--client needs FOLDER: a key for signatures belongs to no client; leave out --signing")
    if args.signing is not None and args.folder is not None:
        raise UsageError("FOLDER and --signing exclude each other; use one after the other")


def _signing(args: argparse.Namespace) -> int:
    phrase = ""
    if args.passphrase:
        phrase = getpass.getpass("passphrase: ") if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")
        if not phrase:
            raise ValueError("no passphrase was given; type one, or leave --passphrase out for a random key")
    make_key(args.signing, phrase)
    if args.json:
        print_json({"written": [str(args.signing)]})
        return 0
    print_line(f"{args.signing} (mode 600); it must belong to the user that runs the service")
    print_line(f'in the configuration: [autopilot] signing_key = "{args.signing.absolute()}"')
    print_line("the autopilot needs the same key: see docs/how-to/sign-the-mavlink-line.md")
    return 0
