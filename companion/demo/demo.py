"""`companion demo`: flies the live service in a simulation, then draws its log."""

from __future__ import annotations

import argparse
import dataclasses
import os
import shutil
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers.base import DeviceNotFound
from drivers.simulation.camera import SimulatedDepthSource

from ..argument_types import number_in
from ..cameras.factory import make_source
from ..common_options import add_config, add_replace
from ..config.camera import CameraConfig
from ..config.loader import Config, load_config
from ..config.service import AutopilotConfig, RecordParams, SupervisorParams
from ..console import counted, fail, print_json, print_line, progress, warn
from ..kernels.compilation import WarmupError
from ..kernels.warmup import ensure_compiled
from ..live.message_json import message_json
from ..live.status import status_lines
from ..packaged import packaged_file
from ..pipeline.sync import DropCause
from ..replay.replay import Options, replay
from ..replay.replay_report import Replay
from ..viewer.png import drawing_library
from ..viewer.view import ViewOptions, Views, make_views
from ..whole_file import refuse_existing
from .live import DemoError, LiveRun, fly
from .sole_use import sole_use

OUTPUT, LOG, VIEW = Path("demo-out"), "prisms.mcap", "view"
CAMERA = CameraConfig(name="front", kind="simulated", flight="demo", width_px=640, fps=30.0, seed=0)
EMBEDDED = Config(
    cameras=(CAMERA,),
    autopilot=AutopilotConfig(address="udpin:127.0.0.1:14540"),
    supervision=SupervisorParams(open_s=300.0),
    record=RecordParams(record="off"),
)
"""The embedded default, equal to configs/simulated.toml."""
MAX_FPS = 15.0
"""Largest frame rate in the page, which limits its size."""
SECONDS, FAST_SECONDS, FAST_WIDTH_PX = 10.0, 3.0, 320
PICTURES = 4
BUSY_SHARE = 0.1
"""Skipped frames over used ones from which the summary names the load of the computer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoOptions:
    """Options of the demo."""

    folder: Path = OUTPUT  # output directory
    seconds: float = SECONDS
    width_px: int | None = None  # None: as configured
    config: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Demo:
    """The results."""

    log: Path  # of the service
    live: LiveRun
    replay: Replay  # of that log, compared with the recorded results
    views: Views


def demo_config(config: Config, options: DemoOptions) -> Config:
    """The configuration for the flight. Raises ValueError without a simulated camera."""
    simulated = [c for c in config.cameras if c.kind == "simulated"]
    if not simulated:
        raise ValueError(
            'the configuration has no camera of kind = "simulated"; use for example '
            f"{_shown(packaged_file('configs', 'simulated.toml'))}"
        )
    cameras = tuple(replace(c, width_px=options.width_px or c.width_px, fps=min(c.fps, MAX_FPS)) for c in simulated)
    return replace(config, cameras=cameras)


def demo(options: DemoOptions, bar: Callable[[str], Any]) -> Demo:
    """Flies, replays and draws. bar: a context manager that gives a Progress for a label. Raises the exceptions of
    these stages."""
    config = load_config(options.config) if options.config is not None else EMBEDDED
    config = demo_config(config, options)
    options.folder.mkdir(parents=True, exist_ok=True)
    with sole_use(options.folder):
        return _demo(config, options, bar)


def _demo(config: Config, options: DemoOptions, bar: Callable[[str], Any]) -> Demo:
    ensure_compiled("extractor", "simulated")
    with bar("rendering the simulated flight, once") as on:
        _render(config, on)
    with bar(f"flying for {options.seconds:g} s: service, autopilot and planner, each in a process of its own") as on:
        live = fly(config, options.folder, options.seconds, on)
    log = options.folder / LOG
    if log.exists():
        _delete_pictures(options.folder / VIEW)  # of the log that is replaced
    live.log.replace(log)
    live.log.parent.rmdir()
    with bar("replaying the log and comparing it bit for bit") as on:
        result = replay(log, Options(check=True), on)
    with bar("drawing") as on:
        every = max(1, result.counts.frames // PICTURES)
        missing = ""
        try:
            drawing_library()
        except DeviceNotFound as error:
            missing = str(error)
        views = make_views(log, options.folder / VIEW, ViewOptions(every=every, png=not missing), on)
    if missing:
        views.notes.append(missing)
    return Demo(log=log, live=live, replay=result, views=views)


def _delete_pictures(folder: Path) -> None:
    """Deletes the pictures of an earlier flight, whose names contain the numbers of its frames."""
    for picture in folder.glob("frame_*.png"):
        picture.unlink()


def _render(config: Config, on_progress: Callable[[float], None]) -> None:
    """Renders what the cameras will show: on a slow computer it takes longer than a camera has to open."""
    for camera in config.cameras:
        source = make_source(camera)
        if isinstance(source, SimulatedDepthSource):
            source.render_all(on_progress)


def demo_problems(done: Demo) -> list[str]:
    """The problems, as text. Blind frames before the clocks are synchronised are expected."""
    problems = [done.replay.damage] if done.replay.damage else []
    comparison = done.replay.comparison
    if comparison is not None and not comparison.passed:
        problems.append(f"the replay differs from the recorded results: run `companion replay {done.log} --check`")
    if not done.replay.counts.valid:
        problems.append("the replay has no valid frame")
    if not done.live.received.valid:
        problems.append("the subscriber received no valid frame")
    return problems


def add_parser(subparsers: Any) -> None:
    """The command line of `companion demo`."""
    parser = subparsers.add_parser("demo")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help=f"directory for log, pictures and page (default: {OUTPUT}, whose files are replaced)",
    )
    add_replace(parser)
    add_config(parser, "configuration with a simulated camera (default: the demo flight)")
    parser.add_argument(
        "--seconds",
        type=number_in(float, 1.0, 600.0),
        metavar="S",
        help=f"duration of the flight (default: {SECONDS:g} s)",
    )
    parser.add_argument(
        "--fast", action="store_true", help=f"fly {FAST_SECONDS:g} s with images {FAST_WIDTH_PX} pixels wide"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: success; 1: a problem was found."""
    seconds = args.seconds or (FAST_SECONDS if args.fast else SECONDS)
    width_px = FAST_WIDTH_PX if args.fast else None
    if args.output is not None:
        refuse_existing(args.output / LOG, replace=args.replace)
    args.output = args.output or OUTPUT
    options = DemoOptions(folder=args.output, config=args.config, seconds=seconds, width_px=width_px)
    try:
        done = demo(options, progress if args.json else _announced)
    except (WarmupError, DemoError) as error:
        fail(str(error))
        return 1
    problems = demo_problems(done)
    if args.json:
        print_json(_json(done, problems))
    else:
        _print_summary(done)
        _print_next(done)
    for note in done.views.notes:
        warn(note)
    for problem in problems:
        fail(problem)
    return 1 if problems else 0


def _announced(label: str) -> Any:
    """A progress bar, and a printed line where no terminal shows it."""
    print_line(f"- {label} ...")
    return progress(label)


def _print_summary(done: Demo) -> None:
    """Prints the state of the service and what the planner and the replay found."""
    received, counts = done.live.received, done.replay.counts
    valid = max(1, counts.valid)
    print_line()
    print_line("State of the service at the end of the flight, as printed by `companion status`:")
    for line in status_lines(done.live.health):
        print_line(f"  {line}")
    print_line()
    print_line(
        f"A planner in another process received {counted(received.messages, 'message')}: {received.valid} with obstacles and "
        "free space,"
    )
    ages = f"{received.age_ms[0]:.0f} ms after the exposure in the median and {received.age_ms[1]:.0f} ms for 99 of 100"
    print_line(f"{ages};")
    blind = ", ".join(f"{n} ({text})" for text, n in received.texts.items()) or "none"
    print_line(
        f"blind messages (valid = false), sent while no recent frame is valid, as before the first one: {blind}."
    )
    skipped, used = done.live.health.frames_dropped.get(DropCause.BUSY.value, 0), done.live.health.frames_used
    if skipped > BUSY_SHARE * used:
        print_line(
            f"This computer was busy: {skipped} of {skipped + used} frames were skipped for newer ones. Delays and faults "
            "above can be due to that."
        )
    print_line(
        f"On average a frame has {counts.planes / valid:.0f} vertical planes in {counts.prisms / valid:.0f} prisms."
    )
    comparison = done.replay.comparison
    if comparison is not None and comparison.passed:
        print_line("Replaying the log gave the same prisms bit for bit.")


def _print_next(done: Demo) -> None:
    """Prints the paths of the results, and the commands to try next."""
    print_line()
    print_line("Look at:")
    if done.views.page is not None:
        print_line(f"  {_shown(done.views.page)}  obstacles in 3-D: open it in a browser")
    if done.views.pictures:
        folder = _shown(done.views.pictures[0].parent)
        print_line(
            f"  {folder}/*.png  {len(done.views.pictures)} pictures: depth image with planes, top view, side view"
        )
    print_line(f"  {_shown(done.log)}  log of the flight; Foxglove and Lichtblick can open it")
    if done.views.layout is not None:
        print_line(f"  {_shown(done.views.layout)}  layout for Foxglove and Lichtblick: import it first")
    print_line()
    print_line("Next:")
    if (scripts := scripts_outside_path()) is not None:
        print_line(f"  . {_shown(scripts / 'activate')}   puts the command `companion` into the path of this terminal")
    print_line(f"  companion info {_shown(done.log)}")
    shipped = _shown(packaged_file("configs", "simulated.toml"))
    print_line(f"  companion run -c {shipped}   run the same service until you stop it with Ctrl-C, and beside it")
    print_line(f"  companion simulate-autopilot -c {shipped}   its attitude: the service is blind without it")
    print_line("  companion view --live   page that follows the service")
    page = _shown(packaged_file("docs/how-to", "import-recordings.md"))
    print_line(f"  companion import FOLDER -o my.mcap   convert a recording of your own ({page})")


def scripts_outside_path() -> Path | None:
    """The folder of this environment's commands where the shell does not find them."""
    scripts = Path(sysconfig.get_path("scripts"))
    return scripts if shutil.which("companion") is None and (scripts / "activate").exists() else None


def _shown(path: Path) -> str:
    """The path, relative where that is shorter."""
    relative = os.path.relpath(path)
    return relative if not relative.startswith("..") else str(path)


def _json(done: Demo, problems: list[str]) -> dict[str, Any]:
    return {
        "prisms": str(done.log),
        "page": str(done.views.page) if done.views.page else None,
        "pictures": [str(p) for p in done.views.pictures],
        "duration_s": done.live.duration_s,
        "subscriber": dataclasses.asdict(done.live.received),
        "troubles": list(done.live.health.troubles),
        "diagnostics": [message_json(d) for d in done.live.health.diagnostics],
        **done.replay.counts.as_json(),
        "problems": problems,
    }
