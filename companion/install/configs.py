"""`companion configs`: lists the shipped configurations and copies one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from drivers.shell_word import shell_word

from ..common_options import add_replace
from ..console import print_json, print_line
from ..packaged import shipped_configs
from ..usage_error import UsageError
from ..whole_file import refuse_existing, write_whole
from .steps import configuration_mode


def add_parser(subparsers: Any) -> None:
    """The command line of `companion configs`."""
    parser = subparsers.add_parser("configs")
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="configuration to copy, such as oak; without it they are listed"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="the copy (default: NAME.toml in this directory)"
    )
    add_replace(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: listed or copied. Raises UsageError for an unknown name, ValueError for an existing file."""
    shipped = shipped_configs()
    if args.name is None:
        if args.output is not None:
            raise UsageError("-o needs the NAME of the configuration to copy; `companion configs` lists them")
        if args.json:
            print_json({"configs": {name: str(path) for name, path in shipped.items()}})
            return 0
        for name, path in shipped.items():
            print_line(f"{name:12s} {_purpose(path)}")
        print_line(
            "`companion configs NAME` copies one into this directory; `companion setup` writes one for your devices"
        )
        return 0
    source = shipped.get(args.name.removesuffix(".toml"))
    if source is None:
        raise UsageError(f"no configuration {args.name!r}; there are {', '.join(shipped)}")
    target = args.output or Path(f"{source.stem}.toml")
    refuse_existing(target, replace=args.replace)
    write_whole(target, source.read_text(encoding="utf-8"), configuration_mode(target))
    if args.json:
        print_json({"written": str(target)})
    else:
        print_line(f"written: {target}; adapt it, then run: companion check-config {shell_word(target)}")
    return 0


def _purpose(path: Path) -> str:
    """The first sentence of the file's first comment."""
    text = " ".join(
        line.lstrip("# ")
        for line in path.read_text(encoding="utf-8").partition("\n\n")[0].splitlines()
        if line.startswith("#")
    )
    return text.partition(". ")[0].rstrip(".:")
