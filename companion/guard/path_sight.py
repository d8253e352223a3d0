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
"""Least range in the computation of that area."""
RECKONING_ERRORS = (ArithmeticError, AssertionError, LookupError, ValueError)
"""Errors of the computation after which the path counts as not seen."""

Frame = tuple[str, int]
"""Camera, and exposure in monotonic ns."""


@dataclass(frozen=True, slots=True)
class _Nearest:
    """The nearest obstacle.

    Attributes:
        m: distance along the path; inf: none.
        frame: the frame that shows it."""

    m: float = math.inf
    frame: Frame | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PathSight:
    """What one decision shows of the path.

    Attributes:
        t_ns: instant of the decision.
        exposed_ns: exposure of the oldest frame in use; None: none is.
        speed_m_s: horizontal speed; None: not known.
        course_rad: direction of the path, clockwise from north; None: heading not known.
        free_m: distance from the vehicle's middle to which the path is seen free.
        obstacle_m: nearest obstacle in the path; inf: none.
        weak_obstacle_m: nearest obstacle with weak support, which needs a second frame; inf: none.
        position_ned_m: of the vehicle; None: not known.
        cause: why nothing is seen, as text; empty: something is.
        remembered_m: nearest obstacle that was seen before, where no camera looks now; inf: none.
        ahead_free_m: like free_m, along the course that follows in a turn; inf: no turn.
        obstacle_frame: frame that shows the obstacle at obstacle_m; None: not known.
        weak_frame: frame that shows the obstacle at weak_obstacle_m; None: not known.
        velocity_ns: instant of the velocity; None: that of the decision.
        slope: way down per metre along the path.
        rays_free_m: (N,) distance to which each ray of the corridor is seen free; None: not known.
        kept_rays: the same by the frames of the last moment; empty: no such frame can be compared.
        ahead_rad: angle from the path to the course that follows, clockwise.
        estimate: section of the position, None: not known; and section of the heading."""

    t_ns: int
    exposed_ns: int | None
    speed_m_s: float | None
    course_rad: float | None
    free_m: float
    obstacle_m: float
    weak_obstacle_m: float
    position_ned_m: tuple[float, float, float] | None
    cause: str = ""
    remembered_m: float = math.inf
    ahead_free_m: float = math.inf
    obstacle_frame: Frame | None = None
    weak_frame: Frame | None = None
    velocity_ns: int | None = None
    slope: float = 0.0
    rays_free_m: Floats | None = field(default=None, compare=False)
    kept_rays: tuple[KeptRays, ...] = field(default=(), compare=False)
    ahead_rad: float = 0.0
    estimate: tuple[int | None, int] = (None, 0)

    def frame_of(self, obstacle_m: float) -> Frame:
        """Returns the frame that shows the obstacle at this distance, obstacle_m or weak_obstacle_m."""
        frame = self.obstacle_frame if obstacle_m == self.obstacle_m else self.weak_frame
        return frame if frame is not None else ("", self.exposed_ns or 0)


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
    free_m, firm, weak, kept_m, course_rad, slope = 0.0, _Nearest(), _Nearest(), math.inf, None, 0.0
    ahead_free_m, rays_m = math.inf, None
    kept_rays: tuple[KeptRays, ...] = ()
    cause = "; ".join(f"{c}: {why}" for c, why in s.blind.items()) if not s.views else ""
    if s.here is None:
        cause = cause or "the attitude is lost"
    else:
        path = _path(s, speed_m_s)
        course_rad, slope = s.here.heading_rad + math.atan2(path.sin, path.cos), path.slope
        try:
            rays_m = rays_free_m(s, path, avoid, guard)
            free_m = corridor_free_m(rays_m, avoid)
            kept_rays = _kept_rays(before, path, avoid, guard)
            ahead_m = braking_of(guard, avoid).needed_m(speed_m_s or 0.0, LIMIT_AHEAD_S)
            if not turns(turn_rad_s, speed_m_s or 0.0, ahead_m, guard.side_m):
                turn_rad_s = 0.0
            beside = _turned(path, turn_rad_s, speed_m_s or 0.0, avoid, guard)
            if turn_rad_s != 0.0:
                follows_m = rays_free_m(s, path.beside(turn_rad_s * AHEAD_S), avoid, guard)
                ahead_free_m = corridor_free_m(follows_m, avoid)
            for corridor in (path, *beside):
                in_it, weak_in_it = nearest_obstacles(s, corridor, avoid, guard)
                firm, weak = min(firm, in_it, key=_distance_m), min(weak, weak_in_it, key=_distance_m)
            # Where every ray is seen free, a camera looks there, and its present frame counts.
            kept_m = remembered_m(s, path, avoid, guard, beyond_m=float(rays_m.min()))
            kept_m = min([kept_m, *(remembered_m(s, corridor, avoid, guard) for corridor in beside)])
        except RECKONING_ERRORS as error:
            free_m, rays_m, kept_rays = 0.0, None, ()
            cause = f"the path cannot be computed: {type(error).__name__}: {error}"
    return PathSight(
        t_ns=s.t_ns,
        exposed_ns=s.exposed_ns,
        speed_m_s=speed_m_s,
        course_rad=course_rad,
        slope=slope,
        free_m=free_m,
        obstacle_m=firm.m,
        weak_obstacle_m=weak.m,
        obstacle_frame=firm.frame,
        weak_frame=weak.frame,
        remembered_m=kept_m,
        ahead_free_m=ahead_free_m,
        velocity_ns=s.velocity_ns,
        rays_free_m=rays_m,
        kept_rays=kept_rays,
        ahead_rad=turn_rad_s * AHEAD_S,
        position_ned_m=None if s.here is None else s.here.position_ned_m,
        estimate=(None, 0) if s.here is None else s.here.estimate,
        cause=cause,
    )


def _path(s: Surroundings, speed_m_s: float | None) -> Path:
    """Returns the corridor along the velocity; straight ahead if the vehicle is slow or its velocity is not known."""
    assert s.here is not None
    if speed_m_s is None or s.velocity_ned_m_s is None or speed_m_s < LEAST_SPEED_M_S:
        return Path(1.0, 0.0, 0.0)
    north, east, down = s.velocity_ned_m_s
    angle = math.atan2(east, north) - s.here.heading_rad
    slope = max(-STEEPEST, min(STEEPEST, down / speed_m_s)) if speed_m_s >= SLOPE_SPEED_M_S else 0.0
    return Path(math.cos(angle), math.sin(angle), slope)


def _turned(path: Path, turn_rad_s: float, speed_m_s: float, avoid: AvoidParams, guard: GuardParams) -> list[Path]:
    """Returns the corridors beside the tangent into which a turn may lead."""
    directions = fan(turn_rad_s, speed_m_s, guard.horizon_m, half_width_m(avoid, guard))
    return [path.beside(angle, from_m) for angle, from_m in directions]


def rays_free_m(s: Surroundings, path: Path, avoid: AvoidParams, guard: GuardParams) -> Floats:
    """Returns the distance to which each ray of the corridor is seen free from near_m on, (N,); 0 where it is not.

    Only measured free space counts, not open space that is presumed free. Rays that lie partly outside of all images are completed by free space that was seen a moment
    before, as for the sectors of the obstacle output, and only where SEEN_SHARE of the rays is seen now."""

    def free(x: Floats, y: Floats, z: Floats) -> Bools:
        seen = np.zeros((len(z), *x.shape), bool)
        for view in s.views:
            seen |= measured_free(view, x, y, z)
        return seen if s.recall is None else seen | _recalled(seen, x, y, z, s.recall, avoid)

    samples = samples_of(path, avoid, guard)
    return samples.rays_m(samples.found(free))


def _kept_rays(
    before: Iterable[KeptDecision], path: Path, avoid: AvoidParams, guard: GuardParams
) -> tuple[KeptRays, ...]:
    """Returns the rays of the corridor by the views of the last moment."""
    samples = samples_of(path, avoid, guard)
    return tuple(rays for decision in before for rays in decision.rays(samples))


def _recalled(free: Bools, x: Floats, y: Floats, z: Floats, recall: Recall, avoid: AvoidParams) -> Bools:
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


def nearest_obstacles(s: Surroundings, path: Path, avoid: AvoidParams, guard: GuardParams) -> tuple[_Nearest, _Nearest]:
    """Returns the nearest obstacle in the corridor, and the nearest one with weak support."""
    firm, weak = _Nearest(), _Nearest()
    frames: tuple[Frame | None, ...] = s.frames or (None,) * len(s.views)
    for view, weak_px, frame in zip(s.views, s.weak_px, frames, strict=True):
        distance = _planes_m(view, path, avoid, guard)
        few = view.model.support_px <= np.maximum(weak_px, _small_px(view))
        firm = min(firm, _Nearest(float(np.min(distance[~few], initial=math.inf)), frame), key=_distance_m)
        weak = min(weak, _Nearest(float(np.min(distance[few], initial=math.inf)), frame), key=_distance_m)
    return firm, weak


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


def _planes_m(view: View, path: Path, avoid: AvoidParams, guard: GuardParams) -> Floats:
    """Returns the distance along the path, (N,), to the part of each plane in the corridor, less the plane's margin,
    at least 0.

    It is inf for planes outside of the corridor."""
    planes = view.model.planes.astype(np.float64)
    if not view.model.valid or not len(planes):
        return np.full(len(planes), np.inf)
    half = half_width_m(avoid, guard)
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


def remembered_m(s: Surroundings, path: Path, avoid: AvoidParams, guard: GuardParams, beyond_m: float = 0.0) -> float:
    """Returns the distance along the path to the nearest remembered obstacle whose sector meets the corridor farther
    away than beyond_m; inf: none."""
    known = np.isfinite(s.recalled.distance_m)
    if not known.any():
        return math.inf
    range_m = s.recalled.distance_m[known] + avoid.radius_m
    angle = centres_rad()[known] - math.atan2(path.sin, path.cos)
    half = half_width_m(avoid, guard) + 0.5 * STEP_RAD * range_m
    along, across = range_m * np.cos(angle), range_m * np.sin(angle)
    hit = (along > max(path.from_m, beyond_m)) & (np.abs(across) <= half)
    return float(np.min(along[hit], initial=math.inf))
