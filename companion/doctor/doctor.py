"""`companion doctor`: before the flight, part by part, what works and what does not, and what to do about it.

Where the service runs it is asked; cameras and line belong to it then. Else each part is tried here as the service would
use it: every camera in a process of its own, the autopilot over its own line. Nothing is changed anywhere, but the
autopilot's parameters with `--apply`, a list and a yes (`companion.autopilot.parameter_writer`)."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from core.types import DepthFrame
from drivers.base import DriverError
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import LinkStatus, MavlinkSession
from drivers.mavlink.transport import parse_address
from osape_client.proto import osape_v1_pb2 as pb

from ..autopilot.conflict_codes import conflict_diagnostics
from ..autopilot.firmware_version import VersionReader
from ..autopilot.parameter_advice import AutopilotFacts, advice
from ..autopilot.parameter_writer import Change, apply
from ..autopilot.parameters import ParameterReader
from ..autopilot.session_factory import params_of, signing_of
from ..cameras.supervisor import CameraSupervisor
from ..config.camera import CameraConfig
from ..config.differences import safety_lines
from ..config.loader import Config, load_config
from ..console import print_json, print_line
from ..diagnostic import DiagnosticCode
from ..kernels.warmup import COMPILED_S, discard_damaged, run_kernels
from ..live.diagnostics import MIN_ATTITUDE_HZ, attitude_rate_low, template_intrinsics
from ..live.status import address_in_use, newest_health
from ..log.log_directory import free_bytes
from ..paths import folders
from .measure_mount import measured_mounts

NS = 1_000_000_000
FAR_MM = 65_534
MIN_MEASURED_SHARE = 0.05
"""Of the pixels: with fewer, a frame is blind."""
ATTITUDE_SHARE = 0.8
"""Of the wanted rate of the attitude: with less, something on the line holds it up."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at. good: as it should be; words: what was found, and what to do where it is not;
    code: of DiagnosticCode, empty where all is well."""

    part: str
    ok: bool
    text: str
    code: str = ""


def examine(config: Config, patience_s: float) -> Iterator[Finding]:
    """Everything, one after the other. patience_s: for each camera and for the autopilot."""
    yield from config_findings(config)
    running = running_service(config, patience_s)
    if running is not None:
        yield from running
    else:
        yield Finding("service", True, "does not run; its parts are tried here")
        if not config.cameras:
            yield Finding(
                "cameras",
                False,
                "none is configured: add a [[camera]] to the configuration",
                DiagnosticCode.NO_CAMERA_CONFIGURED,
            )
        for camera in config.cameras:
            yield camera_finding(camera, config, patience_s)
        yield from autopilot_findings(config, patience_s)
    yield from machine_findings(config)


def config_findings(config: Config) -> Iterator[Finding]:
    """The changed safety keys. A changed key is reported and is no fault: some must fit the
    camera and the vehicle."""
    for found in template_intrinsics(config.cameras):
        yield Finding(f"camera {found.camera}", False, found.line(), found.code)
    lines = safety_lines(config)
    yield Finding("safety keys", True, "all have their defaults" if not lines else f"changed: {'; '.join(lines)}")


def running_service(config: Config, patience_s: float) -> list[Finding] | None:
    """What the running service says of itself, once its start is over; None: none runs. One that is there and says
    nothing has the cameras and the line all the same."""
    address = config.publish.health.replace("{run}", str(folders().run))
    try:
        if not address or not address_in_use(address):
            return None
        health = _past_its_start(address, patience_s)
    except PermissionError:
        text = f"one may run, but {address} is closed to this user: ask with sudo, or as a member of its group"
        return [Finding("service", False, text, DiagnosticCode.SERVICE_UNREACHABLE)]
    except DriverError:
        text = f"one holds {address}, but told nothing within {patience_s:g} s: does it hang? (systemctl status osape-companion)"
        return [Finding("service", False, text, DiagnosticCode.SERVICE_UNREACHABLE)]
    if not health.diagnostics and not health.troubles:
        return [Finding("service", True, "running: OK (details: `companion status`)")]
    if health.diagnostics:
        return [Finding("service", False, f"{d.code}: {d.text}", d.code) for d in health.diagnostics]
    return [Finding("service", False, text) for text in health.troubles]  # an older service


def _past_its_start(address: str, patience_s: float) -> pb.Health:
    """Its report as soon as it is no longer starting, else when patience ends. Raises DriverError when none comes."""
    end_s = time.monotonic() + patience_s
    health = newest_health(address, patience_s)
    while health.state == pb.Health.STATE_STARTING and time.monotonic() < end_s:
        health = newest_health(address, patience_s)
    return health


def camera_finding(section: CameraConfig, config: Config, patience_s: float) -> Finding:
    """Whether a camera opens, how fast its frames come and how much of them is measured."""
    part = f"camera {section.name}"
    if section.kind == "mcap":
        text = 'kind = "mcap" is for recordings; name the live one: oak, zed, v4l2 or simulated'
        return Finding(part, False, text, DiagnosticCode.NOT_A_LIVE_CAMERA)
    frames: list[DepthFrame] = []
    supervisor = CameraSupervisor(section, lambda info: None, frames.append, config.supervision)
    supervisor.open()
    try:
        _until(lambda: len(frames) > 3 * section.fps or bool(supervisor.status.last_loss), patience_s)
        status = supervisor.status
    finally:
        supervisor.close()
    if not frames:
        text = status.last_loss or status.cause or "it opened and gave no frame"
        return Finding(part, False, f"no frame: {text}", DiagnosticCode.CAMERA_UNAVAILABLE)
    span_s = (frames[-1].t_exposure_ns - frames[0].t_exposure_ns) / NS
    hz = (len(frames) - 1) / span_s if span_s > 0.0 else 0.0
    depth = frames[-1].depth_mm
    measured = float(np.mean((depth > 0) & (depth < FAR_MM)))
    late_ms = float(np.median([f.t_arrival_ns - f.t_exposure_ns for f in frames])) / 1e6
    text = f"{depth.shape[1]}x{depth.shape[0]}, {hz:.1f} Hz, {late_ms:.0f} ms from exposure to here, {100 * measured:.0f} % measured"
    if measured < MIN_MEASURED_SHARE:
        return Finding(
            part,
            False,
            f"{text}: almost nothing; is the lens covered, is it too dark, is all out of range?",
            DiagnosticCode.CAMERA_FEW_MEASURED,
        )
    if hz < 0.8 * section.fps:
        return Finding(
            part,
            False,
            f"{text}: fps = {section.fps:g} was asked for; is it on USB 3, does another process use it?",
            DiagnosticCode.CAMERA_RATE_LOW,
        )
    return Finding(part, True, text)


def autopilot_findings(config: Config, patience_s: float) -> Iterator[Finding]:
    """The line, the autopilot's heartbeat, attitude and clock, and its parameters."""
    a = config.autopilot
    if not a.address:
        yield Finding(
            "autopilot", False, "none is configured: set [autopilot] address", DiagnosticCode.NO_AUTOPILOT_CONFIGURED
        )
        return
    try:
        signing = signing_of(a, folders().state)
    except DriverError as error:
        yield Finding("signing", False, str(error), DiagnosticCode.SIGNING_FAULT)
        return
    reader, version = ParameterReader(), VersionReader()

    def received(message: Any, arrival_ns: int) -> None:
        reader.take(message, arrival_ns)
        version.take(message)

    session = MavlinkSession(params_of(config), on_message=received, signing=signing)
    link = MavlinkLink(parse_address(a.address), session, lambda samples: None)
    link.open()
    try:
        status = _listened(link, reader, version, patience_s)
    finally:
        link.close()
        signing.close()
    if status.signing_trouble:
        yield Finding("signing", False, status.signing_trouble, DiagnosticCode.SIGNING_FAULT)
    elif status.signed:
        yield Finding("signing", True, "both ends sign with the same key")
    if link.budget is not None:
        text, warning = link.budget.words(), link.budget.warning()
        code = DiagnosticCode.LINK_SLOW if warning else ""
        yield Finding("line", not warning, f"{text}: {warning}" if warning else text, code)
    yield from _link_findings(config, link, status)
    for conflict in conflict_diagnostics(status.conflicts):
        yield Finding("autopilot", False, conflict.text, conflict.code)
    if status.vehicle is not None:
        kind, read = status.vehicle.autopilot, reader.values()
        facts = AutopilotFacts(kind=kind, values=read, silent=reader.silent(), version=version.version)
        yield Finding(
            "firmware", True, f"{kind} v{facts.version}" if facts.version else f"{kind}, version not reported"
        )
        known = ", ".join(f"{name} = {value:g}" for name, value in read.items()) or "none was answered"
        code = "" if reader.values() else DiagnosticCode.PARAMETERS_UNKNOWN
        yield Finding("parameters", bool(reader.values()), known, code)
        for line in advice(facts, config.avoid):
            yield Finding("parameters", not config.avoid.send, line, DiagnosticCode.PARAMETER_ADVICE)
        for line in reader.contradictions(time.monotonic_ns()):
            yield Finding("parameters", False, line, DiagnosticCode.PARAMETER_CONTRADICTION)


def _listened(link: MavlinkLink, reader: ParameterReader, version: VersionReader, patience_s: float) -> LinkStatus:
    """The link after a while: as soon as all is known, else when patience ends."""

    def known() -> bool:
        status = link.status()
        if status.vehicle is None:
            return False
        now_ns, system = time.monotonic_ns(), status.vehicle.system_id
        reader.begin(status.vehicle.autopilot, system)
        version.begin(status.vehicle.autopilot, system)
        for request in (*reader.due(now_ns, system), *version.due(now_ns, system)):
            link.post(request)
        synchronised = status.clock.source is ClockSource.TIMESYNC and status.attitude_hz > 0.0
        return synchronised and reader.settled and version.settled and time.monotonic_ns() > settled_ns

    settled_ns = time.monotonic_ns() + 3 * NS  # rates are measured over two seconds
    _until(known, patience_s)
    return link.status()


def _link_findings(config: Config, link: MavlinkLink, status: LinkStatus) -> Iterator[Finding]:
    line, wanted_hz = link.state, config.autopilot.attitude_hz
    if line.error or not (line.open or status.received):
        yield Finding("autopilot", False, f"no line: {line.error}", DiagnosticCode.LINK_CLOSED)
        return
    if status.vehicle is None:
        other = f" ({status.received} messages came, none an autopilot's heartbeat)" if status.received else ""
        yield Finding(
            "autopilot",
            False,
            f"no heartbeat on {config.autopilot.address}{other}: is it on, and sending here?",
            DiagnosticCode.NO_HEARTBEAT,
        )
        return
    v = status.vehicle
    yield Finding("autopilot", True, f"{v.autopilot}, system {v.system_id}, {'ARMED' if v.armed else 'disarmed'}")
    rate = f"{status.attitude_hz:.0f} Hz of {wanted_hz:g} wanted, position {status.position_hz:.0f} Hz"
    enough = status.attitude_hz >= ATTITUDE_SHARE * wanted_hz
    if 0.0 < status.attitude_hz < MIN_ATTITUDE_HZ:
        low = attitude_rate_low(status.attitude_hz, wanted_hz)
        yield Finding("attitude", False, low.line(), low.code)
    else:
        text = rate if enough else f"{rate}: is the line fast enough (921600 baud)?"
        yield Finding("attitude", enough, text, "" if enough else DiagnosticCode.ATTITUDE_RATE_LOW)
    clock = status.clock
    if clock.source is ClockSource.TIMESYNC and clock.bound_ns is not None:
        yield Finding("clock", True, f"known to {clock.bound_ns / 1e6:.2f} ms")
    else:
        yield Finding(
            "clock",
            False,
            "the autopilot does not answer TIMESYNC: attitudes are late by their delay on the line",
            DiagnosticCode.NO_TIMESYNC,
        )


def machine_findings(config: Config) -> Iterator[Finding]:
    """Room for logs, and kernels that are compiled."""
    record = config.record
    if record.record == "off":
        yield Finding("log", True, "recording is off")
    else:
        yield _log_finding(Path(record.folder) if record.folder else folders().state / "logs", record.least_free_mb)
    if discarded := discard_damaged():
        text = f"{discarded} damaged files were deleted, and are compiled again now"
        yield Finding("kernel cache", False, text, DiagnosticCode.KERNEL_CACHE_DAMAGED)
    begun_s = time.process_time()  # a machine that is busy with other things compiles nothing
    run_kernels(("extractor",), metres=False)
    took_s = time.process_time() - begun_s
    if took_s > COMPILED_S:
        yield Finding(
            "kernels",
            False,
            f"had to be compiled now ({took_s:.0f} s); run `companion warmup` as the service's user",
            DiagnosticCode.KERNELS_NOT_COMPILED,
        )
    else:
        yield Finding("kernels", True, f"compiled; ready in {took_s:.1f} s")


def _log_finding(folder: Path, least_mb: float) -> Finding:
    place = folder
    while not place.exists():
        place = place.parent
    if not os.access(place, os.W_OK):
        text = f"{folder} cannot be written by this user; name another in [record] folder"
        return Finding("log", False, text, DiagnosticCode.LOG_NOT_WRITABLE)
    free_mb = free_bytes(place) / 1e6
    if free_mb < least_mb:
        return Finding(
            "log",
            False,
            f"{free_mb:.0f} MB free for {folder}, least_free_mb = {least_mb:g}: nothing would be recorded",
            DiagnosticCode.DISK_LOW,
        )
    return Finding("log", True, f"{folder}, {free_mb / 1000:.1f} GB free")


def _until(condition: Callable[[], bool], seconds: float) -> None:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and not condition():
        time.sleep(0.05)


def applied(config: Config, patience_s: float, *, yes: bool) -> Iterator[Finding]:
    """Writes what the autopilot lacks, with a yes. Only where no service has its line."""
    if not config.autopilot.address:
        return
    if running_service(config, patience_s) is not None:
        text = "nothing is written: the service has the line; stop it first (systemctl stop osape-companion)"
        yield Finding("apply", False, text, DiagnosticCode.PARAMETERS_NOT_WRITTEN)
        return
    try:
        for ok, text in apply(config, patience_s, (lambda wanted: True) if yes else _typed_yes):
            yield Finding("apply", ok, text, "" if ok else DiagnosticCode.PARAMETERS_NOT_WRITTEN)
    except DriverError as error:
        yield Finding("apply", False, f"nothing is written: {error}", DiagnosticCode.PARAMETERS_NOT_WRITTEN)


def _typed_yes(wanted: list[Change]) -> bool:
    """Whether somebody who read the list typed yes."""
    print_line("to be written to the autopilot:")
    for change in wanted:
        print_line(f"    {change.words()}")
    sys.stdout.write("type yes to write them: ")
    sys.stdout.flush()
    return sys.stdin.readline().strip() == "yes"


def _measure_mounts(config: Config, args: argparse.Namespace) -> int:
    """0: every camera is mounted as configured; 1: one is not, or could not be measured."""
    if running_service(config, args.patience) is not None:
        raise DriverError("the service has the cameras and the line; stop it first (systemctl stop osape-companion)")
    found = []
    for finding in measured_mounts(config, args.seconds, (lambda text: None) if args.json else print_line):
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
    parser = subparsers.add_parser("doctor", help="what works and what does not, before the flight")
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", required=True, help="the service's")
    parser.add_argument(
        "--patience", type=float, default=25.0, metavar="S", help="for each camera, and the autopilot (25)"
    )
    parser.add_argument(
        "--apply", action="store_true", help="write the autopilot's parameters: a list, then a typed yes"
    )
    parser.add_argument(
        "--mount", action="store_true", help="measure the cameras' mounts instead, while the vehicle is turned by hand"
    )
    parser.add_argument(
        "--seconds", type=float, default=60.0, metavar="S", help="with --mount: longest measurement (60)"
    )
    parser.add_argument("--yes", action="store_true", help="with --apply: the yes, given beforehand")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: all is as it should be; 1: not. Raises ValueError for options that do not go together."""
    if args.yes and not args.apply:
        raise ValueError("--yes goes with --apply alone")
    if args.json and args.apply and not args.yes:
        raise ValueError("--apply asks for a typed yes; with --json give --yes")
    config = load_config(args.config)
    if args.mount:
        if args.apply:
            raise ValueError("--mount and --apply do not go together; use one after the other")
        return _measure_mounts(config, args)
    findings = []
    writing = applied(config, args.patience, yes=args.yes) if args.apply else iter(())
    for finding in chain(writing, examine(config, args.patience)):
        findings.append(finding)
        if not args.json:
            print_line(f"{'ok ' if finding.ok else ' ! '} {finding.part}: {finding.text}")
    well = all(f.ok for f in findings)
    if args.json:
        print_json({"ok": well, "findings": [asdict(f) for f in findings]})
    elif well:
        print_line("all is as it should be")
    return 0 if well else 1
