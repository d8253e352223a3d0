"""`companion demo`: the whole way from depth images to prisms and pictures, on a simulated flight, without hardware."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from core.types import CameraInfo, DepthFrame
from drivers.base import Event
from drivers.simulated import camera_info
from drivers.simulated_flight import SimulatedFlight

from .config import Config, config_text, load_config
from .config_camera import CameraConfig
from .console import fail, progress, say, say_json, warn
from .log_writer import write_recording
from .replay import Options, replay
from .replay_report import Replay, problems_of
from .run_info import run_info
from .view import ViewOptions, Views, make_views
from .warmup import WarmupError, warm_up

OUTPUT = Path("demo-out")
CAMERA = CameraConfig(name="front", kind="simulated", flight="demo", width_px=640, seed=0)
"""The embedded default: what configs/simulated.toml says too."""
FRAME_HZ = 10.0
FAST_WIDTH_PX, FAST_FRAMES = 320, 25
PICTURES = 4

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoOptions:
    """folder: where everything goes; frames None: the whole flight; width_px None: as the configuration has it."""

    folder: Path = OUTPUT
    frames: int | None = None
    width_px: int | None = None
    config: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Demo:
    """What was made. flight: the log of the simulated hardware; prisms: the log that the replay wrote."""

    flight: Path
    prisms: Path
    frames: int
    duration_s: float
    replay: Replay
    views: Views


def simulated_flight(config: Config, options: DemoOptions) -> SimulatedFlight:
    """The flight that the configuration's simulated camera names. Raises ValueError."""
    section = next((c for c in config.cameras if c.kind == "simulated"), CAMERA)
    width = options.width_px or section.width_px
    info = section.applied_to(camera_info(width, width * 3 // 4, camera=section.name))
    duration_s = None if options.frames is None else (options.frames - 1) / FRAME_HZ + 1e-3
    return SimulatedFlight(section.flight, cameras=(info,), seed=section.seed, duration_s=duration_s)


def record(flight: SimulatedFlight, path: Path, config: Config, on_progress: Progress = lambda share: None) -> int:
    """Writes the flight as a log, as the service would on board; returns the number of frames."""
    watched = _Watched(flight, on_progress)
    write_recording(watched, path, run_info("simulated", config_text(config)))
    return watched.frames


class _Watched:
    """Passes a flight on, counts its frames and tells how far it is."""

    def __init__(self, flight: SimulatedFlight, on_progress: Progress) -> None:
        self._flight, self._on_progress = flight, on_progress
        self.frames = 0

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        return self._flight.cameras

    def events(self) -> Iterator[Event]:
        """As the flight has them."""
        for event in self._flight.events():
            if isinstance(event, DepthFrame):
                self.frames += 1
                self._on_progress(self.frames / self._flight.frame_count())
            yield event

    def close(self) -> None:
        self._flight.close()


def demo(options: DemoOptions, bar: Callable[[str], Any]) -> Demo:
    """Flies, replays and draws. bar: a context manager that gives a Progress for a label. Raises what the stages do."""
    config = load_config(options.config) if options.config is not None else Config(cameras=(CAMERA,))
    options.folder.mkdir(parents=True, exist_ok=True)
    flight_log, prisms_log = options.folder / "flight.mcap", options.folder / "prisms.mcap"
    flight = simulated_flight(config, options)
    with bar("compiling what is not compiled yet (a minute the first time)"):
        warm_up()
    with bar("flying through the simulated scene") as on_progress:
        frames = record(flight, flight_log, config, on_progress)
    with bar("turning depth images into prisms") as on_progress:
        result = replay(flight_log, Options(output=prisms_log), on_progress)
    with bar("drawing") as on_progress:
        every = max(1, frames // PICTURES)
        views = make_views(prisms_log, options.folder / "view", ViewOptions(every=every), on_progress)
    return Demo(
        flight=flight_log,
        prisms=prisms_log,
        frames=frames,
        duration_s=flight.duration_s,
        replay=result,
        views=views,
    )


def add_parser(subparsers: Any) -> None:
    """The command line of `companion demo`."""
    parser = subparsers.add_parser("demo", help="the whole way from depth to prisms, without hardware")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, metavar="DIR", help=f"folder ({OUTPUT})")
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", help="a configuration with a simulated camera")
    parser.add_argument("--frames", type=_frames, metavar="N", help="fly only so far (default: the whole flight)")
    parser.add_argument("--fast", action="store_true", help=f"{FAST_FRAMES} frames of {FAST_WIDTH_PX} pixels' width")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _frames(text: str) -> int:
    value = int(text)
    if not 1 <= value <= 10_000:
        raise argparse.ArgumentTypeError("expected 1..10000")
    return value


def run(args: argparse.Namespace) -> int:
    """0: everything was made; 1: a stage failed, or the flight holds frames that say nothing where all should."""
    options = DemoOptions(folder=args.output, config=args.config, frames=args.frames)
    if args.fast:
        options = replace(options, frames=args.frames or FAST_FRAMES, width_px=FAST_WIDTH_PX)
    try:
        done = demo(options, progress if args.json else _announced)
    except WarmupError as error:
        fail(str(error))
        return 1
    problems = problems_of(done.replay)
    if args.json:
        say_json(_json(done, problems))
    else:
        _say(done)
    for note in done.views.notes:
        warn(note)
    for problem in problems:
        fail(problem)
    return 1 if problems else 0


def _announced(label: str) -> Any:
    """A progress bar with a line before it, for people who see no bar."""
    say(f"- {label} ...")
    return progress(label)


def _say(done: Demo) -> None:
    tally, folder = done.replay.tally, done.views.page.parent if done.views.page else done.prisms.parent
    valid = max(1, tally.valid)
    say()
    say(
        f"A simulated drone with a depth camera flew for {done.duration_s:.0f} s. From each of the {done.frames} depth images"
    )
    say("and the attitude of the drone at that moment, the obstacles in view were computed:")
    say(
        f"  {tally.planes / valid:.0f} vertical planes, joined to {tally.prisms / valid:.0f} prisms, in an average image"
    )
    say(f"  {tally.valid} of {tally.frames} images say something, the ground was seen in {tally.ground_seen}")
    say()
    say("Look at:")
    if done.views.page is not None:
        say(f"  {_shown(done.views.page)}  the obstacles in 3-D: open it in a browser, turn it, step through time")
    if done.views.pictures:
        say(
            f"  {_shown(folder)}/*.png  {len(done.views.pictures)} pictures: depth with planes drawn over it, from above, from the side"
        )
    say(f"  {_shown(done.prisms)}  the log with everything; Foxglove and Lichtblick open it too")
    say(f"  {_shown(done.flight)}  the log of the flight alone, as a drone would record it")
    say()
    say("Next:")
    say(f"  companion info {_shown(done.prisms)}")
    say(f"  companion replay {_shown(done.flight)} -o again.mcap   the same again, byte for byte")
    say("  companion import FOLDER -o my.mcap   a recording of your own (docs/import.md)")


def _shown(path: Path) -> str:
    """Relative where that is shorter to type."""
    relative = os.path.relpath(path)
    return relative if not relative.startswith("..") else str(path)


def _json(done: Demo, problems: list[str]) -> dict[str, Any]:
    return {
        "flight": str(done.flight),
        "prisms": str(done.prisms),
        "page": str(done.views.page) if done.views.page else None,
        "pictures": [str(p) for p in done.views.pictures],
        "frames": done.frames,
        "duration_s": round(done.duration_s, 3),
        **done.replay.tally.as_json(),
        "problems": problems,
    }
