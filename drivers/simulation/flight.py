"""A simulated flight as a recording; `drivers.simulation.camera` is a camera that flies it on a clock.

from drivers.simulation.flight import SimulatedFlight
flight = SimulatedFlight("demo", width=320, height=240)
for event in flight.events(): ...   # DepthFrame, AttitudeSample, PoseSample in order of arrival

Attitude, rates, position and velocity are the true ones at their stamps, on the companion's clock; only their arrival is late. An
exposure is an instant. Errors of mount, clock and noise of the velocity are put in by the benchmarks that study them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical
from core.types import UNKNOWN_MM, AttitudeSample, CameraInfo, DepthFrame, PoseSample

from ..base import Event
from .flight_path import VehicleState
from .flights import FlightPlan, Span, flight_plan
from .movers import moved
from .sensor_model import generator, measure
from .source import Floats, Truth, camera_info, look

if TYPE_CHECKING:
    from .stereo.flight_depth import RenderedDepth

RENDERINGS = ("depth", "stereo")
"""Where the depth of a simulated camera comes from."""
_STREAMS = {"attitude": 1_000_001, "pose": 1_000_002, "depth": 1_000_003}
"""Frame numbers that no frame has: they key the jitter of the arrivals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """How often things are sampled and how long they take to arrive: latency plus 0..jitter, seconds."""

    depth_hz: float = 10.0
    attitude_hz: float = 50.0
    pose_hz: float = 30.0
    depth_latency_s: float = 0.045
    attitude_latency_s: float = 0.006
    pose_latency_s: float = 0.012
    jitter_s: float = 0.006

    def __post_init__(self) -> None:
        for name in ("depth_hz", "attitude_hz", "pose_hz"):
            if not 0.1 <= getattr(self, name) <= 1000.0:
                raise ValueError(f"simulated flight: {name}={getattr(self, name):g}, expected 0.1..1000")
        for name in ("depth_latency_s", "attitude_latency_s", "pose_latency_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) <= 10.0:
                raise ValueError(f"simulated flight: {name}={getattr(self, name):g}, expected 0..10")


class SimulatedFlight:
    """A flight whose events come in the order of their arrival on board (EventSource), with truth at any
    instant.

    Same arguments, same events, bit for bit. Frames are rendered when they are asked for."""

    def __init__(
        self,
        plan: FlightPlan | str = "demo",
        *,
        width: int = 640,
        height: int = 480,
        cameras: tuple[CameraInfo, ...] | None = None,
        seed: int = 0,
        rates: Rates | None = None,
        start_ns: int = 10_000_000_000,
        duration_s: float | None = None,
        render: str = "depth",
        disparities: int = 96,
        mark_smooth: bool = False,
    ) -> None:
        """plan: a flight or its name. cameras: several of them, or one of another kind than width x height,
        forward. start_ns: the instant of the start. duration_s: ends the flight earlier. render: "depth" (ray caster
        with a noise model) or "stereo" (matched image pairs, `disparities` searched; mark_smooth: smooth pixels are marked, see MatchParams). Raises ValueError."""
        self.plan = flight_plan(plan, seed) if isinstance(plan, str) else plan
        ke = max(self.plan.sensor.ke_per_m, 1e-5)
        described = cameras or (camera_info(width, height, ke_per_m=ke),)
        self._cameras = tuple(replace(c, marks_smooth=render == "stereo" and mark_smooth) for c in described)
        if len({c.camera for c in self._cameras}) != len(self._cameras):
            raise ValueError("simulated flight: two cameras have the same name; give each its own")
        self._seed, self._rates, self.start_ns = seed, rates or Rates(), start_ns
        self.duration_s = self.plan.path.duration_s if duration_s is None else duration_s
        if render not in RENDERINGS:
            raise ValueError(f"simulated flight: render={render!r}, expected one of {', '.join(RENDERINGS)}")
        self._stereo: RenderedDepth | None = None
        if render == "stereo" and len(self.plan.scene.velocity_m_s):
            raise ValueError(f'simulated flight {self.plan.name}: moving obstacles need render="depth"')
        if render == "stereo":  # its kernels and OpenCV are loaded only where they are used
            from .stereo.flight_depth import RenderedDepth

            self._stereo = RenderedDepth(self.plan.scene, disparities=disparities, mark_smooth=mark_smooth)
        if not self.duration_s > 0.0:
            raise ValueError(f"simulated flight: duration_s={self.duration_s:g}, expected more than 0")

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """All cameras of the vehicle."""
        return self._cameras

    def state(self, t_ns: int) -> VehicleState:
        """The true state of the vehicle at an instant."""
        return self.plan.path.at((t_ns - self.start_ns) * 1e-9)

    def camera_pose(self, camera: CameraInfo, t_ns: int) -> tuple[Floats, Floats]:
        """(R_ned_optical (3, 3), position_ned_m (3,)) of a camera at an instant."""
        state, mount = self.state(t_ns), camera.mount
        R = state.R_ned_frd
        at = np.array(state.position_ned_m) + R @ np.array([mount.x_m, mount.y_m, mount.z_m])
        return R @ rotation_frd_optical(mount), at

    def truth(self, camera: CameraInfo, t_ns: int) -> Truth:
        """What the camera would see at an instant without any fault."""
        R, at = self.camera_pose(camera, t_ns)
        return look(moved(self.plan.scene, (t_ns - self.start_ns) * 1e-9), camera, R, at)

    def frame_count(self) -> int:
        """Exposures of each camera, among them those that never arrive."""
        return int(self.duration_s * self._rates.depth_hz) + 1

    def arrival_ns(self, index: int, camera_number: int = 0) -> int:
        """When frame `index` of a camera arrives, in nanoseconds."""
        rng = generator(self._seed * 64 + camera_number, _STREAMS["depth"] + 16 * index)
        return self._exposure_ns(index) + _ns(self._rates.depth_latency_s + rng.uniform(0, self._rates.jitter_s))

    def frame(self, index: int, camera_number: int = 0) -> DepthFrame | None:
        """Frame `index` of a camera, or None where the flight plan says that it never arrives."""
        t_ns, info = self._exposure_ns(index), self._cameras[camera_number]
        since, failures = (t_ns - self.start_ns) * 1e-9, self.plan.failures
        if _span(failures.no_frames, since):
            return None
        frozen = _span(failures.frozen, since)
        shown = index
        if frozen is not None:
            shown = int(np.ceil(frozen[0] * self._rates.depth_hz - 1e-9))
        if _span(failures.blind, since):
            k = info.intrinsics
            depth: NDArray[np.uint16] = np.full((k.height, k.width), UNKNOWN_MM, np.uint16)
        else:
            depth = self._depth_mm(info, self._seed * 64 + camera_number, shown)
        return DepthFrame(
            camera=info.camera,
            sequence=index,
            t_exposure_ns=t_ns,
            t_arrival_ns=self.arrival_ns(index, camera_number),
            depth_mm=depth,
        )

    def _depth_mm(self, info: CameraInfo, seed: int, index: int) -> NDArray[np.uint16]:
        """The depth image of an exposure."""
        t_ns = self._exposure_ns(index)
        if self._stereo is not None:
            return self._stereo.depth_mm(info, *self.camera_pose(info, t_ns), seed, index)
        sensor = self.plan.sensor.scaled_to(info.intrinsics.width)
        return measure(self.truth(info, t_ns).depth_m, info, sensor, seed, index)

    def attitudes(self) -> list[AttitudeSample]:
        """All attitude samples in order of arrival."""
        samples = []
        for t_ns, arrival_ns in self._stamps("attitude", self._rates.attitude_hz, self._rates.attitude_latency_s):
            if not _span(self.plan.failures.no_attitude, (t_ns - self.start_ns) * 1e-9):
                s = self.state(t_ns)
                samples.append(AttitudeSample(t_ns, arrival_ns, s.q_ned_frd_wxyz, s.rates_frd_rad_s))
        return samples

    def poses(self) -> list[PoseSample]:
        """All pose samples in order of arrival."""
        samples = []
        for t_ns, arrival_ns in self._stamps("pose", self._rates.pose_hz, self._rates.pose_latency_s):
            s = self.state(t_ns)
            samples.append(PoseSample(t_ns, arrival_ns, s.position_ned_m, s.velocity_ned_m_s))
        return samples

    def events(self) -> Iterator[Event]:
        """Everything in order of arrival."""
        samples: list[AttitudeSample | PoseSample] = [*self.attitudes(), *self.poses()]
        # the second entry keeps the order of equal arrivals the same on every machine
        schedule: list[tuple[int, int, AttitudeSample | PoseSample | tuple[int, int]]] = [
            (s.t_arrival_ns, i, s) for i, s in enumerate(samples)
        ]
        for camera in range(len(self._cameras)):
            for index in range(self.frame_count()):
                schedule.append((self.arrival_ns(index, camera), len(schedule), (index, camera)))
        for _, _, item in sorted(schedule, key=lambda entry: entry[:2]):
            if not isinstance(item, tuple):
                yield item
                continue
            frame = self.frame(*item)
            if frame is not None:
                yield frame

    def _exposure_ns(self, index: int) -> int:
        return self.start_ns + _ns(index / self._rates.depth_hz)

    def _stamps(self, stream: str, rate_hz: float, latency_s: float) -> list[tuple[int, int]]:
        """(t_ns, t_arrival_ns) from one period before the start to one after the end; a later sample never
        overtakes an earlier one, as on a serial line."""
        rng = generator(self._seed, _STREAMS[stream])
        count, last, stamps = int(self.duration_s * rate_hz) + 3, 0, []
        for i, jitter in enumerate(rng.uniform(0.0, self._rates.jitter_s, count)):
            t_ns = self.start_ns + _ns((i - 1) / rate_hz)
            last = max(last + 1, t_ns + _ns(latency_s + float(jitter)))
            stamps.append((t_ns, last))
        return stamps


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _span(spans: tuple[Span, ...], t_s: float) -> Span | None:
    """The span that holds t_s."""
    return next((s for s in spans if s[0] <= t_s < s[1]), None)
