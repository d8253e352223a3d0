"""`companion doctor`: checks every part before a flight and names the remedy of each fault.

When the service runs, its health report is read, since it holds the cameras and the link. Otherwise each part is tried as
the service would use it: every camera in a process of its own, the autopilot over its link. Nothing is changed, except the
autopilot's parameters with `--apply` after a confirmation (`companion.doctor.apply`)."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from itertools import chain
from typing import Any

from drivers.base import DriverError

from ..argument_types import number_in
from ..common_options import add_config
from ..config.devices import device_problems
from ..config.differences import expert_lines, safety_lines
from ..config.installed import INSTALLED, config_path
from ..config.loader import Config, load_config
from ..config.startup import stream_problems
from ..console import print_json, print_line
from ..diagnostic import DiagnosticCode
from ..live.diagnostics import template_intrinsics
from ..usage_error import UsageError
from .apply import apply, confirmed
from .autopilot_check import autopilot_findings
from .camera_check import camera_findings
from .computer_check import computer_findings
from .finding import Finding
from .intrinsics_check import intrinsics_findings
from .measure_mount import measured_mounts
from .service_check import running_service
from .share_check import share_findings
from .zed_serial_check import zed_serial_findings

PATIENCE_S = 25.0
"""Time limit for each camera and for the autopilot, without --patience."""
MOUNT_SECONDS = 60.0
"""Longest measurement of the mount, without --seconds."""


def examine(config: Config, patience_s: float) -> Iterator[Finding]:
    """All checks, one after the other. patience_s: time limit for each camera and for the autopilot."""
    yield from config_findings(config)
    running = running_service(config, patience_s)
    if running is not None:
        yield from running
    else:
        yield Finding("service", True, "not running; its parts are checked by this command")
        if not config.cameras:
            text = "none is configured: add a [[camera]] to the configuration"
            yield Finding("cameras", False, text, DiagnosticCode.NO_CAMERA_CONFIGURED)
        yield from intrinsics_findings(config.cameras)
        yield from zed_serial_findings(config.cameras)
        yield from camera_findings(config, patience_s)
        yield from autopilot_findings(config, patience_s)
    yield from share_findings(config)
    yield from computer_findings(config)


def config_findings(config: Config) -> Iterator[Finding]:
    """Template intrinsics, devices and streams that `run` refuses, and changed safety and expert keys. A changed key is not a fault:
    some keys must fit the camera and the vehicle."""
    for found in template_intrinsics(config.cameras):
        yield Finding(f"camera {found.camera}", False, found.line(), found.code)
    for text in device_problems(config.cameras):
        yield Finding("cameras", False, text, DiagnosticCode.CAMERA_UNAVAILABLE)
    for text in stream_problems(config):
        yield Finding("streams", False, text)
    for name, lines in (("safety keys", safety_lines(config)), ("expert keys", expert_lines(config))):
        yield Finding(name, True, "all have their defaults" if not lines else f"changed: {'; '.join(lines)}")


def _measure_mounts(config: Config, args: argparse.Namespace) -> int:
    """0: every camera is mounted as configured; 1: a mount differs or could not be measured."""
    if running_service(config, args.patience) is not None:
        raise DriverError("the service holds the cameras and the link; stop it first (systemctl stop osape-companion)")
    found = []
    for finding in measured_mounts(
        config, args.seconds or MOUNT_SECONDS, (lambda text: None) if args.json else print_line
    ):
        found.append(finding)
        if not args.json:
            print_line(f"{'ok ' if finding.ok else ' ! '} camera {finding.camera}: {finding.text}")
            for line in finding.lines:
                print_line(f"    {line}")
    ok = bool(found) and all(f.ok for f in found)
    if args.json:
        print_json({"ok": ok, "mounts": [asdict(f) for f in found]})
    return 0 if ok else 1


def add_parser(subparsers: Any) -> None:
    """The command line of `companion doctor`."""
    parser = subparsers.add_parser("doctor")
    add_config(parser, f"configuration of the service (default: {INSTALLED})")
    parser.add_argument(
        "--patience",
        type=number_in(float, 0.1, 3600.0),
        default=PATIENCE_S,
        metavar="S",
        help=f"time limit for each camera and for the autopilot (default: {PATIENCE_S:g} s)",
    )
    parser.add_argument(
        "--apply",
        action="store_true",
        help="correct the parameters of the autopilot that prevent it from braking, after a list and a typed yes; needs a stopped service and a disarmed vehicle",
    )
    parser.add_argument(
        "--mount",
        action="store_true",
        help="measure roll and pitch of each camera while you turn the vehicle by hand; needs a stopped service",
    )
    parser.add_argument(
        "--seconds",
        type=number_in(float, 1.0, 3600.0),
        metavar="S",
        help=f"with --mount: longest measurement (default: {MOUNT_SECONDS:g} s)",
    )
    parser.add_argument("--yes", action="store_true", help="with --apply: write without asking")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: no fault; 1: a fault. Raises UsageError for options that exclude each other."""
    if args.yes and not args.apply:
        raise UsageError("--yes needs --apply")
    if args.json and args.apply and not args.yes:
        raise UsageError("--apply asks for a typed yes; with --json add --yes")
    if args.seconds is not None and not args.mount:
        raise UsageError("--seconds needs --mount")
    if args.mount and args.apply:
        raise UsageError("--mount and --apply exclude each other; use one after the other")
    config = load_config(config_path(args.config))
    if args.mount:
        return _measure_mounts(config, args)
    writing = apply(config, args.patience, (lambda wanted: True) if args.yes else confirmed) if args.apply else ()
    found = chain(writing, examine(config, args.patience))
    if args.json:
        findings = list(found)
        ok = all(f.ok for f in findings)
        print_json({"ok": ok, "findings": [asdict(f) for f in findings]})
    else:
        ok = print_findings(found)
    return 0 if ok else 1


def print_findings(findings: Iterable[Finding]) -> bool:
    """Prints each finding as it is made; returns whether there is no fault."""
    ok = True
    for finding in findings:
        print_line(finding.line())
        ok &= finding.ok
    if ok:
        print_line("no fault found")
    return ok
