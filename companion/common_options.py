"""Options that several commands have, with one meaning in all of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def add_config(parser: Any, help: str, *, required: bool = False) -> None:
    """Adds `-c FILE`. parser: an `argparse` parser or group; help: what the configuration is used for."""
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", required=required, help=help)


def add_replace(parser: Any) -> None:
    """Adds `--replace` of a command that writes files which the user names; see `refuse_existing`."""
    parser.add_argument("--replace", action="store_true", help="replace existing files")


def add_service(parser: Any) -> None:
    """Adds `-c FILE` of a command that subscribes to a running service."""
    add_config(parser, "configuration of the service; needed only if its [publish] addresses are changed")


def add_keys(parser: Any) -> None:
    """Adds `--keys DIR` of a command that subscribes to a service on another computer."""
    help = "directory of the client's keys, for a service on another computer"
    parser.add_argument("--keys", type=Path, metavar="DIR", help=help)
