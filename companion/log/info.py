"""`companion info`: prints content, regularity and damage of a log."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, Final

from core.codes import text_of
from core.types import CameraInfo, InvalidCause
from drivers.logs.written import seems_written
from drivers.shell_word import shell_word

from ..config.obstacle_range import obstacle_range_m
from ..console import counted, fail, first_damages, print_json, print_line
from ..pipeline.sync import DropCause
from .log_content import NS, LogInfo, TopicInfo, read_log_info
from .recovered_text import recovered_texts

_LISTED: Final = 40
_MIN_GAP_NS: Final = 150_000_000
"""Shorter gaps are not printed: frames are matched across them ([sync] max_gap_s)."""
_REGULAR: Final = ("depth", "attitude", "pose")
"""Kinds of topics whose gaps are printed."""


def _text(code: str) -> str:
    """The text of a code; another string ("used") is returned unchanged."""
    return text_of(text_of(code, InvalidCause), DropCause)


def _code_and_text(code: str) -> str:
    text = _text(code)
    return code if text == code else f"{code} ({text})"


def as_json(info: LogInfo) -> dict[str, Any]:
    """The object of `--json`."""
    span = info.span_ns
    return {
        "file": str(info.path),
        "bytes": info.size,
        "ours": info.ours,
        "software": info.run.software if info.run else None,
        "source": info.run.source if info.run else None,
        "duration_s": (span[1] - span[0]) / NS if span else None,
        "topics": [_topic_json(topic) for topic in info.topics.values()],
        "cameras": [_camera_json(info) for info in info.cameras],
        "decisions": dict(sorted(info.decisions.items())),
        "prisms": {"valid": info.valid, "invalid": dict(sorted(info.invalid.items()))},
        "texts": {code: _text(code) for code in sorted({*info.decisions, *info.invalid} - {"used"})},
        "damage": [*info.damages, *info.undecodable],
        "lost": info.lost,
        "descriptions_from": info.borrowed,
    }


def _topic_json(topic: TopicInfo) -> dict[str, Any]:
    gaps = topic.gaps()
    return {
        "topic": topic.topic,
        "schema": topic.schema,
        "messages": len(topic.times_ns),
        "bytes": topic.size,
        "rate_hz": topic.rate_hz,
        "longest_interval_s": max(topic.intervals_ns, default=0) / NS,
        "gaps": len(gaps),
        "steps_back": topic.steps_back,
    }


def _camera_json(info: CameraInfo) -> dict[str, Any]:
    k, m = info.intrinsics, info.mount
    return {
        "camera": info.camera,
        "width_px": k.width,
        "height_px": k.height,
        "fx_px": k.fx,
        "fy_px": k.fy,
        "mount_deg": [math.degrees(a) for a in (m.roll_rad, m.pitch_rad, m.yaw_rad)],
        "lever_arm_m": [m.x_m, m.y_m, m.z_m],
        "range_m": [info.min_range_m, info.max_range_m],
        "ke_per_m": info.ke_per_m,
        "bias_per_m": info.bias_per_m,
        "obstacle_range_m": obstacle_range_m(info),
    }


def print_info(info: LogInfo) -> None:
    """Prints the content as text."""
    span = info.span_ns
    duration = f", {(span[1] - span[0]) / NS:.3f} s" if span else ""
    print_line(f"{info.path}: {info.size / 1e6:.2f} MB{duration}")
    if info.run is not None:
        print_line(f"made by {info.run.software} ({info.run.source or 'unknown source'})")
    if info.topics and not info.ours:
        print_line("not a log of this software: none of its topics is known")
    for text in recovered_texts(info.lost, info.borrowed):
        print_line(f"warning: {text}")
    for camera in info.cameras:
        print_line(_camera_line(camera))
    listed = list(info.topics.values())[:_LISTED]
    width = max((len(topic.topic) for topic in listed), default=0)
    if listed:
        print_line(f"  {'topic':<{width}} messages        rate    content, type")
    for topic in listed:
        rate = f"{topic.rate_hz:8.2f} Hz" if topic.rate_hz is not None else " " * 11
        print_line(
            f"  {topic.topic:<{width}} {len(topic.times_ns):8d} {rate}  {topic.size / 1e6:9.3f} MB  {topic.schema}"
        )
    if len(info.topics) > len(listed):
        print_line(f"  and {counted(len(info.topics) - len(listed), 'more topic')} (--json lists all)")
    start_ns = span[0] if span else 0
    for topic in info.topics.values():
        _print_anomalies(topic, start_ns)
    if info.decisions:
        print_line(
            "decisions: " + ", ".join(f"{n} {_code_and_text(code)}" for code, n in sorted(info.decisions.items()))
        )
    if info.valid or info.invalid:
        blind = "".join(f"; {n} blind: {_code_and_text(code)}" for code, n in sorted(info.invalid.items()))
        print_line(f"prisms: {info.valid} valid frames{blind}")


def _camera_line(info: CameraInfo) -> str:
    k, m = info.intrinsics, info.mount
    angles = ", ".join(f"{math.degrees(a):g}" for a in (m.roll_rad, m.pitch_rad, m.yaw_rad))
    return (
        f"camera {info.camera}: {k.width}x{k.height}, fx {k.fx:g} fy {k.fy:g} px, "
        f"{info.min_range_m:g}..{info.max_range_m:g} m, depth noise {info.ke_per_m:g}/m, bias {info.bias_per_m:g}/m, obstacles are detected up to "
        f"{obstacle_range_m(info):.1f} m, mount roll, pitch, yaw {angles} deg"
    )


def _print_anomalies(topic: TopicInfo, start_ns: int) -> None:
    gaps = [gap for gap in topic.gaps() if gap[1] >= _MIN_GAP_NS] if topic.key in _REGULAR else []
    if gaps:
        at, longest = max(gaps, key=lambda gap: gap[1])
        print_line(
            f"{topic.topic}: gaps: {len(gaps)}, the longest {longest / NS:.3f} s at {(at - start_ns) / NS:.3f} s"
        )
    if topic.steps_back:
        print_line(f"{topic.topic}: {topic.steps_back} timestamps go backwards")


def _remedy(info: LogInfo) -> str:
    """What to do about a damaged file."""
    if info.topics:
        return f"`companion recover {shell_word(info.path)}` recovers the readable part"
    return "No message in it can be read, so that nothing can be recovered: use another copy of the file"


def add_parser(subparsers: Any) -> None:
    """The command line of `companion info`."""
    parser = subparsers.add_parser("info")
    parser.add_argument("input", type=Path, metavar="FILE", help="an MCAP file of any origin")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: the file is complete; 1: it is damaged, or still written."""
    info = read_log_info(args.input)
    if args.json:
        print_json(as_json(info))
    else:
        print_info(info)
    if seems_written(args.input):
        fail(f"{args.input}: a process is writing it; what it had written was read")
        return 1
    for damage in first_damages(info.damages):
        fail(f"{args.input}: damaged: {damage}. {_remedy(info)}")
    for text in info.undecodable:
        fail(f"{args.input}: {text}; correct the software that wrote them, or continue without them")
    return 1 if info.damages or info.undecodable else 0
