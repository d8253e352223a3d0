"""`companion uninstall`: takes away what `companion install` made; configuration, keys and logs only when asked to."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import say
from ..paths import NAME
from .install import carry_out
from .steps import UNIT, Places, Step, command_step, folder_size_mb, places_of, remove_step


def add_parser(subparsers: Any) -> None:
    """The command line of `companion uninstall`."""
    parser = subparsers.add_parser("uninstall", help="take the service off this machine (needs root)")
    parser.add_argument("--purge", action="store_true", help="configuration, keys, logs and the user too")
    parser.add_argument("--root", type=Path, default=Path("/"), metavar="DIR", help="an image's root instead")
    parser.add_argument("--dry-run", action="store_true", help="say what would be done, and do nothing")
    parser.add_argument("--json", action="store_true", help="one machine-readable object on stdout")


def run(args: argparse.Namespace) -> int:
    """0: taken away, or told what would be. Raises InstallError and OSError."""
    places = places_of(args.root)
    carry_out(uninstall_steps(places, args.purge), places, args.dry_run, args.json)
    if not args.json and not args.purge:
        for kept in (places.settings, places.drop_ins, places.state):
            if kept.exists():
                say(f"kept: {kept} ({folder_size_mb(kept):.1f} MB); --purge deletes it")
        if places.has_user():
            say(f"kept: the user {NAME}, who owns the logs; --purge deletes it")
    return 0


def uninstall_steps(places: Places, purge: bool) -> list[Step]:
    """All steps, in order."""
    gone = not places.unit.exists()
    where = [] if places.live else [f"--root={places.root}"]
    stop = ["systemctl", *where, "disable", *(["--now"] if places.live else []), UNIT]
    steps = [
        command_step(stop, "stop it, and no start with the machine", gone),
        remove_step(places.unit, "the service"),
        remove_step(places.rules, "who may use the cameras"),
        remove_step(places.cache, "compiled kernels"),
    ]
    if purge:
        steps += [
            remove_step(places.drop_ins, "your changes to the unit"),
            remove_step(places.settings, "the configuration and the keys"),
            remove_step(places.state, f"the logs, {folder_size_mb(places.state):.1f} MB"),
            command_step(["userdel", *_image(places), NAME], "the service's user", not places.has_user()),
        ]
    steps.append(remove_step(places.sysusers, "the service's user and groups"))
    if places.live:
        steps += [
            command_step(["systemctl", "daemon-reload"], "the unit is gone", gone),
            command_step(["udevadm", "control", "--reload"], "the rules are gone", gone),
        ]
    return steps


def _image(places: Places) -> list[str]:
    return [] if places.live else ["--prefix", str(places.root)]
