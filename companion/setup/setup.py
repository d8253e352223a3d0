"""`companion setup`: finds the devices, asks what it cannot find, writes a configuration and runs the doctor."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from drivers.base import DriverError
from drivers.cameras.realsense_calibration import DepthCalibration, read_calibration
from drivers.cameras.zed_calibration import load_zed_calibration
from drivers.mavlink.address import parse_address
from drivers.shell_word import shell_word

from ..argument_types import checked_by, number_in
from ..common_options import add_replace
from ..config.camera_kinds import CAMERA_KINDS
from ..config.loader import ConfigError, load_config
from ..console import print_line, warn
from ..doctor.doctor import PATIENCE_S, examine, print_findings
from ..doctor.finding import Finding
from ..install.steps import configuration_mode, install_paths, start_command
from ..usage_error import UsageError
from ..whole_file import refuse_existing, write_whole
from .configuration import Answers, configuration_text
from .devices import FoundCamera, find_cameras, find_serial_ports
from .listen import FoundAutopilot, candidates, find_autopilot

OUTPUT = Path("companion.toml")
SIMULATED_ADDRESS = "udpin:127.0.0.1:14540"
"""Where `companion simulate-autopilot` sends."""
PITCH_DEG = -90.0, 90.0
YAW_DEG = -180.0, 180.0
POSITION_M = -10.0, 10.0
WIDTH_M = 0.05, 10.0
HEIGHT_M = 0.05, 5.0

_Number = TypeVar("_Number", int, float)


def add_parser(subparsers: Any) -> None:
    """The command line of `companion setup`."""
    parser = subparsers.add_parser("setup")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=OUTPUT,
        metavar="FILE",
        help=f"the configuration to write (default: {OUTPUT})",
    )
    add_replace(parser)
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: use the options, the devices that are found, and defaults"
    )
    parser.add_argument(
        "--camera",
        type=checked_by(_check_camera),
        metavar="KIND[:DEVICE]",
        help=f"kind of the camera ({', '.join(CAMERA_KINDS)}) and its device (default: the one that is found)",
    )
    parser.add_argument(
        "--autopilot",
        type=checked_by(_check_autopilot),
        metavar="ADDRESS",
        help="address as in [autopilot] address (default: searched for); none: no autopilot",
    )
    _add_vehicle(parser)
    parser.add_argument(
        "--calibration", metavar="FILE", default="", help="of a ZED: its calibration file SN<serial>.conf"
    )
    parser.add_argument("--send", action="store_true", help="send obstacles to the autopilot (default: off)")
    parser.add_argument(
        "--record",
        choices=("always", "armed", "off"),
        help="when to record a log (default: always; with a simulated camera off)",
    )
    parser.add_argument("--no-doctor", action="store_true", help="do not check all parts at the end")


def _add_vehicle(parser: argparse.ArgumentParser) -> None:
    """The mount of the camera, and the size of the vehicle."""
    parser.add_argument(
        "--pitch",
        type=number_in(float, *PITCH_DEG),
        metavar="DEG",
        help="pitch of the camera mount in degrees, upwards is positive (default: 0)",
    )
    parser.add_argument(
        "--yaw",
        type=number_in(float, *YAW_DEG),
        metavar="DEG",
        help="yaw of the camera mount in degrees, to the right is positive (default: 0)",
    )
    parser.add_argument(
        "--position",
        type=number_in(float, *POSITION_M),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="position of the camera relative to the autopilot in metres: forward, right, down (default: 0 0 0)",
    )
    parser.add_argument(
        "--width",
        type=number_in(float, *WIDTH_M),
        metavar="M",
        help="width of the vehicle with rotors in metres (default: 1.0)",
    )
    parser.add_argument(
        "--height",
        type=number_in(float, *HEIGHT_M),
        metavar="M",
        help="height of the vehicle in metres (default: 0.5)",
    )


def run(args: argparse.Namespace) -> int:
    """0: written, and the doctor found no fault; 1: written, with a fault. Raises ValueError for answers that cannot be
    used, DriverError and OSError."""
    refuse_existing(args.output, replace=args.replace)
    if not args.output.parent.is_dir():
        raise ValueError(
            f"{args.output}: {args.output.parent} is not a folder; create it, or name another file with -o"
        )
    if not args.yes and not sys.stdin.isatty():
        warn("the input is not a terminal: nothing is asked, the options and defaults are used (as with --yes)")
    ask = Questions(silent=args.yes or not sys.stdin.isatty())
    answers = collect(args, ask)
    write_whole(args.output, configuration_text(answers), configuration_mode(args.output))
    print_line(f"written: {args.output}")
    try:
        config = load_config(args.output)
    except ConfigError as error:
        print_line(f"it is not complete yet: {'; '.join(error.problems)}")
        print_line(f"edit {args.output}, then run: companion doctor -c {shell_word(args.output)}")
        return 1
    findings: list[Finding] = []
    ok = True if args.no_doctor else print_findings(_kept(examine(config, PATIENCE_S), findings))
    received = any(finding.part == "autopilot" and finding.ok for finding in findings)
    print_line(f"next: {_next_step(answers, args.output, ok=ok, received=received)}")
    return 0 if ok else 1


def _kept(findings: Iterable[Finding], kept: list[Finding]) -> Iterator[Finding]:
    """The same findings, each added to a list when it is made."""
    for finding in findings:
        kept.append(finding)
        yield finding


def _next_step(answers: Answers, output: Path, *, ok: bool, received: bool) -> str:
    """What to do with the written configuration. ok: the doctor found no fault, or was not asked. received: it received an
    autopilot."""
    name = shell_word(output)
    if answers.kind == "simulated" and not answers.autopilot:
        return f'set [autopilot] address = "{SIMULATED_ADDRESS}" in {name} for `companion simulate-autopilot`'
    if answers.kind == "simulated" and received:
        return (
            f"companion run -c {name}; an autopilot is received already. If it is a SITL, set follow of the camera first: "
            "docs/how-to/fly-in-simulation.md"
        )
    if answers.kind == "simulated":
        return f"companion run -c {name}, and beside it companion simulate-autopilot -c {name}"
    if not ok:
        return f"correct each line with !, then run: companion doctor -c {name}"
    start = start_command(install_paths(Path("/")), output)
    return f"companion run -c {name}, or start the service, now and at each boot: {start}"


class Questions:
    """Asks on the terminal; where it is silent, every answer is the default."""

    def __init__(self, *, silent: bool) -> None:
        self._silent = silent

    def text(self, question: str, default: str) -> str:
        """A line of text; an empty one is the default. Raises ValueError at the end of the input."""
        if self._silent:
            return default
        sys.stdout.write(f"{question} [{default}]: " if default else f"{question}: ")
        sys.stdout.flush()
        if not (line := sys.stdin.readline()):
            print_line()
            raise ValueError("the input ended before all questions were answered; nothing was written")
        return line.strip() or default

    def number(
        self, question: str, default: _Number, limits: tuple[_Number, _Number], given: _Number | None = None
    ) -> _Number:
        """A number of the default's type within limits, without a question if it is given; asks again for anything else."""
        if given is not None:
            return given
        parse = number_in(type(default), *limits)
        while True:
            try:
                return parse(self.text(question, f"{default:g}"))
            except ArgumentTypeError as error:
                warn(str(error))


def collect(args: argparse.Namespace, ask: Questions) -> Answers:
    """The answers from flags, devices and questions."""
    camera = _camera(args.camera, ask)
    calibration_file = _calibration_file(args.calibration, camera.kind)
    pitch_question = "camera mount, pitch in degrees (a camera that looks down is negative)"
    answers = Answers(
        kind=camera.kind,
        device=camera.device,
        serial=camera.serial if camera.kind == "v4l2" else "",
        pitch_deg=ask.number(pitch_question, 0.0, PITCH_DEG, args.pitch),
        yaw_deg=ask.number("camera mount, yaw in degrees (to the right is positive)", 0.0, YAW_DEG, args.yaw),
        position_m=_position_m(args.position, ask),
        width_m=ask.number("width of the vehicle with rotors, in metres", 1.0, WIDTH_M, args.width),
        height_m=ask.number("height of the vehicle, in metres", 0.5, HEIGHT_M, args.height),
        send=args.send,
        record=args.record or ("off" if camera.kind == "simulated" else "always"),
        calibration=_calibration(camera),
        calibration_file=calibration_file,
    )
    address, system_id = _autopilot(args.autopilot or (SIMULATED_ADDRESS if camera.kind == "simulated" else None), ask)
    return replace(answers, autopilot=address, system_id=system_id)


def _position_m(given: tuple[float, float, float] | None, ask: Questions) -> tuple[float, float, float]:
    """The position of the option, else that of three answers."""
    forward, right, down = given or (
        ask.number(f"position of the camera from the autopilot in metres: {axis}", 0.0, POSITION_M)
        for axis in ("forward", "right", "down")
    )
    return forward, right, down


def _check_camera(text: str) -> None:
    """Raises ValueError for a kind of camera that does not exist."""
    if text.partition(":")[0] not in CAMERA_KINDS:
        kinds = ", ".join(CAMERA_KINDS)
        raise ValueError(f"{text!r}: expected one of {kinds}, such as v4l2:/dev/v4l/by-path/NAME for a RealSense")


def _check_autopilot(text: str) -> None:
    """Raises ValueError for an address that cannot be used."""
    if text != "none":
        parse_address(text)


def _camera(given: str | None, ask: Questions) -> FoundCamera:
    """The camera of the flag, else one of those found. Raises ValueError where none is found."""
    if given:
        kind, _, device = given.partition(":")
        return FoundCamera(kind, device, kind)
    found = find_cameras()
    for k, camera in enumerate(found):
        print_line(f"camera {k + 1}: {camera.name} {camera.device}".rstrip())
    if not found:
        raise ValueError(
            "no camera was found on USB: check cable and power (`lsusb`, of the package usbutils), or name one with --camera KIND:DEVICE; "
            "--camera simulated needs no hardware"
        )
    number = ask.number("which camera", 1, (1, len(found))) if len(found) > 1 else 1
    return found[number - 1]


def _autopilot(given: str | None, ask: Questions) -> tuple[str, int]:
    """Address and system id: the address of the flag, else the first with a heartbeat, else that of the answer. The id is 0 where
    it is not known."""
    if given:
        return ("" if given == "none" else given), 0
    ports = find_serial_ports()
    print_line(f"serial ports: {', '.join(ports) or 'none'}")
    if (found := find_autopilot(tuple(candidates(ports)), print_line)) is not None:
        print_line(f"autopilot: {found.text} on {found.address}")
        return found.address, _system_id(found, ask)
    return _asked_address(ask), 0


def _system_id(found: FoundAutopilot, ask: Questions) -> int:
    """The id of the own autopilot; 0: not known."""
    if len(found.kinds) == 1:
        (only,) = found.kinds
        print_line(
            f"[autopilot] system_id = {only}: if this is another vehicle's autopilot, correct it; those with another id are ignored"
        )
        return only
    number = ask.number("system id of this vehicle's autopilot (0: not known)", 0, (0, 255))
    if number == 0:
        warn(
            f"autopilots of several vehicles are received: {found.text}; set [autopilot] system_id to that of this vehicle (PX4: "
            "MAV_SYS_ID, ArduPilot: SYSID_THISMAV, in newer versions MAV_SYSID): without it all cameras are blind"
        )
    return number


def _asked_address(ask: Questions) -> str:
    """The address of the answer."""
    warn("no heartbeat of an autopilot: check cable, power and the baud rate of its port")
    while address := ask.text("address of the autopilot (empty: none)", ""):
        try:
            parse_address(address)
        except ValueError as error:
            warn(str(error))
            continue
        break
    return address


def _calibration_file(name: str, kind: str) -> str:
    """The absolute path of a ZED's calibration, which the service reads from another folder; "" without one. Raises ValueError
    for a file that does not exist or of another camera, BadData for one that is no calibration."""
    if not name:
        return ""
    if kind != "zed":
        raise UsageError(f"--calibration is for a zed, and the camera is of kind {kind}; leave it out")
    path = Path(name)
    if not path.is_file():
        raise ValueError(
            f"--calibration {name}: no such file; download the camera's SN<serial>.conf from the manufacturer's site"
        )
    zed = CAMERA_KINDS["zed"]
    load_zed_calibration(path, zed.width_px, zed.height_px)
    return str(path.absolute())


def _calibration(camera: FoundCamera) -> DepthCalibration | None:
    """Of a RealSense, where it can be read."""
    if camera.kind != "v4l2":
        return None
    size = CAMERA_KINDS["v4l2"]
    try:
        calibration = read_calibration(size.width_px, size.height_px, camera.serial)
    except DriverError as error:
        warn(str(error))
        return None
    print_line(
        f"intrinsics read from RealSense {calibration.serial}; depth unit: {calibration.depth_unit_mm:g} mm; "
        f"dot projector: {calibration.dot_projector}"
    )
    return calibration
