"""`companion keys`: creates keys for network streams and for MAVLink 2 signatures."""

from __future__ import annotations

import argparse
import getpass
import sys
from pathlib import Path
from typing import Any

from drivers.mavlink.signing_key import make_key

from ..console import print_json, print_line
from .curve_auth import make_keys


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
        "--client", default="planner", metavar="NAME", help="name of the client that gets a key (default: planner)"
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
    """Creates the server's keys, if missing, and those of a client. Raises ValueError and OSError."""
    if args.signing is not None:
        return _signing(args)
    if args.folder is None:
        raise ValueError("give the FOLDER of the keys, or --signing FILE")
    written = make_keys(args.folder, args.client)
    if args.json:
        print_json({"written": [str(f) for f in written]})
        return 0
    for file in written:
        print_line(f"{file} (mode {file.stat().st_mode & 0o777:o})")
    print_line(
        f"give {written[-1].name} and server.public to the client over a private channel, then delete {written[-1]} "
        "here"
    )
    print_line(f'in the configuration: [publish] keys = "{args.folder}"')
    return 0


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
    print_line("the autopilot needs the same key: see docs/reference/obstacle-output.md")
    return 0
