"""`companion check-config FILE`: is this configuration usable, and what does it change?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .config import Config, ConfigError, fields_of, load_config
from .console import fail, say, say_json


def add_parser(subparsers: Any) -> None:
    """The command line of `companion check-config`."""
    parser = subparsers.add_parser("check-config", help="check a configuration file")
    parser.add_argument("file", type=Path, metavar="FILE", help="a configuration (TOML)")
    parser.add_argument("--json", action="store_true", help="one machine-readable object on stdout")


def run(args: argparse.Namespace) -> int:
    """0: usable; 1: not, every mistake is on stderr (and in the object with --json)."""
    try:
        config = load_config(args.file)
    except ConfigError as error:
        if args.json:
            say_json({"file": str(args.file), "ok": False, "problems": list(error.problems)})
        fail(str(error))
        return 1
    differences = changes(config)
    if args.json:
        say_json({"file": str(args.file), "ok": True, "problems": [], "changes": differences})
        return 0
    say(f"{args.file}: usable")
    cameras = ", ".join(f"{c.name} ({c.kind})" for c in config.cameras) or "none (every camera as recorded)"
    say(f"  cameras: {cameras}")
    for section, keys in differences.items():
        for key, (value, default) in keys.items():
            say(f"  [{section}] {key} = {value} (default {default})")
    if not differences:
        say("  all parameters have their defaults")
    return 0


def changes(config: Config) -> dict[str, dict[str, tuple[Any, Any]]]:
    """section -> key -> (value, default) of the parameters that differ from their defaults."""
    out: dict[str, dict[str, tuple[Any, Any]]] = {}
    for section, values in (("extractor", config.extractor), ("sync", config.sync), ("output", config.output)):
        keys = {f.name: (getattr(values, f.name), f.default) for f in fields_of(section)}
        differing = {k: v for k, v in keys.items() if v[0] != v[1]}
        if differing:
            out[section] = differing
    return out
