"""`companion uninstall`: removes what `companion install` has installed; configuration, keys and logs only with
--purge."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import print_line
from ..kernels.jit_cache import SHARED
from ..paths import NAME
from .install import carry_out
from .steps import (
    UNIT,
    InstallError,
    InstallPaths,
    Step,
    command_step,
    folder_size_mb,
    install_paths,
    remove_step,
)


def add_parser(subparsers: Any) -> None:
    """The command line of `companion uninstall`."""
    parser = subparsers.add_parser("uninstall")
    parser.add_argument("--purge", action="store_true", help="also delete configuration, keys, logs and the user")
    parser.add_argument(
        "--root",
        type=Path,
        default=Path("/"),
        metavar="DIR",
        help="remove from the root directory of an image (default: /)",
    )
    parser.add_argument("--dry-run", action="store_true", help="print the steps and change nothing")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: removed, or the steps printed. Raises InstallError and OSError."""
    paths = install_paths(args.root)
    if paths.package_unit.exists() and not paths.unit.exists():
        raise InstallError(
            f"{paths.package_unit} belongs to the package {NAME}: sudo apt remove {NAME}, or sudo apt purge {NAME} to "
            "delete configuration, logs and user too"
        )
    carry_out(uninstall_steps(paths, args.purge), paths, args.dry_run, args.json)
    if not args.json and not args.purge:
        for kept in (paths.settings, paths.drop_ins, paths.state):
            if kept.exists():
                print_line(f"kept: {kept} ({folder_size_mb(kept):.1f} MB); --purge deletes it")
        if paths.has_user():
            print_line(f"kept: the user {NAME}, which owns the logs; --purge deletes it")
    return 0


def uninstall_steps(paths: InstallPaths, purge: bool) -> list[Step]:
    """All steps, in order."""
    uninstalled = not paths.unit.exists()
    where = [] if paths.live else [f"--root={paths.root}"]
    stop = ["systemctl", *where, "disable", *(["--now"] if paths.live else []), UNIT]
    steps = [
        command_step(stop, "stop it and do not start it at boot", uninstalled),
        remove_step(paths.unit, "the service"),
        remove_step(paths.rules, "device permissions"),
        remove_step(paths.cache, "compiled kernels and other files that can be made again"),
    ]
    if paths.live:
        steps.append(remove_step(SHARED, "compiled kernels of this environment"))
    if purge:
        steps += [
            remove_step(paths.drop_ins, "local changes of the unit"),
            remove_step(paths.settings, "configuration and keys"),
            remove_step(paths.state, f"logs, {folder_size_mb(paths.state):.1f} MB"),
            command_step(["userdel", *_image(paths), NAME], "user of the service", not paths.has_user()),
        ]
    steps.append(remove_step(paths.sysusers, "user and groups of the service"))
    if paths.live:
        steps += [
            command_step(["systemctl", "daemon-reload"], "unload the unit", uninstalled),
            command_step(["udevadm", "control", "--reload"], "unload the rules", uninstalled),
        ]
    return steps


def _image(paths: InstallPaths) -> list[str]:
    return [] if paths.live else ["--prefix", str(paths.root)]
