"""`companion install`: installs the service on this computer or in an image."""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..common_options import add_config
from ..config.check_config import lacks_for_run
from ..config.loader import Config, ConfigError, load_config
from ..config.named_files import is_missing, named_files
from ..config.startup import run_problems
from ..console import print_json, print_line, warn
from ..kernels.jit_cache import SHARED
from ..packaged import packaged_file
from ..paths import NAME
from ..usage_error import UsageError
from .interpreter import HIDDEN, check_reachable
from .steps import (
    UNIT,
    InstallError,
    InstallPaths,
    Step,
    command_step,
    file_step,
    install_paths,
    interpreter_paths,
    start_command,
)

STATE = Path("/var/lib", NAME)
"""The working directory of the service, where it looks for files with a relative path."""


def add_parser(subparsers: Any) -> None:
    """The command line of `companion install`."""
    parser = subparsers.add_parser("install")
    add_config(parser, "configuration to copy to /etc/osape-companion/config.toml (default: the one that is there)")
    parser.add_argument("--replace-config", action="store_true", help="replace the configuration that is there")
    parser.add_argument("--no-start", action="store_true", help="do not start the service now, but at the next boot")
    parser.add_argument(
        "--root",
        type=Path,
        default=Path("/"),
        metavar="DIR",
        help="install into the root directory of an image (default: /)",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print the steps and what is missing for them, and change nothing"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: installed, or the steps printed; 1: printed, and something is missing. Raises InstallError, ConfigError and OSError."""
    if args.replace_config and args.config is None:
        raise UsageError("--replace-config needs -c FILE, the configuration to install")
    paths = install_paths(args.root)
    if paths.package_unit.exists():
        raise InstallError(
            f"{paths.package_unit} belongs to the package {NAME}, and a second unit would override it. Start that one: "
            f"{start_command(paths, args.config or paths.config)}; or remove the package first: sudo apt remove {NAME}"
        )
    steps = reachable_steps(args.dry_run, args.config)
    steps += install_steps(paths, args.config, args.replace_config, not args.no_start, dry_run=args.dry_run)
    carry_out(steps, paths, args.dry_run, args.json)
    if any(step.missing for step in steps):
        return 1
    if not args.json and not args.dry_run and paths.live:
        print_line(f"the service starts at boot; check it with `companion status` and `journalctl -u {NAME}`")
    return 0


def reachable_steps(dry_run: bool, config: Path | None) -> list[Step]:
    """No step; in a dry run one that names what the service's user could not read. Raises InstallError otherwise."""
    try:
        check_reachable(interpreter_paths(), config)
    except InstallError as error:
        if not dry_run:
            raise
        return [_missing(str(error))]
    return []


def _missing(cause: str) -> Step:
    """A step of a dry run that the user has to do first."""
    return Step(cause, False, lambda: None, missing=True)


def install_steps(
    paths: InstallPaths, config: Path | None, replace_config: bool, start: bool, *, dry_run: bool = False
) -> list[Step]:
    """All steps, in order. Raises InstallError where something is missing, ConfigError for an invalid configuration; in a
    dry run the configuration's error is a step."""
    command = str(Path(sysconfig.get_path("scripts")) / "companion")
    if not re.fullmatch(r"[A-Za-z0-9/._+-]+", command):
        raise InstallError(
            f"{command}: the path of a unit's command may contain letters, digits and /._+- only; install in another "
            "directory"
        )
    docs = str(packaged_file("docs/reference", "service.md"))
    unit = packaged_file("systemd", UNIT).read_text().replace("@COMPANION@", command).replace("@DOCS@", docs)
    steps = [
        file_step(
            paths.sysusers, packaged_file("systemd", f"{NAME}.sysusers").read_text(), "user and groups of the service"
        ),
        user_step(paths),
        _config_step(paths, config, replace_config, dry_run),
        file_step(paths.rules, packaged_file("systemd", f"60-{NAME}.rules").read_text(), "device permissions"),
        file_step(paths.unit, unit, "the service"),
    ]
    if not paths.live:
        _warn_without_command(paths, command)
        enable = ["systemctl", f"--root={paths.root}", "enable", UNIT]
        return [*steps, command_step(enable, "start at boot", paths.enabled.is_symlink())]
    changed = not all(s.done for s in steps)
    trigger = ["udevadm", "trigger", "--action=add"]
    match = [f"--subsystem-match={name}" for name in ("usb", "hidraw", "tty", "usb-serial")]
    steps += [
        command_step(["udevadm", "control", "--reload"], "load the new rules", not changed),
        command_step([*trigger, *match], "apply them to connected devices", not changed),
        command_step(["systemctl", "daemon-reload"], "load the new unit", not changed),
        Step(f"compile the kernels into {SHARED} (two minutes, more on a Raspberry Pi)", False, _compile_kernels),
        command_step(["systemctl", "enable", UNIT], "start at boot", paths.enabled.is_symlink()),
    ]
    return [*steps, command_step(["systemctl", "restart", UNIT], "now")] if start else steps


def _warn_without_command(paths: InstallPaths, command: str) -> None:
    """Warns where an image lacks the command that its unit starts."""
    if not os.path.lexists(paths.root / command.lstrip("/")):
        warn(
            f"{paths.root} has no {command}, which the unit starts: install the software in the image at the same path, or the "
            "service does not start"
        )


def user_step(paths: InstallPaths) -> Step:
    """Creates the service's user."""
    where = [] if paths.live else [f"--root={paths.root}"]
    command = ["systemd-sysusers", *where, str(paths.sysusers)]
    return command_step(command, f"the user {NAME}", paths.has_user())


def _config_step(paths: InstallPaths, config: Path | None, replace: bool, dry_run: bool) -> Step:
    try:
        return config_step(paths, config, replace)
    except (InstallError, ConfigError) as error:
        if not dry_run:
            raise
        return _missing(str(error))


def config_step(paths: InstallPaths, config: Path | None, replace: bool) -> Step:
    """Copies the configuration; an existing one is kept unless it is to be replaced."""
    target = paths.config
    if config is None:
        if not target.exists():
            raise InstallError(
                f"{target} does not exist: give a configuration with -c: `companion setup` writes one for your devices"
            )
        _usable(target, paths)
        return Step(f"keep {target}", True, lambda: None)
    content = _usable(config, paths)
    if lacks := lacks_for_run(content):
        warn(f"{config} lacks {' and '.join(lacks)}: the service waits for it")
    folder = Path(os.path.normpath(STATE / content.record.folder))
    if not folder.is_relative_to(STATE):
        warn(
            f'[record] folder = "{folder}": the service may write there only after `systemctl edit {NAME}` with the '
            f'lines [Service] and ReadWritePaths="-{folder}", and if the user {NAME} owns it. Without the minus the service '
            "does not start while that directory is missing"
        )
    step = file_step(target, config.read_text(encoding="utf-8"), f"the configuration, from {config}")
    if target.exists() and not step.done and not replace:
        raise InstallError(
            f"{target} exists and differs from {config}; add --replace-config, or leave -c away to keep it"
        )
    return step


def _usable(path: Path, paths: InstallPaths) -> Config:
    """The configuration in a file. Raises ConfigError for one that the service would refuse, InstallError as `check_files`."""
    config = load_config(path)
    if problems := run_problems(config):
        raise ConfigError(str(path), problems)
    check_files(config, paths)
    return config


def check_files(config: Config, paths: InstallPaths) -> None:
    """Raises InstallError for a file of the configuration that the service could not read. In an image it may come later."""
    named = {f'[[camera]] "{camera.name}": calibration': camera.calibration for camera in config.cameras}
    for key, name in (named | named_files(config)).items():
        place = Path(os.path.normpath(STATE / name))
        at_end = place.resolve() if paths.live else place  # of links; those of an image lead elsewhere
        hidden = next((h for h in HIDDEN if place.is_relative_to(h) or at_end.is_relative_to(h)), None)
        if hidden is not None:
            cause = f"the service cannot read files below {hidden}"
        elif name and paths.live and is_missing(place):
            cause = f"{place} does not exist"
        else:
            continue
        raise InstallError(f'{key} = "{name}": {cause}; copy it to /etc/{NAME}, and enter the whole path')


def check_permissions(paths: InstallPaths) -> None:
    """Raises InstallError without root, or where systemd does not run."""
    if paths.live and os.geteuid() != 0:
        raise InstallError("this changes the system and needs root: run it with sudo (--dry-run only prints the steps)")
    if paths.live and not Path("/run/systemd/system").is_dir():
        raise InstallError("systemd does not run here; use `companion run` without it, or prepare an image with --root")


def carry_out(steps: Sequence[Step], paths: InstallPaths, dry_run: bool, as_json: bool) -> None:
    """Prints the steps, then runs them. Raises InstallError and OSError; finished steps are not undone."""
    if as_json:
        listed = [{"step": s.text, "already": s.done, "missing": s.missing} for s in steps]
    else:
        for step in steps:
            print_line(f"{_prefix(step, dry_run)}: {step.text}")
    if not dry_run:
        check_permissions(paths)
        for step in steps:
            if not step.done:
                step.act()
                if not as_json:
                    print_line(f"done: {step.text}")
    if as_json:
        print_json({"dry_run": dry_run, "steps": listed})


def _prefix(step: Step, dry_run: bool) -> str:
    if step.missing:
        return "missing"
    return "already" if step.done else "would" if dry_run else "will"


def _compile_kernels() -> None:
    """Compiles the kernels into this environment; every user of it, so the service's too, begins with them."""
    command = [str(Path(sysconfig.get_path("scripts")) / "companion"), "warmup"]
    environment = {"PATH": os.environ.get("PATH", "/usr/bin:/bin"), "NUMBA_CACHE_DIR": str(SHARED)}
    # its progress is on stderr, which is that of this command
    done = subprocess.run(command, env=environment, cwd="/", umask=0o022, stdout=subprocess.DEVNULL, check=False)
    if done.returncode != 0:
        raise InstallError("companion warmup failed; its error is above")
