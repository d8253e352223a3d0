"""`companion keys`: keys for streams that leave this machine."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .console import say, say_json
from .curve import make_keys


def add_parser(subparsers: Any) -> None:
    """The command line of `companion keys`."""
    parser = subparsers.add_parser("keys", help="make keys for streams that leave this machine")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of the keys, such as /etc/osape-companion/keys")
    parser.add_argument("--client", default="planner", metavar="NAME", help="who is to listen (planner)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Makes the server's keys, where there are none, and those of a client. Raises ValueError and OSError."""
    written = make_keys(args.folder, args.client)
    if args.json:
        say_json({"written": [str(f) for f in written]})
        return 0
    for file in written:
        say(f"{file} (mode {file.stat().st_mode & 0o777:o})")
    say(
        f"give {written[-1].name} and server.public to the client, over a way that nobody else reads; delete {written[-1]} here"
    )
    say(f'in the configuration: [publish] keys = "{args.folder}"')
    return 0
