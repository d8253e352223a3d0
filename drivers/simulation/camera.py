"""A simulated camera on the real clock: an endless flight seen by one camera, each frame rendered once.

Opening renders what was never rendered, for RENDER_S at most; the rest is rendered when its turn comes, frames being
left out meanwhile, as by a camera that is slow."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from core.types import CameraInfo, DepthFrame, is_measured

from ..base import DeviceLost, DeviceNotFound
from .flight import Rates, SimulatedFlight
from .frame_store import DepthMm, FrameStore
from .looping_flight import NS, LoopingFlight

RENDER_S = 20.0
AHEAD_NS = 1_000_000
"""So long before a frame arrives it is fetched from the file into the process's own memory, where a device would have put
it: not after its arrival, which would count as latency."""
_SEQUENCES = 1 << 32
_RENDERERS = (
    "flight",
    "flight_path",
    "flights",
    "movers",
    "ray_caster",
    "scene_library",
    "scenes",
    "sensor_model",
    "source",
)
"""The modules that decide what a frame looks like: after a change in one of them frames are rendered again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """How a camera is simulated."""

    fps: float = 30.0
    seed: int = 0
    latency_s: float = 0.0  # from exposure to arrival
    cable: Path | None = None  # a file, and while it is not there the camera is unplugged (None: always plugged in)
    folder: Path | None = None  # where rendered frames are kept (None: in memory)
    render: str = "depth"  # "depth" or "stereo"
    disparities: int = 96  # searched in stereo
    mark_smooth: bool = False  # see MatchParams


class SimulatedDepthSource:
    """DepthSource. clock_ns: the monotonic clock; pace(seconds): waits, and without one read() answers at once.

    Exposures lie at whole multiples of the frame time since the clock's zero, the sequence counts them from there: a
    camera that is opened again goes on where it would be. The frame time is fps, rounded so that a leg of the flight
    holds a whole number of frames. Raises ValueError where the frames of a leg take too much room."""

    notice = identity = ""

    def __init__(
        self,
        flight: LoopingFlight,
        info: CameraInfo,
        simulation: Simulation,
        clock_ns: Callable[[], int],
        pace: Callable[[float], None] | None = None,
    ) -> None:
        self._flight, self._simulation = flight, simulation
        self._clock_ns, self._pace = clock_ns, pace
        duration_s = flight.leg_ns / NS
        self._steps = max(1, round(duration_s * simulation.fps))
        rates = Rates(depth_hz=self._steps / duration_s)
        self._renderer = SimulatedFlight(
            flight.plan,
            cameras=(info,),
            seed=simulation.seed,
            rates=rates,
            render=simulation.render,
            disparities=simulation.disparities,
            mark_smooth=simulation.mark_smooth,
        )
        self._info = self._renderer.cameras[0]
        k = info.intrinsics
        self._room = (simulation.folder, self._name(), self._steps + 1, k.height, k.width)
        self._frames: FrameStore | None = None
        self._delivered = -1
        self._ahead: tuple[int, DepthMm | None] = -1, None

    @property
    def info(self) -> CameraInfo:
        """The camera."""
        return self._info

    def open(self) -> None:
        """Renders what is missing. Raises DeviceNotFound while the cable is out."""
        if not self._plugged():
            raise DeviceNotFound(f"simulated camera {self._info.camera}: {self._words()}")
        frames = FrameStore(*self._room)
        until_ns = self._clock_ns() + round(RENDER_S * NS)
        for i in range(self._steps + 1):
            if self._clock_ns() > until_ns:
                break
            self._image(frames, i)
        self._frames = frames
        self._delivered = self._newest()

    def render_all(self, on_progress: Callable[[float], None] = lambda share: None) -> None:
        """Renders the whole flight into the folder, so that `open` has nothing to render. on_progress: takes the completed
        share. Does nothing where frames cannot be kept."""
        frames = FrameStore(*self._room)
        for i in range(self._steps + 1 if frames.kept else 0):
            self._image(frames, i)
            on_progress((i + 1) / (self._steps + 1))

    def close(self) -> None:
        """May be called twice."""
        self._frames = None

    def __enter__(self) -> SimulatedDepthSource:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest frame that has arrived and was not delivered, or None. Raises DeviceLost when the cable is out."""
        if self._frames is None:
            raise DeviceNotFound(f"simulated camera {self._info.camera}: it is not open; call open() first")
        if not self._plugged():
            raise DeviceLost(f"simulated camera {self._info.camera}: {self._words()}")
        if self._newest() <= self._delivered and self._pace is not None and timeout_s > 0.0:
            self._await_next(self._frames, self._clock_ns() + round(timeout_s * NS))
        newest = self._newest()
        if newest <= self._delivered:
            return None
        self._delivered = newest
        count, depth_mm = self._ahead
        if count != newest:
            depth_mm = self._image(self._frames, self._on_path(newest))
        if depth_mm is None:
            return None
        return DepthFrame(
            camera=self._info.camera,
            sequence=newest % _SEQUENCES,
            t_exposure_ns=self._exposure_ns(newest),
            t_arrival_ns=self._clock_ns(),
            depth_mm=_of_leg(depth_mm, newest // self._steps),
        )

    def _await_next(self, frames: FrameStore, until_ns: int) -> None:
        """Waits for the next frame's arrival, until then at most; meanwhile it is fetched, where it was rendered before."""
        assert self._pace is not None
        count = self._delivered + 1
        due_ns, i = self._exposure_ns(count) + round(self._simulation.latency_s * NS), self._on_path(count)
        for at_ns in (due_ns - AHEAD_NS, due_ns):
            self._pace(max(0, min(at_ns, until_ns) - self._clock_ns()) / NS)
            if at_ns > until_ns:
                return
            if self._ahead[0] != count and frames.holds(i):
                depth_mm = frames.get(i)
                self._ahead = count, None if depth_mm is None else depth_mm.copy()

    def _exposure_ns(self, count: int) -> int:
        """Of the count-th exposure since the clock's zero."""
        return -(-count * self._flight.leg_ns // self._steps)

    def _newest(self) -> int:
        """The newest exposure that has arrived by now."""
        return (self._clock_ns() - round(self._simulation.latency_s * NS)) * self._steps // self._flight.leg_ns

    def _on_path(self, count: int) -> int:
        """Which of the leg's frames an exposure shows: there 0, 1 ... steps, back steps - 1 ... 1."""
        i = count % (2 * self._steps)
        return i if i <= self._steps else 2 * self._steps - i

    def _image(self, frames: FrameStore, i: int) -> DepthMm | None:
        """Frame i of the leg, rendered now where it never was; None: the flight has none there."""
        if not frames.holds(i):
            frame = self._renderer.frame(i)
            frames.put(i, frame.depth_mm if frame is not None else None)
        return frames.get(i)

    def _name(self) -> str:
        """The same only for the same frames, bit for bit."""
        plan = self._flight.plan
        content = [asdict(self._info), self._simulation.seed, self._steps, plan.name, self._flight.leg_ns]
        content.append(asdict(plan.sensor))
        modules = [Path(__file__).with_name(f"{module}.py") for module in _RENDERERS]
        if self._simulation.render == "stereo":
            content += [self._simulation.render, self._simulation.disparities, self._simulation.mark_smooth]
            modules += sorted(Path(__file__).with_name("stereo").glob("*.py"))
            modules += sorted(Path(__file__).parents[1].joinpath("cameras").glob("*match*.py"))
            modules.append(Path(__file__).parents[1] / "cameras" / "stereo.py")
        digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode())
        for module in modules:
            digest.update(module.read_bytes())
        return f"{self._flight.plan.name}-{digest.hexdigest()[:16]}"

    def _plugged(self) -> bool:
        return self._simulation.cable is None or self._simulation.cable.exists()

    def _words(self) -> str:
        return f"unplugged, since {self._simulation.cable} does not exist; make the file to plug it in"


def _of_leg(depth_mm: DepthMm, leg: int) -> DepthMm:
    """The image with one measured pixel changed by 1 mm, another one for each leg: no two images of a live camera are equal, and
    the images of a leg are delivered again in the next ones."""
    out = depth_mm.copy()
    measured = np.flatnonzero(is_measured(out))
    if len(measured):
        out.ravel()[measured[leg % len(measured)]] ^= 1
    return out
