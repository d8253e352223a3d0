"""`companion check-config FILE`: is this configuration usable, and what does it change?"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from core.types import CameraInfo, Intrinsics
from drivers.base import DriverError

from ..console import fail, print_json, print_line, warn
from .camera import CameraConfig
from .camera_kinds import CAMERA_KINDS, RECORDED, ignored_keys
from .clear_reach import clear_reach_texts
from .differences import Difference, differences
from .loader import Config, ConfigError, load_config
from .named_files import is_missing, named_files
from .obstacle_range import obstacle_range_m
from .startup import startup_problems
from .template_intrinsics import template_texts


def add_parser(subparsers: Any) -> None:
    """The command line of `companion check-config`."""
    parser = subparsers.add_parser("check-config")
    parser.add_argument("file", type=Path, metavar="FILE", help="configuration (TOML)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: usable; 1: not, every mistake is on stderr (and in the object with --json)."""
    try:
        config = load_config(args.file)
    except ConfigError as error:
        if args.json:
            print_json({"file": str(args.file), "ok": False, "problems": list(error.problems)})
        fail(str(error))
        return 1
    found = differences(config)
    refused = [
        *(text for _, text in template_texts(config.cameras)),
        *startup_problems(config),
        *_range_problems(config.cameras),
    ]
    if args.json:
        print_json(
            {
                "file": str(args.file),
                "ok": not refused,
                "problems": refused,
                "lacks_for_run": lacks_for_run(config),
                "warnings": [] if refused else list(_warnings(config, found)),
                "changes": _as_json(found),
            }
        )
    for text in refused:
        fail(f"{args.file}: {text}")
    if not args.json and not refused:
        _print_usable(args.file, config, found)
    return 1 if refused else 0


def _print_usable(path: Path, config: Config, found: list[Difference]) -> None:
    """Prints what the configuration is good for, the ranges of its cameras, and the keys that it changes."""
    lacks = lacks_for_run(config)
    print_line(f"{path}: usable{' for `companion replay`' if lacks else ''}")
    if lacks:
        print_line(f"  for `companion run` it lacks {' and '.join(lacks)}; `companion setup` writes a complete one")
    cameras = ", ".join(f"{c.name} ({c.kind})" for c in config.cameras) or "none (every camera as recorded)"
    print_line(f"  cameras: {cameras}")
    for camera in config.cameras:
        if camera.max_range_m is not None:
            print_line(f"  {_range_line(camera)}")
    for text in _warnings(config, found):
        warn(text)
    for difference in found:
        print_line(f"  {'safety key: ' if difference.safety else ''}{difference.text()}")
    if not found:
        print_line("  all parameters have their defaults")


def _warnings(config: Config, found: Sequence[Difference]) -> Iterator[str]:
    """What does not make the configuration unusable, but may keep the service from its task."""
    described = [_described(camera) for camera in config.cameras if camera.kind != RECORDED]
    if config.avoid.send:
        yield from clear_reach_texts(described, config.avoid, config.extractor)
    yield from _calibration_texts(config.cameras)
    yield from _ignored_texts(config.cameras, found)
    yield from _missing_texts(config)


def lacks_for_run(config: Config) -> list[str]:
    """What a service with this configuration would wait for in vain; it is complete for a replay."""
    lacks = []
    recorded = [camera.name for camera in config.cameras if camera.kind == RECORDED]
    if len(recorded) == len(config.cameras):
        lacks.append("a [[camera]] of a live kind")
    elif recorded:
        lacks.append(f"a live kind of [[camera]] {', '.join(recorded)}")
    if not config.autopilot.address:
        lacks.append("[autopilot] address")
    return lacks


def _range_line(camera: CameraConfig) -> str:
    """The range up to which obstacles are found, of a camera whose greatest range is configured."""
    info = _described(camera)
    how = ""
    if camera.ke_per_m is None:
        recorded = camera.kind == RECORDED
        how = " (assumed; the value in the recording counts)" if recorded else " (typical of its driver)"
    return (
        f"{camera.name}: obstacles are found up to {obstacle_range_m(info):.1f} m of max_range_m = {info.max_range_m:g}, "
        f"with ke_per_m = {info.ke_per_m:g}{how}"
    )


def _calibration_texts(cameras: Sequence[CameraConfig]) -> Iterator[str]:
    """Why a ZED could not be opened with its calibration on this computer. The configuration may be for another one."""
    from drivers.cameras.zed_calibration import load_zed_calibration

    for camera in cameras:
        if camera.kind == "zed":
            try:
                load_zed_calibration(Path(camera.calibration), camera.width_px, camera.height_px)
            except DriverError as error:
                yield f'[[camera]] "{camera.name}" cannot be opened on this computer: {error}'


def _ignored_texts(cameras: Sequence[CameraConfig], found: Sequence[Difference]) -> Iterator[str]:
    """Cameras with keys of another kind."""
    for camera in cameras:
        keys = [d.key for d in found if d.camera == camera.name and d.key in ignored_keys(camera.kind)]
        if keys:
            yield f'[[camera]] "{camera.name}": kind "{camera.kind}" does not use {", ".join(keys)}; remove that, or correct kind'


def _missing_texts(config: Config) -> Iterator[str]:
    """Files without which the service would not start. The configuration may be for another computer."""
    for key, name in named_files(config).items():
        if is_missing(Path(name)):
            yield f'{key} = "{name}" does not exist on this computer; make or copy it there, and enter the whole path'


def _range_problems(cameras: Sequence[CameraConfig]) -> Iterator[str]:
    """Cameras of which one limit of the range is configured and contradicts the typical value of the other."""
    for camera in cameras:
        try:
            _described(camera)
        except ValueError as error:
            yield str(error)


def _described(camera: CameraConfig) -> CameraInfo:
    """A camera with typical values of its driver for all that its configuration leaves out."""
    info = CameraInfo(camera.name, Intrinsics(640, 480, 400.0, 400.0, 319.5, 239.5))
    if (kind := CAMERA_KINDS.get(camera.kind)) is not None:
        info = replace(
            info,
            max_range_m=kind.typical_range_m,
            ke_per_m=kind.typical_ke_per_m,
            bias_per_m=kind.typical_bias_per_m,
        )
    return camera.applied_to(info)


def _as_json(found: list[Difference]) -> dict[str, dict[str, dict[str, Any]]]:
    """Section ("camera NAME" for a camera) -> key -> value, default, unit, and whether it is a safety key."""
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for d in found:
        section = f"camera {d.camera}" if d.section == "camera" else d.section
        keys = out.setdefault(section, {})
        keys[d.key] = {"value": d.value, "default": d.default, "unit": d.unit, "safety": d.safety}
    return out
