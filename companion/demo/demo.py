"""Flies the live service in a simulation, replays its log and draws it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers.base import DeviceNotFound
from drivers.simulation.camera import SimulatedDepthSource

from ..cameras.factory import make_source
from ..config.camera import CameraConfig
from ..config.loader import Config, load_config
from ..config.service import AutopilotConfig, RecordParams, SupervisorParams
from ..kernels.warmup import ensure_compiled
from ..packaged import packaged_file
from ..replay.replay import Options, replay
from ..replay.replay_report import Replay
from ..viewer.png import drawing_library
from ..viewer.view import ViewOptions, Views, make_views
from .live import LiveRun, fly
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
SECONDS = 10.0
PICTURES = 4


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
            f"{shown(packaged_file('configs', 'simulated.toml'))}"
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


def shown(path: Path) -> str:
    """The path, relative where that is shorter."""
    relative = os.path.relpath(path)
    return relative if not relative.startswith("..") else str(path)
