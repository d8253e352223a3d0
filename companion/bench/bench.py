"""`companion bench`: measures the frame rate that this computer reaches, with simulated images."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from core.extractor import Extractor
from core.params import Params

from ..argument_types import number_in
from ..common_options import add_config
from ..config.loader import load_config
from ..console import print_json, print_line, progress
from ..kernels.warmup import warm_up
from ..log.provenance import software
from .frames import Flight, FrameSequence, Measured, measure, render_sequence
from .host_info import HostInfo, host_info, versions
from .stage_trace import in_order
from .timing import one_core

VIEWS: Final = (("street", "buildings, cars, lamps"), ("trees", "foliage"))
"""Scenes of the simulator and their content."""
ROLL_DEG, PITCH_DEG = 5.0, -10.0
"""Camera attitude of a multirotor in forward flight."""
FRAMES, SIZE, HZ = 200, (640, 480), 12.0
KERNELS: Final = ("extractor", "simulated")
"""Groups of kernels that are measured, and of the camera that is simulated."""
WATCHED: Final = 40
"""Largest number of frames measured by stage."""
BUSY: Final = 1.2
"""Ratio of wall time to processor time above which the core was shared with other programs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """The result of the command."""

    size: tuple[int, int]
    frames: int
    hz: float  # frame rate of the assessed camera
    ready_s: float  # time to load (at the first run: compile) the kernels in a separate process
    first_s: float  # time of the first frame
    measured: tuple[Measured, ...]  # by view
    host_info: HostInfo
    versions: dict[str, str]

    def worst(self) -> Measured:
        """The view with the largest 99th percentile."""
        return max(self.measured, key=lambda m: m.times.wall(99))

    def used_share(self) -> float:
        """99th percentile of the frame time in the worst view, as a share of the frame interval."""
        return self.worst().times.wall(99) * self.hz / 1000.0


def bench(params: Params, size: tuple[int, int], frames: int, hz: float, bar: Callable[[str], Any]) -> Bench:
    """Warms up, replays the sequences and measures, on one thread of one core. bar: a context manager that gives a
    progress for a label. Raises WarmupError."""
    begun = time.monotonic()
    warm_up(KERNELS)
    ready_s = time.monotonic() - begun
    with one_core():
        with bar("simulating a camera"):
            views = [render_sequence(name, name, size, roll_deg=ROLL_DEG, pitch_deg=PITCH_DEG) for name, _ in VIEWS]
        extractor = Extractor(params)
        begun = time.monotonic()
        Flight(extractor, views[0]).frame()
        first_s = time.monotonic() - begun
        measured = tuple(_measured(view, extractor, frames, bar) for view in views)
    return Bench(
        size=size,
        frames=frames,
        hz=hz,
        ready_s=ready_s,
        first_s=first_s,
        measured=measured,
        host_info=host_info(),
        versions=versions(),
    )


def _measured(view: FrameSequence, extractor: Extractor, frames: int, bar: Callable[[str], Any]) -> Measured:
    with bar(f"measuring: {view.name}") as on_progress:
        return measure(view, extractor, frames, watched=min(frames, WATCHED), progress=on_progress)


def add_parser(subparsers: Any) -> None:
    """The command line of `companion bench`."""
    parser = subparsers.add_parser("bench")
    parser.add_argument(
        "--frames",
        type=number_in(int, 10, 100_000),
        default=FRAMES,
        metavar="N",
        help=f"frames of each scene (default: {FRAMES})",
    )
    parser.add_argument(
        "--size", type=_size, default=SIZE, metavar="WxH", help="size of the depth image in pixels (default: 640x480)"
    )
    parser.add_argument(
        "--hz",
        type=number_in(float, 0.1, 1000.0),
        default=HZ,
        metavar="N",
        help=f"frame rate of the camera to compare with, in Hz (default: {HZ:g})",
    )
    add_config(parser, "configuration whose [extractor] and [expert] sections are used")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    if not found or not all(64 <= int(side) <= 4096 for side in found.groups()):
        raise argparse.ArgumentTypeError("expected width x height in pixels, 64..4096 each, such as 640x480")
    return int(found[1]), int(found[2])


def run(args: argparse.Namespace) -> int:
    """0: measured. Raises ConfigError, and WarmupError where the kernels cannot be compiled."""
    params = load_config(args.config).extractor if args.config is not None else Params()
    done = bench(params, args.size, args.frames, args.hz, progress)
    if args.json:
        print_json(_json(done))
    else:
        _print_summary(done)
    return 0


def _print_summary(done: Bench) -> None:
    width, height = done.size
    print_line(f"From a depth image of {width}x{height} pixels to planes, prisms and free ranges, on one core:")
    print_line()
    print_line(f"{'what the camera sees':<34}{'median':>10}{'p95':>10}{'p99':>10}{'frames/s':>10}")
    for m, (name, what) in zip(done.measured, VIEWS, strict=True):
        figures = "".join(f"{m.times.wall(p):>7.1f} ms" for p in (50, 95, 99))
        print_line(f"{f'{name} ({what})':<34}{figures}{1000.0 / m.times.wall():>10.0f}")
    print_line()
    print_line("Processor time by stage, ms:")
    print_line(f"  {'':<32}" + "".join(f"{m.name:>10}" for m in done.measured))
    for stage in in_order(stage for m in done.measured for stage in m.stages_ms):
        print_line(f"  {stage:<32}" + "".join(f"{m.stages_ms.get(stage, 0.0):>10.2f}" for m in done.measured))
    print_line(f"  {'between the stages':<32}" + "".join(f"{m.rest_ms():>10.2f}" for m in done.measured))
    print_line(f"  {'whole frame, median':<32}" + "".join(f"{m.times.cpu():>10.2f}" for m in done.measured))
    print_line()
    print_line(f"Start: {done.ready_s:.1f} s to load the kernels, {done.first_s:.2f} s for the first frame.")
    print_line(f"{done.frames} frames per view. Computer: {done.host_info.text()}.")
    print_line(f"{software()}; " + ", ".join(f"{name} {version}" for name, version in done.versions.items()) + ".")
    print_line()
    print_line(verdict(done))
    if busy := busy_text(done):
        print_line(busy)


def verdict(done: Bench) -> str:
    """One line: whether this computer keeps up with the camera."""
    budget, worst = 1000.0 / done.hz, done.worst()
    needs = f"{done.hz:g} Hz needs a frame every {budget:.0f} ms; this computer takes {worst.times.wall(99):.1f} ms"
    share = (
        f"in 99 of 100 frames of the harder view ({worst.name}), {100.0 * done.used_share():.0f} % of one core's time"
    )
    if done.used_share() > 1.0:
        return f"TOO SLOW: {needs} {share}. Use smaller images or set column_step = 2 in [extractor]."
    return f"{needs} {share}."


def busy_text(done: Bench) -> str:
    """A warning if other programs used the core during the measurement; "" otherwise."""
    factor = max(m.times.wall() / m.times.cpu() for m in done.measured)
    if factor < BUSY:
        return ""
    return (
        f"Other programs used this computer: frames took {factor:.1f} times their processor time. Stop them and "
        "measure again."
    )


def _json(done: Bench) -> dict[str, Any]:
    views = {}
    for m in done.measured:
        views[m.name] = {
            **{f"wall_p{p}_ms": round(m.times.wall(p), 3) for p in (50, 95, 99)},
            **{f"cpu_p{p}_ms": round(m.times.cpu(p), 3) for p in (50, 95, 99)},
            "frames_per_second": round(1000.0 / m.times.wall(), 2),
            "stages_cpu_ms": {stage: round(ms, 4) for stage, ms in m.stages_ms.items()},
            "planes": m.planes,
            "strips": m.strips,
        }
    return {
        "size_px": list(done.size),
        "frames": done.frames,
        "views": views,
        "ready_s": round(done.ready_s, 3),
        "first_frame_s": round(done.first_s, 3),
        "camera_hz": done.hz,
        "used_share": round(done.used_share(), 4),
        "machine": done.host_info.text(),
        "software": software(),
        "versions": done.versions,
        "verdict": verdict(done),
        "busy": busy_text(done),
    }
