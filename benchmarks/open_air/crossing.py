"""Closed loops of rendered stereo, matching, pipeline, obstacle output and an autopilot model.

    python -m benchmarks.open_air.crossing
    python -m benchmarks.open_air.crossing --flights balloon,pillar --autopilots ArduPilot

`field` and `between_trees` cross 60 m of field, without trees and between trees; all others fly towards a blank thing. Each vehicle flies north at a constant height with
the stick held, leans as its acceleration demands, and gets OBSTACLE_DISTANCE as the service sends it. PX4 has CP_GO_NO_DATA = 0.
The mount counts as measured ([open_sky] mount_measured): nothing turns. A stop is a fall of the speed below STOPPED_M_S."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.free_space.volume import first_solids
from benchmarks.open_air.open_claims import marked
from benchmarks.open_air.view_options import words
from benchmarks.open_air.views import profile_of
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import obstacle_distance_message
from companion.autopilot.obstacle_report import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, quaternion_from_euler, rotation_from_euler
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4_position_mode import PositionMode, position_mode
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_profiles import StereoCamera, StereoProfile
from drivers.simulation.stereo.stereo_scenes import StereoScene, surfaces_of

NS, MS = 1_000_000_000, 1_000_000
TICK_NS, FRAME_NS, DECIDE_NS, LATE_NS = 20 * MS, 100 * MS, 60 * MS, 70 * MS
"""Step of the models, period of frames, of messages, and time from exposure to result."""
WANTED_M_S, STOPPED_M_S, MOVING_M_S = 4.0, 0.3, 1.0
CROSSING_M, MARGIN_M, HEIGHT_M = 60.0, 3.0, 2.0
GRAVITY_M_S2, DRAG_RAD_PER_M_S = 9.81, math.radians(1.0)
ACCELERATION_M_S2 = 2.5
AVOID = AvoidParams(max_distance_m=10.0)
AUTOPILOTS = ("PX4", "ArduPilot")
PRESUME = OpenSkyParams(mode="presume", mount_measured=True)


@dataclass(slots=True)
class Flown:
    """One flight. stops: times that the speed fell below STOPPED_M_S; clearance_m: least distance ahead to a solid at the height of
    the camera; open_frames: frames with any open range; first_stop_m: place of the first stop, nan: none."""

    distance_m: float = 0.0
    seconds: float = 0.0
    stops: int = 0
    clearance_m: float = math.inf
    fastest_m_s: float = 0.0
    open_frames: int = 0
    frames: int = 0
    first_stop_m: float = math.nan


@dataclass(slots=True)
class Px4Vehicle:
    """PX4 in Position mode with the stick held forward."""

    mode: PositionMode = field(default_factory=lambda: position_mode((1, 15), MARGIN_M))

    def read(self, message: object, now_ns: int) -> None:
        """Takes a message."""
        self.mode.reader.read(message, now_ns)

    def step(self, dt_s: float, now_ns: int) -> tuple[float, float]:
        """(position in m, speed in m/s), north, after a step."""
        stick = np.array([WANTED_M_S / self.mode.params.mpc_vel_manual_m_s, 0.0])
        self.mode.step(stick, dt_s, now_ns)
        return float(self.mode.position_m[0]), float(self.mode.velocity_m_s[0])


@dataclass(slots=True)
class CopterVehicle:
    """ArduCopter in LOITER with the stick held forward: its speed follows what simple avoidance allows."""

    reader: ArduPilotReader = field(default_factory=lambda: ArduPilotReader(margin_m=MARGIN_M))
    x_m: float = 0.0
    speed_m_s: float = 0.0

    def read(self, message: object, now_ns: int) -> None:
        """Takes a message."""
        self.reader.read(message, now_ns)

    def step(self, dt_s: float, now_ns: int) -> tuple[float, float]:
        """(position in m, speed in m/s), north, after a step."""
        wanted = self.reader.velocity_m_s((WANTED_M_S, 0.0), now_ns)[0] if self.reader.healthy(now_ns) else 0.0
        change = ACCELERATION_M_S2 * dt_s
        self.speed_m_s += max(-1.5 * change, min(change, wanted - self.speed_m_s))
        self.x_m += self.speed_m_s * dt_s
        return self.x_m, self.speed_m_s


def unmatched_columns(profile: StereoProfile) -> NDArray[np.bool_]:
    """(H, W) the pixels at both sides that never have a match, as the service leaves them out of what a camera covers."""
    k = profile.view.intrinsics
    out = np.zeros((k.height, k.width), np.bool_)
    out[:, : profile.unmatched_left_px] = True
    out[:, k.width - profile.unmatched_right_px :] = True
    return out


class CrossingLoop:
    """One vehicle in made-up time. `run` flies; flown: what happened."""

    def __init__(
        self, scene: StereoScene, autopilot: str, profile: str = "zed", seed: int = 0, open_sky: OpenSkyParams = PRESUME
    ) -> None:
        self.scene, self.autopilot, self.seed = scene, autopilot, seed
        self.vehicle: Px4Vehicle | CopterVehicle = Px4Vehicle() if autopilot == "PX4" else CopterVehicle()
        self._now = (
            AutopilotNow(kind="PX4", cp_dist_m=MARGIN_M)
            if autopilot == "PX4"
            else AutopilotNow(kind="ArduPilot", margin_m=MARGIN_M)
        )
        self._camera = StereoCamera(marked(profile_of(profile)))
        self._info = self._camera.profile.info()
        extractor = Extractor(Params(), open_sky)
        self._pipeline = Pipeline((self._info,), lambda info: extractor)
        self._builder = ObstacleReportBuilder(AVOID, (self._info.camera,), 0.3, open_counts=open_sky.presumes)
        self._builder.announce(self._info, unmatched_columns(self._camera.profile))
        self.flown = Flown()
        self.now_ns, self._frame, self._pitch_rad = 100 * NS, 0, 0.0
        self._x_m, self._speed_m_s, self._moving = 0.0, 0.0, False
        self._later: list[tuple[int, Callable[[], None]]] = []

    def run(self, seconds: float, until_m: float = math.inf, still_s: float = math.inf) -> Flown:
        """Flies for so long, to this distance, or until it has stood for still_s."""
        end_ns, stood_ns = self.now_ns + round(seconds * NS), 0
        while self.now_ns < end_ns and self._x_m < until_m and stood_ns < still_s * NS:
            self._tick()
            stands = self._speed_m_s < STOPPED_M_S and self.flown.fastest_m_s > MOVING_M_S
            stood_ns = stood_ns + TICK_NS if stands else 0
        return self.flown

    def _tick(self) -> None:
        self.now_ns += TICK_NS
        before = self._speed_m_s
        self._x_m, self._speed_m_s = self.vehicle.step(TICK_NS / NS, self.now_ns)
        wanted = -math.atan((self._speed_m_s - before) / (TICK_NS / NS) / GRAVITY_M_S2)
        self._pitch_rad += 0.1 * (wanted - DRAG_RAD_PER_M_S * self._speed_m_s - self._pitch_rad)
        self._note()
        t_ns = self.now_ns
        place = (self._x_m, 0.0, -HEIGHT_M)
        samples: list[AttitudeSample | PoseSample] = [
            AttitudeSample(t_ns, t_ns, quaternion_from_euler(0.0, self._pitch_rad, 0.0), (0.0, 0.0, 0.0)),
            PoseSample(t_ns, t_ns, place, (self._speed_m_s, 0.0, 0.0)),
        ]
        for sample in samples:
            self._pipeline.handle(sample)
        self._builder.samples(samples)
        for _, act in [due for due in self._later if due[0] <= t_ns]:
            act()
        self._later = [due for due in self._later if due[0] > t_ns]
        if t_ns % FRAME_NS == 0:
            self._expose()
        if t_ns % DECIDE_NS == 0:
            report = self._builder.decide(self._now, t_ns)
            if report.values is not None:
                self.vehicle.read(obstacle_distance_message(report.values, 0, AVOID), t_ns)

    def _note(self) -> None:
        flown = self.flown
        flown.distance_m, flown.seconds = self._x_m, flown.seconds + TICK_NS / NS
        flown.fastest_m_s = max(flown.fastest_m_s, self._speed_m_s)
        if self._speed_m_s > MOVING_M_S:
            self._moving = True
        elif self._moving and self._speed_m_s < STOPPED_M_S:
            self._moving = False
            flown.stops += 1
            if flown.stops == 1:
                flown.first_stop_m = self._x_m
        flown.clearance_m = min(flown.clearance_m, self._ahead_m())

    def _ahead_m(self) -> float:
        """Distance ahead to the first solid over the width and height of the vehicle."""
        y, z = (a.ravel() for a in np.meshgrid((-AVOID.radius_m, 0.0, AVOID.radius_m), (-0.2, 0.0, 0.2)))
        origins = np.column_stack([np.full(len(y), self._x_m), y, z - HEIGHT_M])
        ahead = np.tile([1.0, 0.0, 0.0], (len(y), 1))
        ranges, _ = first_solids(self.scene.scene, False, origins, ahead, np.zeros(len(y)), np.full(len(y), 20.0), 0.0)
        return float(ranges.min())

    def _expose(self) -> None:
        number, t_ns = self._frame, self.now_ns
        self._frame += 1
        R = rotation_from_euler(0.0, self._pitch_rad, 0.0) @ R_CAMFRD_OPTICAL
        pair = self._camera.pair(self.scene, R, np.array([self._x_m, 0.0, -HEIGHT_M]), self.seed, number)
        depth_mm = self._camera.depth_of(pair)

        def arrive() -> None:
            frame = DepthFrame(
                camera=self._info.camera,
                sequence=number,
                t_exposure_ns=t_ns,
                t_arrival_ns=self.now_ns,
                depth_mm=depth_mm,
            )
            for output in self._pipeline.handle(frame):
                if isinstance(output, PrismsResult):
                    self._builder.result(output)
                    self._count(output)

        self._later.append((t_ns + LATE_NS, arrive))

    def _count(self, result: PrismsResult) -> None:
        self.flown.frames += 1
        if result.valid and result.model is not None and result.model.free.has_open:
            self.flown.open_frames += 1


def scene_of(name: str, seed: int = 0, sky: str = "clear") -> StereoScene:
    """The field, with trees beside the way or without, or a blank thing in the way, 16 m ahead. Raises ValueError for a name that does not exist."""
    s = SceneBuilder(name)
    s.ground()
    rng = np.random.Generator(np.random.PCG64([seed, 7]))
    if name == "between_trees":
        for i in range(8):
            x, side = 4.0 + 8.0 * i, -1.0 if i % 2 else 1.0
            s.tree(f"tree {i}", x, side * (7.0 + rng.uniform(0.0, 2.0)), rng.uniform(6.0, 9.0), 1.8, 500, rng)
    elif name == "field":
        pass
    elif name == "container":
        s.box("container", 17.25, 0.0, 2.5, 6.0, 6.0, 0.1)
    elif name == "wall":
        s.wall("blank wall", (16.0, -30.0), (16.0, 30.0), 8.0)
    elif name == "pillar":
        s.pole("pillar", 16.0, 0.1, 0.5, 10.0)
    elif name == "balloon":
        s.sphere("balloon", 16.0, 0.0, HEIGHT_M, 0.6)
    elif name == "overhang":
        s.box("overhang", 16.0, 0.0, 2.0, 5.0, 0.8, base=HEIGHT_M - 0.3)
    elif name == "bridge":
        s.box("bridge", 16.0, 0.0, 3.0, 60.0, 1.2, 0.1, base=HEIGHT_M - 0.4)
    else:
        raise ValueError(f"no flight {name!r}; there are: {', '.join(FLIGHTS)}")
    return StereoScene(name=name, surfaces=surfaces_of(s.build()), sky=SKIES[sky])


CROSSINGS = ("field", "between_trees")
FLIGHTS = (*CROSSINGS, "container", "wall", "pillar", "balloon", "overhang", "bridge")


def fly(name: str, autopilot: str, seconds: float = 40.0, seed: int = 0, sky: str = "clear") -> Flown:
    """One flight: across the field, or towards a blank thing until the vehicle has stood for a second."""
    loop, crosses = CrossingLoop(scene_of(name, seed, sky), autopilot, seed=seed), name in CROSSINGS
    return loop.run(seconds, CROSSING_M if crosses else 24.0, math.inf if crosses else 1.0)


def row(name: str, autopilot: str, f: Flown) -> str:
    """A row of the table."""
    clearance = f"{f.clearance_m:.2f}" if math.isfinite(f.clearance_m) else ""
    share = 100.0 * f.open_frames / max(1, f.frames)
    cells = (
        name,
        autopilot,
        f"{f.distance_m:.1f}",
        f"{f.seconds:.1f}",
        f"{f.fastest_m_s:.1f}",
        str(f.stops),
        "" if math.isnan(f.first_stop_m) else f"{f.first_stop_m:.1f}",
        clearance,
        f"{share:.0f}",
    )
    return "| " + " | ".join(cells) + " |"


TITLE = (
    "| flight | autopilot | flown m | s | fastest m/s | stops | first at m | least distance ahead m | frames with open % |\n"
    + "|---" * 9
    + "|"
)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a vehicle flew into something."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--flights", type=words, default=list(FLIGHTS))
    p.add_argument("--autopilots", type=words, default=list(AUTOPILOTS))
    p.add_argument("--seeds", type=words, default=[0])
    p.add_argument("--sky", choices=list(SKIES), default="clear")
    p.add_argument("--seconds", type=float, default=40.0)
    a = p.parse_args(arguments)
    print(TITLE)
    hit = False
    for name in a.flights:
        for autopilot in a.autopilots:
            for seed in a.seeds:
                flown = fly(name, autopilot, a.seconds, int(seed), a.sky)
                hit |= flown.clearance_m <= AVOID.radius_m
                print(row(name, autopilot, flown), flush=True)
    return int(hit)


if __name__ == "__main__":
    sys.exit(main())
