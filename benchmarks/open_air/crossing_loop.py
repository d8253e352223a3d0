"""One vehicle in simulated time: rendered stereo, matching, pipeline, obstacle output and an autopilot model, and what is judged.

The vehicle leans as its acceleration demands. It gets OBSTACLE_DISTANCE as the service sends it. Its sideways way counts: PX4 guides
it beside what is not clear (CP_GUIDE_ANG)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.free_space.volume import first_solids, wrong_cells
from benchmarks.open_air.open_claims import as_free, marked, true_ke_per_m
from benchmarks.open_air.vehicles import MARGIN_M, vehicle_of
from benchmarks.open_air.views import profile_of
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import clear_cm, obstacle_distance_message
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.polar_histogram import centres_rad
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.pipeline.transform import transform_model
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, quaternion_from_euler, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.simulation.source import Rendered, Truth
from drivers.simulation.stereo.stereo_profiles import StereoCamera, StereoProfile
from drivers.simulation.stereo.stereo_scene import StereoScene

NS, MS = 1_000_000_000, 1_000_000
TICK_NS, FRAME_NS, DECIDE_NS, LATE_NS = 20 * MS, 100 * MS, 60 * MS, 70 * MS
"""Step of the models, period of frames, of messages, and time from exposure to result."""
STOPPED_M_S, MOVING_M_S = 0.3, 1.0
GRAVITY_M_S2, DRAG_RAD_PER_M_S = 9.81, math.radians(1.0)
AVOID = AvoidParams(max_distance_m=10.0)
PRESUME = OpenSkyParams(mode="presume", mount_measured=True)
CLEAR_SLACK_M = 1.0
"""A sector that is clear although a solid stands within max_distance_m less this is wrong: the way of a message's age."""
_NONE = np.zeros((0, 0))
_NO_TRUTH = Truth(_NONE, np.zeros((0, 0), np.int32), _NONE, np.zeros((0, 0, 3)), np.zeros((0, 0), np.bool_))


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """What the pilot does from start_s on. speed_m_s: of the stick, forward; climb_m_s: up to height_to_m; turn_rad_s: of the
    heading, clockwise."""

    speed_m_s: float = 4.0
    height_m: float = 2.0
    height_to_m: float = 2.0
    climb_m_s: float = 0.0
    heading_rad: float = 0.0
    turn_rad_s: float = 0.0
    start_s: float = 0.0


@dataclass(slots=True)
class Flown:
    """One flight. distance_m: of the way; north_m, east_m, height_m: place at the end; stops: times that the speed fell below
    STOPPED_M_S; first_stop_m: way flown to the first, nan: none; clearance_m: least distance of the hull from a solid at its height;
    open_frames: frames with any open range; wrong_free: free cells that hold a solid; wrong_open: open ones that are not among them;
    wrong_clear: sectors sent clear with a
    solid in them."""

    distance_m: float = 0.0
    north_m: float = 0.0
    east_m: float = 0.0
    height_m: float = 0.0
    seconds: float = 0.0
    stops: int = 0
    clearance_m: float = math.inf
    fastest_m_s: float = 0.0
    open_frames: int = 0
    frames: int = 0
    first_stop_m: float = math.nan
    wrong_free: int = 0
    wrong_open: int = 0
    wrong_clear: int = 0


def unmatched_columns(profile: StereoProfile) -> NDArray[np.bool_]:
    """(H, W) the pixels at both sides that never have a match, as the service leaves them out of what a camera covers."""
    k = profile.view.intrinsics
    out = np.zeros((k.height, k.width), np.bool_)
    out[:, : profile.unmatched_left_px] = True
    out[:, k.width - profile.unmatched_right_px :] = True
    return out


def body_rates_rad_s(
    before: tuple[float, float], now: tuple[float, float], turn_rad: float, dt_s: float
) -> tuple[float, float, float]:
    """Body rates while roll and pitch change from `before` to `now` and the heading by turn_rad."""
    roll, pitch = now
    d_roll, d_pitch, d_yaw = (now[0] - before[0]) / dt_s, (now[1] - before[1]) / dt_s, turn_rad / dt_s
    return (
        d_roll - math.sin(pitch) * d_yaw,
        math.cos(roll) * d_pitch + math.sin(roll) * math.cos(pitch) * d_yaw,
        -math.sin(roll) * d_pitch + math.cos(roll) * math.cos(pitch) * d_yaw,
    )


def ranges_m(
    scene: StereoScene, place_ned_m: NDArray[np.float64], azimuth_rad: NDArray[np.float64], z_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(heights, azimuths) horizontal distance from a place to the first solid, up to 20 m, inf: none. azimuth_rad: from north;
    z_m: heights relative to the place, down."""
    z, azimuth = (a.ravel() for a in np.meshgrid(z_m, azimuth_rad, indexing="ij"))
    origins = place_ned_m + np.column_stack([np.zeros((len(z), 2)), z])
    ahead = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(z))])
    found, _ = first_solids(scene.scene, False, origins, ahead, np.zeros(len(z)), np.full(len(z), 20.0), 0.0)
    return found.reshape(len(z_m), len(azimuth_rad))


class CrossingLoop:
    """`run` flies; flown: what happened; vehicle: the autopilot model."""

    def __init__(
        self,
        scene: StereoScene,
        autopilot: str,
        course: Course | None = None,
        *,
        guide_ang_deg: float = 30.0,
        seed: int = 0,
        open_sky: OpenSkyParams = PRESUME,
    ) -> None:
        self.scene, self.seed, self.course = scene, seed, course or Course()
        self.vehicle = vehicle_of(autopilot, guide_ang_deg)
        self.vehicle.heading_rad = self.course.heading_rad
        px4 = autopilot != "ArduPilot"
        self._now = (
            AutopilotNow(kind="PX4", cp_dist_m=MARGIN_M) if px4 else AutopilotNow(kind="ArduPilot", margin_m=MARGIN_M)
        )
        self._camera = StereoCamera(marked(profile_of("zed")))
        self._info = self._camera.profile.info()
        self._extractor = Extractor(Params(), open_sky)
        self._pipeline = Pipeline((self._info,), lambda info: self._extractor)
        self._builder = ObstacleReportBuilder(
            AVOID, CameraUse(cameras=(self._info.camera,), timeout_s=0.3, open_counts=open_sky.presumes)
        )
        self._builder.announce(self._info, unmatched_columns(self._camera.profile))
        self.flown = Flown()
        self.now_ns, self._frame, self._lean_rad = 100 * NS, 0, (0.0, 0.0)
        self.place_ned_m, self._velocity_m_s = np.array([0.0, 0.0, -self.course.height_m]), np.zeros(2)
        self._moving = False
        self._later: list[tuple[int, Callable[[], None]]] = []

    def run(self, seconds: float, until_m: float = math.inf, still_s: float = math.inf) -> Flown:
        """Flies for so long, over this way, or until it has stood for still_s."""
        end_ns, stood_ns = self.now_ns + round(seconds * NS), 0
        while self.now_ns < end_ns and self.flown.distance_m < until_m and stood_ns < still_s * NS:
            self._tick()
            stands = float(np.hypot(*self._velocity_m_s)) < STOPPED_M_S and self.flown.fastest_m_s > MOVING_M_S
            stood_ns = stood_ns + TICK_NS if stands else 0
        return self.flown

    def _tick(self) -> None:
        self.now_ns += TICK_NS
        self._move()
        for _, act in [due for due in self._later if due[0] <= self.now_ns]:
            act()
        self._later = [due for due in self._later if due[0] > self.now_ns]
        if self.now_ns % FRAME_NS == 0:
            self._expose()
        if self.now_ns % DECIDE_NS == 0:
            report = self._builder.decide(self._now, self.now_ns)
            if report.values is not None:
                self._judge_sectors(report.values)
                self.vehicle.read(obstacle_distance_message(report.values, 0, AVOID), self.now_ns)

    def _move(self) -> None:
        course, dt_s = self.course, TICK_NS / NS
        acts = self.flown.seconds >= course.start_s
        turn_rad = course.turn_rad_s * dt_s if acts else 0.0
        before, lean_before = self._velocity_m_s, self._lean_rad
        place, self._velocity_m_s = self.vehicle.step(np.array([course.speed_m_s, 0.0]), turn_rad, dt_s, self.now_ns)
        height_m = -float(self.place_ned_m[2])
        rises = acts and height_m < course.height_to_m
        height_m = min(course.height_to_m, height_m + course.climb_m_s * dt_s) if rises else height_m
        self._lean((self._velocity_m_s - before) / dt_s)
        self.place_ned_m = np.array([place[0], place[1], -height_m])
        self._note()
        rates = body_rates_rad_s(lean_before, self._lean_rad, turn_rad, dt_s)
        q = quaternion_from_euler(*self._lean_rad, self.vehicle.heading_rad)
        velocity = (float(self._velocity_m_s[0]), float(self._velocity_m_s[1]), -course.climb_m_s if rises else 0.0)
        north, east, down = (float(c) for c in self.place_ned_m)
        samples: list[AttitudeSample | PoseSample] = [
            AttitudeSample(self.now_ns, self.now_ns, q, rates),
            PoseSample(self.now_ns, self.now_ns, (north, east, down), velocity),
        ]
        for sample in samples:
            self._pipeline.handle(sample)
        self._builder.samples(samples)

    def _lean(self, acceleration_m_s2: NDArray[np.float64]) -> None:
        """Roll and pitch follow the acceleration and the drag, north and east given."""
        angle = self.vehicle.heading_rad
        c, s = math.cos(angle), math.sin(angle)
        lean = np.arctan(acceleration_m_s2 / GRAVITY_M_S2) + DRAG_RAD_PER_M_S * self._velocity_m_s
        roll, pitch = self._lean_rad
        forward, right = c * lean[0] + s * lean[1], c * lean[1] - s * lean[0]
        self._lean_rad = (roll + 0.1 * (float(right) - roll), pitch + 0.1 * (-float(forward) - pitch))

    def _note(self) -> None:
        flown, speed = self.flown, float(np.hypot(*self._velocity_m_s))
        flown.seconds += TICK_NS / NS
        flown.distance_m += speed * TICK_NS / NS
        flown.north_m, flown.east_m, flown.height_m = (float(c) for c in self.place_ned_m * (1.0, 1.0, -1.0))
        flown.fastest_m_s = max(flown.fastest_m_s, speed)
        if speed > MOVING_M_S:
            self._moving = True
        elif self._moving and speed < STOPPED_M_S:
            self._moving = False
            flown.stops += 1
            if flown.stops == 1:
                flown.first_stop_m = flown.distance_m
        around = np.linspace(0.0, math.tau, 180, endpoint=False)
        nearest = ranges_m(self.scene, self.place_ned_m, around, np.array([-0.2, 0.0, 0.2])).min()
        flown.clearance_m = min(flown.clearance_m, float(nearest) - AVOID.radius_m)

    def _judge_sectors(self, values: NDArray[np.uint16]) -> None:
        """Counts the sectors that are sent clear and hold a solid in more than 1 - clear_share of the rays through them."""
        clear = centres_rad()[values == clear_cm(AVOID)]
        if not len(clear):
            return
        offsets = np.radians([-2.0, 0.0, 2.0])
        azimuth = (self.vehicle.heading_rad + clear[:, None] + offsets).ravel()
        heights = np.linspace(-0.9 * AVOID.band_above_m, 0.9 * AVOID.band_below_m, 5)
        near = ranges_m(self.scene, self.place_ned_m, azimuth, heights) < AVOID.max_distance_m - CLEAR_SLACK_M
        share = near.reshape(len(heights), len(clear), len(offsets)).mean(axis=(0, 2))
        self.flown.wrong_clear += int((share > 1.0 - AVOID.clear_share).sum())

    def _expose(self) -> None:
        number, t_ns, at = self._frame, self.now_ns, self.place_ned_m
        self._frame += 1
        R = rotation_from_euler(*self._lean_rad, self.vehicle.heading_rad) @ R_CAMFRD_OPTICAL
        depth_mm = self._camera.depth_of(self._camera.pair(self.scene, R, at, self.seed, number))

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
                    self._count(output, R, at)

        self._later.append((t_ns + LATE_NS, arrive))

    def _count(self, result: PrismsResult, R_ned_optical: NDArray[np.float64], at: NDArray[np.float64]) -> None:
        """Counts a result, and the cells that are free or open in it and hold a solid."""
        self.flown.frames += 1
        if not (result.valid and result.model is not None and result.transform is not None):
            return
        model = transform_model(replace(result.model, prisms=()), result.transform.inverse())
        R_level = rotation_level_cam_optical(R_ned_optical)
        empty = np.zeros((0, 0), np.uint16)
        frame = Rendered(self.scene.scene, self._info, empty, R_ned_optical, R_level, at, _NO_TRUTH)
        params, ke = self._extractor.params, true_ke_per_m(frame, model)
        known = {(w.direction, w.layer) for w in wrong_cells(frame, model, ke, params)[0]}
        self.flown.wrong_free += len(known)
        if not result.model.free.has_open:
            return
        self.flown.open_frames += 1
        opened = wrong_cells(frame, as_free(model), ke, params)[0]
        self.flown.wrong_open += sum((w.direction, w.layer) not in known for w in opened)
