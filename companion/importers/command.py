"""`companion import`: the command line and the report.

Problems with parts of a recording are reported with place and remedy, and the command ends with status 1; the readable
part is in the log."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, Final

from drivers.shell_word import shell_word

from ..argument_types import number_in
from ..common_options import add_config, add_replace
from ..config.loader import Config, ConfigError, config_of, load_config
from ..console import counted, fail, print_json, print_line, warn
from ..usage_error import UsageError, given_option
from .recording import Imported, import_recording
from .report import BASE_FRAME, LATENCY_S, ImportOptions, RosTopics
from .ros2_files import is_bag
from .tum import GROUND_TRUTH, is_tum

TOPICS: Final = {
    "depth": "topic of the depth images",
    "info": "topic of their CameraInfo (default: camera_info beside the depth topic)",
    "attitude": "topic of the attitude",
    "pose": "topic of the position (default: that of the attitude)",
}
"""Options --NAME-topic with their help."""
_ROS_ONLY: Final = (*(f"{name}_topic" for name in TOPICS), "base_frame")
_IMAGES_ONLY: Final = ("frame_latency_ms", "no_tlog")
_FLIGHT_LOG: Final = ("tlog", "no_tlog", "tlog_epoch", "system_id")


def add_parser(subparsers: Any) -> None:
    """The command line of `companion import`."""
    parser = subparsers.add_parser("import")
    parser.add_argument(
        "source",
        type=Path,
        metavar="DIR|FILE",
        help="directory of depth PNGs or stereo pairs, TUM RGB-D directory, or ROS 2 recording (.mcap, .db3 or bag directory)",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.mcap", help="the log to write")
    add_replace(parser)
    add_config(parser, "configuration whose [[camera]] section gives mount, ranges and noise")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    _add_camera(parser.add_argument_group("camera (overrides the configuration and the recording)"))
    _add_timing(parser.add_argument_group("timing and attitude (.tlog, PX4 .ulg, ArduPilot .bin)"))
    ros = parser.add_argument_group("topics of a ROS 2 recording (needed only where several fit)")
    for name, what in TOPICS.items():
        ros.add_argument(f"--{name}-topic", metavar="TOPIC", help=what)
    ros.add_argument(
        "--base-frame",
        metavar="FRAME",
        help=f"frame of the vehicle's body (default: {BASE_FRAME})",
    )


def _add_camera(camera: Any) -> None:
    camera.add_argument("--camera", metavar="NAME", help="name of the camera in the log (default: front)")
    camera.add_argument(
        "--mount",
        type=_three,
        metavar="R,P,Y",
        help="roll, pitch and yaw of the mount in degrees; a camera that looks 20 degrees down: --mount=0,-20,0",
    )
    camera.add_argument(
        "--lever-arm",
        type=_three,
        metavar="X,Y,Z",
        help="position relative to the autopilot in metres: forward, right, down",
    )
    camera.add_argument(
        "--min-range-m",
        type=float,
        metavar="M",
        help="nearer depth counts as not measured, in metres",
    )
    camera.add_argument(
        "--max-range-m",
        type=float,
        metavar="M",
        help="range of the camera in metres; what measures farther counts as free up to it",
    )
    camera.add_argument(
        "--ke",
        type=float,
        metavar="1/M",
        help="depth noise: standard deviation = ke * depth^2",
    )


def _add_timing(folder: Any) -> None:
    folder.add_argument(
        "--frame-latency-ms",
        type=number_in(float, 0.0, 5000.0),
        metavar="MS",
        help=f"of a directory: delay from exposure to arrival (default: {1000.0 * LATENCY_S:g} ms)",
    )
    log = folder.add_mutually_exclusive_group()
    log.add_argument(
        "--tlog",
        "--attitude-log",
        type=Path,
        metavar="FILE",
        help="take attitude and position from this log (default: the one in the directory)",
    )
    log.add_argument(
        "--no-tlog", action="store_true", help="take attitude and position from frames.csv although there is a log"
    )
    folder.add_argument(
        "--tlog-epoch",
        type=_epoch_us,
        metavar="UNIX_S",
        help="time of t_ns 0 in the log: Unix time in seconds, or seconds since the autopilot's start if the log has no GPS time (default: found automatically)",
    )
    folder.add_argument(
        "--system-id",
        type=number_in(int, 1, 255),
        metavar="ID",
        help="MAVLink system id of the vehicle, if the log has several",
    )


def run(args: argparse.Namespace) -> int:
    """0: everything was converted; 1: a part or everything is missing; the readable part is kept. Raises UsageError."""
    _refuse_unused(args)
    config = load_config(args.config) if args.config is not None else Config()
    done = import_recording(args.source, args.output, _options(args, config), config, replace=args.replace)
    if args.json:
        print_json(_json(done))
    else:
        _print_summary(done)
    for warning in done.warnings:
        warn(warning)
    for problem in done.problems:
        fail(problem)
    if done.problems:
        fail(f"{done.output}: {done.frames} of {done.frames_named} frames kept")
    return 1 if done.problems else 0


def _refuse_unused(args: argparse.Namespace) -> None:
    """Raises UsageError for an option without an effect on this kind of recording."""
    path: Path = args.source
    if not path.exists():
        return  # which is reported instead
    tum = path.is_dir() and is_tum(path)
    if path.is_dir() and (tum or not is_bag(path)):
        wrong, kind = _ROS_ONLY, "a ROS 2 recording"
    else:
        wrong, kind = _IMAGES_ONLY, "a directory of images"
    if option := given_option(args, wrong):
        raise UsageError(f"{option} is for {kind}, and {path} is none; leave it out")
    if tum and (option := given_option(args, _FLIGHT_LOG)):
        raise UsageError(
            f"{option} is for the log of an autopilot; the attitude of {path} is in {GROUND_TRUTH}; leave it out"
        )


def _options(args: argparse.Namespace, config: Config) -> ImportOptions:
    names = [c.name for c in config.cameras]
    name = args.camera or (names[0] if len(names) == 1 else "front")
    options = {"min_range_m": args.min_range_m, "max_range_m": args.max_range_m, "ke_per_m": args.ke}
    given: dict[str, Any] = {k: v for k, v in options.items() if v is not None}
    if args.mount is not None:
        given |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), args.mount, strict=True))
    if args.lever_arm is not None:
        given |= dict(zip(("x_m", "y_m", "z_m"), args.lever_arm, strict=True))
    content = {k: v for k, v in (asdict(config.camera(name)) | given).items() if v is not None}
    try:
        (camera,) = config_of({"camera": [content]}, "the options of the camera").cameras
    except ConfigError as error:
        raise UsageError(str(error)) from error
    return ImportOptions(
        camera=camera,
        frame_latency_s=LATENCY_S if args.frame_latency_ms is None else args.frame_latency_ms / 1000.0,
        tlog=args.tlog,
        use_tlog=not args.no_tlog,
        tlog_epoch_us=args.tlog_epoch,
        system_id=args.system_id,
        topics=RosTopics(
            depth=args.depth_topic,
            camera_info=args.info_topic,
            attitude=args.attitude_topic,
            pose=args.pose_topic,
            base_frame=args.base_frame or BASE_FRAME,
        ),
        sync=config.sync,
    )


def _print_summary(done: Imported) -> None:
    print_line(
        f"{done.output}: {counted(done.frames, 'frame')} over {done.duration_s:.1f} s, {counted(done.attitudes, 'attitude')}, {counted(done.poses, 'position')}"
    )
    if done.frames:
        print_line(f"  {done.depth}")
    for note in done.notes:
        print_line(f"  {note}")
    if done.file_list is not None:
        print_line(f"  {done.file_list} leads from a frame's number to its file")
    if not done.problems:
        print_line(f"next: companion replay {shell_word(done.output)} -o prisms.mcap")


def _json(done: Imported) -> dict[str, Any]:
    return {
        "output": str(done.output),
        "frames": done.frames,
        "frames_named": done.frames_named,
        "attitudes": done.attitudes,
        "poses": done.poses,
        "duration_s": round(done.duration_s, 6),
        "depth": done.depth.as_json(),
        "file_list": None if done.file_list is None else str(done.file_list),
        "notes": list(done.notes),
        "warnings": list(done.warnings),
        "problems": list(done.problems),
    }


def _three(text: str) -> tuple[float, float, float]:
    try:
        a, b, c = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected three numbers with commas, such as 0,-20,0") from error
    return a, b, c


def _epoch_us(text: str) -> int:
    """Microseconds of a decimal number of seconds, exact."""
    try:
        value = Decimal(text)
    except InvalidOperation as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a unix time in seconds") from error
    if not value.is_finite() or not -(1 << 33) < value < 1 << 33:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a unix time in seconds, nearer than the year 2242")
    return int((value * 1_000_000).to_integral_value())
