"""What one decision of the obstacle output shows of the path ahead: how far it is seen free, and the nearest obstacle
in it.

The path is a straight corridor from the vehicle along its velocity. It is as wide as the hull and `side_m` on each
side, and as high as the height band of `[avoid]`. In a climb or descent the band follows the slope; obstacles count
in the level band as well. In a turn, obstacles also count in corridors beside it, and the course that follows must be
seen free, too (turn.py). Distances are horizontal, from the vehicle's middle. All coordinates are in `level` at the
instant of the decision."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from ..autopilot.confirmation import SMALL_M2
from ..autopilot.obstacle_memory import Here
from ..autopilot.obstacle_report import RECKONING_ERRORS
from ..autopilot.polar_histogram import SEEN_SHARE, STEP_RAD, Recall, centres_rad
from ..autopilot.surroundings import Surroundings
from ..autopilot.view_free import View
from ..config.avoidance import AvoidParams
from ..config.guard import GuardParams
from .braking import LIMIT_AHEAD_S, braking_of
from .corridor import Bools, Floats, Path, corridor_free_m, half_width_m, samples_of
from .kept_views import KeptDecision, KeptRays, measured_free
from .turn import AHEAD_S, fan, turns

LEAST_SPEED_M_S = 0.2
"""A slower vehicle has no direction of flight: the path is straight ahead."""
SLOPE_SPEED_M_S = 1.0
"""For a slower vehicle the ratio of vertical to horizontal velocity is mostly noise: the path is level."""
STEEPEST = 1.0
"""Greatest slope of a path, vertical over horizontal."""
LEAST_RANGE_M = 0.3
"""Least range at which the pixels that cover SMALL_M2 are counted."""

Frame = tuple[str, int]
"""Camera, and exposure in monotonic ns."""


@dataclass(frozen=True, slots=True)
class _Nearest:
    """The nearest obstacle."""

    m: float = math.inf  # distance along the path; inf: none
    frame: Frame | None = None  # the frame that shows it


@dataclass(frozen=True, slots=True, kw_only=True)
class PathSight:
    """What one decision shows of the path."""

    t_ns: int  # instant of the decision
    exposed_ns: int | None  # exposure of the oldest frame in use; None: none is
    speed_m_s: float | None  # horizontal speed; None: not known
    course_rad: float | None  # direction of the path, clockwise from north; None: heading not known
    free_m: float  # distance from the vehicle's middle to which the path is seen free
    obstacle_m: float  # nearest obstacle in the path; inf: none
    weak_obstacle_m: float  # nearest obstacle with weak support, which needs a second frame; inf: none
    position_ned_m: tuple[float, float, float] | None  # of the vehicle; None: not known
    cause: str = ""  # why nothing is seen, as text; empty: something is
    camera_fails: bool = False  # a camera gives no usable frame
    remembered_m: float = math.inf  # nearest obstacle that was seen before, where no camera looks now; inf: none
    ahead_free_m: float = math.inf  # like free_m, along the course that follows in a turn; inf: no turn
    obstacle_frame: Frame | None = None  # frame that shows the obstacle at obstacle_m; None: not known
    weak_frame: Frame | None = None  # frame that shows the obstacle at weak_obstacle_m; None: not known
    velocity_ns: int | None = None  # instant of the velocity; None: that of the decision
    slope: float = 0.0  # way down per metre along the path
    # (N,) distance to which each ray of the corridor is seen free; None: not known
    rays_free_m: Floats | None = field(default=None, compare=False)
    # the same by the frames of the last moment; empty: no such frame can be compared
    kept_rays: tuple[KeptRays, ...] = field(default=(), compare=False)
    ahead_rad: float = 0.0  # angle from the path to the course that follows, clockwise
    estimate: tuple[int | None, int] = (None, 0)  # section of the position, None: not known; and section of the heading
    shown_ns: int | None = None  # instant at whose place of the vehicle the distances begin; None: that of the decision

    def frame_of(self, obstacle_m: float) -> Frame:
        """Returns the frame that shows the obstacle at this distance, obstacle_m or weak_obstacle_m."""
        frame = self.obstacle_frame if obstacle_m == self.obstacle_m else self.weak_frame
        return frame if frame is not None else ("", self.exposed_ns or 0)


@dataclass(slots=True)
class _Path:
    """What the corridors of one path show: the values of PathSight of the same names."""

    free_m: float = 0.0
    ahead_free_m: float = math.inf
    firm: _Nearest = _Nearest()
    weak: _Nearest = _Nearest()
    remembered_m: float = math.inf
    rays_free_m: Floats | None = None
    kept_rays: tuple[KeptRays, ...] = ()
    turn_rad_s: float = 0.0


def path_sight(
    s: Surroundings,
    avoid: AvoidParams,
    guard: GuardParams,
    turn_rad_s: float = 0.0,
    before: Iterable[KeptDecision] = (),
) -> PathSight:
    """Returns the path at one decision. If it cannot be computed, nothing is seen free.

    Args:
        s: surroundings of the decision.
        avoid: parameters of the obstacle output.
        guard: parameters of the guard.
        turn_rad_s: rate of the course, clockwise.
        before: views of the last moment."""
    speed_m_s = None if s.velocity_ned_m_s is None else math.hypot(*s.velocity_ned_m_s[:2])
    found, course_rad, slope = _Path(turn_rad_s=turn_rad_s), None, 0.0
    cause = "; ".join(f"{c}: {why}" for c, why in s.blind.items()) if not s.views else ""
    if s.here is None:
        cause = cause or "the attitude is lost"
    else:
        path = _path(s.here, s.velocity_ned_m_s)
        course_rad, slope = s.here.heading_rad + math.atan2(path.sin, path.cos), path.slope
        try:
            _Corridors(s, avoid, guard).fill(found, path, speed_m_s or 0.0, before)
        except RECKONING_ERRORS as error:
            found.free_m, found.rays_free_m, found.kept_rays = 0.0, None, ()
            cause = f"the path cannot be computed: {type(error).__name__}: {error}"
    return PathSight(
        t_ns=s.t_ns,
        exposed_ns=s.exposed_ns,
        speed_m_s=speed_m_s,
        course_rad=course_rad,
        slope=slope,
        free_m=found.free_m,
        obstacle_m=found.firm.m,
        weak_obstacle_m=found.weak.m,
        obstacle_frame=found.firm.frame,
        weak_frame=found.weak.frame,
        remembered_m=found.remembered_m,
        ahead_free_m=found.ahead_free_m,
        velocity_ns=s.velocity_ns,
        rays_free_m=found.rays_free_m,
        kept_rays=found.kept_rays,
        ahead_rad=found.turn_rad_s * AHEAD_S,
        position_ned_m=None if s.here is None else s.here.position_ned_m,
        estimate=(None, 0) if s.here is None else s.here.estimate,
        cause=cause,
        camera_fails=bool(s.blind),
        shown_ns=None if s.moved else s.exposed_ns,
    )


def _path(here: Here, velocity_ned_m_s: tuple[float, float, float] | None) -> Path:
    """Returns the path along the velocity; straight ahead if the vehicle is slow or its velocity is not known."""
    north, east, down = velocity_ned_m_s or (0.0, 0.0, 0.0)
    speed_m_s = math.hypot(north, east)
    if speed_m_s < LEAST_SPEED_M_S:
        return Path(1.0, 0.0, 0.0)
    angle = math.atan2(east, north) - here.heading_rad
    slope = max(-STEEPEST, min(STEEPEST, down / speed_m_s)) if speed_m_s >= SLOPE_SPEED_M_S else 0.0
    return Path(math.cos(angle), math.sin(angle), slope)


class _Corridors:
    """The corridors of one decision. s: its surroundings, with a heading."""

    def __init__(self, s: Surroundings, avoid: AvoidParams, guard: GuardParams) -> None:
        self._s, self._avoid, self._guard = s, avoid, guard
        self._half_m = half_width_m(avoid, guard)

    def fill(self, found: _Path, path: Path, speed_m_s: float, before: Iterable[KeptDecision]) -> None:
        """Writes what is seen of a path, one value after the other. found.turn_rad_s: rate of the course; 0 afterwards where
        it makes no turn."""
        avoid, guard = self._avoid, self._guard
        rays_m = found.rays_free_m = self._rays_free_m(path)
        found.free_m = corridor_free_m(rays_m, avoid)
        samples = samples_of(path, avoid, guard)
        found.kept_rays = tuple(rays for decision in before for rays in decision.rays(samples))
        ahead_m = braking_of(guard, avoid).needed_m(speed_m_s, LIMIT_AHEAD_S)
        if not turns(found.turn_rad_s, speed_m_s, ahead_m, guard.side_m):
            found.turn_rad_s = 0.0
        directions = fan(found.turn_rad_s, speed_m_s, guard.horizon_m, self._half_m)
        beside = [path.beside(angle, from_m) for angle, from_m in directions]
        if found.turn_rad_s != 0.0:
            follows_m = self._rays_free_m(path.beside(found.turn_rad_s * AHEAD_S))
            found.ahead_free_m = corridor_free_m(follows_m, avoid)
        for corridor in (path, *beside):
            self._nearest_obstacles(found, corridor)
        # Where every ray is seen free, a camera looks there, and its present frame counts.
        found.remembered_m = self._remembered_m(path, beyond_m=float(rays_m.min()))
        found.remembered_m = min([found.remembered_m, *map(self._remembered_m, beside)])

    def _rays_free_m(self, path: Path) -> Floats:
        """Returns the distance to which each ray of the corridor is seen free from near_m on, (N,); 0 where it is not.

        Only measured free space counts, not open space that is presumed free. Rays that lie partly outside of all images
        are completed by free space that was seen a moment before, as for the sectors of the obstacle output, and only
        where SEEN_SHARE of the rays is seen now."""
        s = self._s

        def free(x: Floats, y: Floats, z: Floats) -> Bools:
            seen = np.zeros((len(z), *x.shape), bool)
            for view in s.views:
                seen |= measured_free(view, x, y, z)
            return seen if s.recall is None else seen | _recalled(seen, x, y, z, s.recall)

        samples = samples_of(path, self._avoid, self._guard)
        return samples.rays_m(samples.found(free))

    def _nearest_obstacles(self, found: _Path, path: Path) -> None:
        """Writes the nearest obstacle in the corridor, and the nearest one with weak support, if they are nearer."""
        s = self._s
        frames: tuple[Frame | None, ...] = s.frames or (None,) * len(s.views)
        for view, weak_px, frame in zip(s.views, s.weak_px, frames, strict=True):
            distance = self._planes_m(view, path)
            few = view.model.support_px <= np.maximum(weak_px, _small_px(view))
            firm, weak = (_Nearest(float(np.min(distance[these], initial=math.inf)), frame) for these in (~few, few))
            found.firm, found.weak = min(found.firm, firm, key=_distance_m), min(found.weak, weak, key=_distance_m)

    def _planes_m(self, view: View, path: Path) -> Floats:
        """Returns the distance along the path, (N,), to the part of each plane in the corridor, less the plane's margin,
        at least 0.

        It is inf for planes outside of the corridor."""
        planes, half, avoid = view.model.planes.astype(np.float64), self._half_m, self._avoid
        if not view.model.valid or not len(planes):
            return np.full(len(planes), np.inf)
        ends_x = path.cos * planes[:, [0, 2]] + path.sin * planes[:, [1, 3]]
        ends_y = -path.sin * planes[:, [0, 2]] + path.cos * planes[:, [1, 3]]
        along = ends_y[:, 1] - ends_y[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = (np.array([[-half], [half]]) - ends_y[:, 0]) / along
        parallel = np.abs(along) < 1e-9
        inside = np.abs(ends_y[:, 0]) <= half
        first = np.where(parallel, np.where(inside, 0.0, 1.0), np.clip(shares.min(axis=0), 0.0, 1.0))
        last = np.where(parallel, np.where(inside, 1.0, 0.0), np.clip(shares.max(axis=0), 0.0, 1.0))
        outside = (last < first) | ((ends_y > half).all(axis=1)) | ((ends_y < -half).all(axis=1))
        at = ends_x[:, :1] + (ends_x[:, 1:] - ends_x[:, :1]) * np.stack([first, last], axis=1)
        # of a plane that extends past the vehicle only the part ahead counts
        near_m, far_m = np.maximum(path.from_m, at.min(axis=1)), at.max(axis=1)
        heights = path.slope * np.stack([near_m, np.maximum(near_m, far_m)], axis=1)
        level = (planes[:, 4] < avoid.band_below_m) & (planes[:, 5] > -avoid.band_above_m)
        sloped = (planes[:, 4] < heights.max(axis=1) + avoid.band_below_m) & (
            planes[:, 5] > heights.min(axis=1) - avoid.band_above_m
        )
        hit = ~outside & (far_m >= path.from_m) & (level | sloped)
        out: Floats = np.where(hit, np.maximum(0.0, near_m - view.model.margin_m), np.inf)
        return out

    def _remembered_m(self, path: Path, beyond_m: float = 0.0) -> float:
        """Returns the distance along the path to the nearest remembered obstacle whose sector meets the corridor farther
        away than beyond_m; inf: none."""
        known = np.isfinite(self._s.recalled.distance_m)
        range_m = self._s.recalled.distance_m[known] + self._avoid.radius_m
        angle = centres_rad()[known] - math.atan2(path.sin, path.cos)
        along, across = range_m * np.cos(angle), range_m * np.sin(angle)
        hit = (along > max(path.from_m, beyond_m)) & (np.abs(across) <= self._half_m + 0.5 * STEP_RAD * range_m)
        return float(np.min(along[hit], initial=math.inf))


def _recalled(free: Bools, x: Floats, y: Floats, z: Floats, recall: Recall) -> Bools:
    """Returns which places not seen free now were seen free a moment before, at distances where SEEN_SHARE of the
    rays is seen now.

    free: (heights, ACROSS, samples), as is the result."""
    out = np.zeros_like(free)
    share = free.mean(axis=(0, 1))
    wanted = ~free & ((share >= SEEN_SHARE) & (share < 1.0))[None, None, :]
    i, j, k = np.nonzero(wanted)
    if len(i):
        out[i, j, k] = recall(x[j, k], y[j, k], z[i])
    return out


def _distance_m(nearest: _Nearest) -> float:
    return nearest.m


def _small_px(view: View) -> Floats:
    """Returns the number of pixels, (N,), that cover SMALL_M2 at the range of each plane; 0 without intrinsics."""
    planes = view.model.planes.astype(np.float64)
    if view.intrinsics is None:
        return np.zeros(len(planes))
    cx, cy, _ = view.place_m
    range_m = np.hypot(planes[:, [0, 2]].mean(axis=1) - cx, planes[:, [1, 3]].mean(axis=1) - cy)
    out: Floats = SMALL_M2 * view.intrinsics.fx * view.intrinsics.fy / np.maximum(LEAST_RANGE_M, range_m) ** 2
    return out
