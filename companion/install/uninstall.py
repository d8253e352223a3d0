"""`companion uninstall`: takes away what `companion install` made; configuration, keys and logs only when asked to."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import print_line
from ..paths import NAME
from .install import carry_out
from .steps import UNIT, InstallPaths, Step, command_step, folder_size_mb, install_paths, remove_step


def add_parser(subparsers: Any) -> None:
    """The command line of `companion uninstall`."""
    parser = subparsers.add_parser("uninstall", help="take the service off this machine (needs root)")
    parser.add_argument("--purge", action="store_true", help="configuration, keys, logs and the user too")
    parser.add_argument("--root", type=Path, default=Path("/"), metavar="DIR", help="an image's root instead")
    parser.add_argument("--dry-run", action="store_true", help="say what would be done, and do nothing")
    parser.add_argument("--json", action="store_true", help="one machine-readable object on stdout")


def run(args: argparse.Namespace) -> int:
    """0: taken away, or told what would be. Raises InstallError and OSError."""
    paths = install_paths(args.root)
    carry_out(uninstall_steps(paths, args.purge), paths, args.dry_run, args.json)
    if not args.json and not args.purge:
        for kept in (paths.settings, paths.drop_ins, paths.state):
            if kept.exists():
                print_line(f"kept: {kept} ({folder_size_mb(kept):.1f} MB); --purge deletes it")
        if paths.has_user():
            print_line(f"kept: the user {NAME}, who owns the logs; --purge deletes it")
    return 0


def uninstall_steps(paths: InstallPaths, purge: bool) -> list[Step]:
    """All steps, in order."""
    uninstalled = not paths.unit.exists()
    where = [] if paths.live else [f"--root={paths.root}"]
    stop = ["systemctl", *where, "disable", *(["--now"] if paths.live else []), UNIT]
    steps = [
        command_step(stop, "stop it, and no start with the machine", uninstalled),
        remove_step(paths.unit, "the service"),
        remove_step(paths.rules, "who may use the cameras"),
        remove_step(paths.cache, "compiled kernels"),
    ]
    if purge:
        steps += [
            remove_step(paths.drop_ins, "your changes to the unit"),
            remove_step(paths.settings, "the configuration and the keys"),
            remove_step(paths.state, f"the logs, {folder_size_mb(paths.state):.1f} MB"),
            command_step(["userdel", *_image(paths), NAME], "the service's user", not paths.has_user()),
        ]
    steps.append(remove_step(paths.sysusers, "the service's user and groups"))
    if paths.live:
        steps += [
            command_step(["systemctl", "daemon-reload"], "the unit is gone", uninstalled),
            command_step(["udevadm", "control", "--reload"], "the rules are gone", uninstalled),
        ]
    return steps


def _image(paths: InstallPaths) -> list[str]:
    return [] if paths.live else ["--prefix", str(paths.root)]
