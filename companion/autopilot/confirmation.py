"""Confirmation over several frames: of near planes with weak support, and of sectors that a single frame does not
see.

Planes: single mismatches of a stereo camera, of 3 to 8 pixels, appear as planes anywhere before the true surface, in
about 2 % of the frames of a bare wall. If they were sent at once and remembered, each of them would stop the vehicle
for seconds, and PX4 v1.16 flies backwards from a plane nearer than CP_DIST. A plane of few pixels, or of pixels that
cover less than SMALL_M2, is therefore used only if a plane was found at its place in one of the FRAMES frames before,
or in two of them if its pixels cover less than TINY_M2. This delays a thin obstacle by one frame. A plane of more
pixels is used at once.

Sectors: a mismatch also ends the free space of one direction in one frame. After SEEN_FRAMES consecutive frames that
saw a sector, a frame that does not see it leaves the sector as it was. The sector must then be seen in as many frames
again, or in one frame if the free space ended at another place than at the last loss: two mismatches do that, while a
thin obstacle ends it at the same place. A second frame in a row without the sector is bridged as well if it lacks
rays at other heights than the first one, so that one of the two saw a share clear_share of the rays. A third one is
never bridged, and of eight frames at most MOST_KEPT are."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel, Intrinsics

from ..config.avoidance import AvoidParams
from ..pipeline.multi_camera import heading_rad
from ..pipeline.results import PrismsResult
from .polar_histogram import SECTORS, STEP_RAD, SectorScan, SectorState

NS = 1_000_000_000
FRAMES = 3
"""Number of earlier frames in which a plane may be confirmed: thin obstacles are not found in every frame."""
LONGEST_NS = NS // 2
"""Older frames confirm nothing."""
PLACE_M, NEAR_PLACE_M, PLACE_SHARE = 0.3, 0.05, 0.15
"""Two planes are at one place if they are within PLACE_M, and near the vehicle within NEAR_PLACE_M and PLACE_SHARE of
the range: most mismatches appear close to the camera, where two of them would often lie within PLACE_M of each
other."""
SIGMAS = 4.0
GREATEST_SPEED_M_S = 20.0
"""Speed of the vehicle, or of an obstacle, if position or velocity are not known. It is faster than a multicopter
flies in modes in which autopilots avoid obstacles. A greater value confirms planes at more places, so that more is
sent, never less."""
SMALL_M2 = 1e-3
"""Area on an object, 1 cm by 10 cm. A plane whose pixels cover less must be found in one of the frames before: two
mismatches that join have more pixels than one, but cover less close to the camera. A wire across the image covers more
at any distance."""
TINY_M2 = 1e-4
"""Area on an object. A plane whose pixels cover less must be found in two of the frames before: most mismatches
appear close to the camera, where they are this small, and two of them at one place are frequent. A wire across the
image, or any body that could stop a vehicle, covers more at that distance."""
FULL_IMAGE_PX = 320 * 240
"""Pixels of the image for which `confirm_px` is given; it grows with the image."""


@dataclass(frozen=True, slots=True, eq=False)
class _Planes:
    """Planes of one frame.

    Attributes:
        t_ns: exposure.
        ends_m: (N, 4) a and b in north-aligned axes.
        fixed: relative to the origin of ned; otherwise to the vehicle."""

    t_ns: int
    ends_m: NDArray[np.float64]
    fixed: bool


class PlaneConfirmation:
    """Confirms the planes of one camera. `take` gets each valid result, in order.

    least_px: planes with this support or less need a second frame, as do those that cover less than SMALL_M2."""

    def __init__(self, avoid: AvoidParams, intrinsics: Intrinsics) -> None:
        self._avoid, self._focal_px = avoid, math.sqrt(intrinsics.fx * intrinsics.fy)
        self.least_px = avoid.confirm_px * max(1.0, intrinsics.width * intrinsics.height / FULL_IMAGE_PX)
        self._frames: deque[_Planes] = deque(maxlen=FRAMES)

    def take(self, result: PrismsResult) -> PrismsResult:
        """Returns the result without planes that are near, have weak support, and were not found before."""
        model = result.model
        assert model is not None
        if not np.isfinite(model.planes[:, :4]).all():  # such a result is refused later
            return result
        planes = _north_aligned(result, model)
        recent = [f for f in self._frames if 0 < planes.t_ns - f.t_ns <= LONGEST_NS]
        doubtful = np.zeros(len(model.planes), np.bool_)
        if self._avoid.confirm_px > 0:
            range_m = _range_m(result, planes)
            area_m2 = model.support_px * (range_m / self._focal_px) ** 2
            weak = (model.support_px <= self.least_px) | (area_m2 < SMALL_M2)
            weak &= range_m < self._avoid.remember_m + self._avoid.radius_m
            for i in np.flatnonzero(weak):
                place_m = min(PLACE_M, NEAR_PLACE_M + PLACE_SHARE * float(range_m[i]))
                slack_m = place_m + SIGMAS * model.ke_per_m * float(range_m[i]) ** 2
                found = sum(_found(planes, int(i), frame, slack_m) for frame in recent)
                doubtful[i] = found < (2 if area_m2[i] < TINY_M2 else 1)
        self._frames.append(planes)
        return replace(result, model=without(model, doubtful)) if doubtful.any() else result


def without(model: FrameModel, left_out: NDArray[np.bool_]) -> FrameModel:
    """Returns the model without the planes of `left_out`, (N,), and without prisms. Its free space is not changed."""
    kept = ~left_out
    return replace(
        model,
        planes=model.planes[kept],
        support_px=model.support_px[kept],
        margin_m=model.margin_m[kept],
        flags=model.flags[kept],
        cluster=model.cluster[kept],
        prisms=(),
    )


def _north_aligned(result: PrismsResult, model: FrameModel) -> _Planes:
    """Returns the planes of a result in north-aligned axes."""
    ends = model.planes[:, :4].astype(np.float64)
    if result.frame == "ned":
        return _Planes(result.t_exposure_ns, ends, fixed=True)
    c, s = (math.cos(heading_rad(result)), math.sin(heading_rad(result))) if result.attitude is not None else (1.0, 0.0)
    x, y = ends[:, [0, 2]], ends[:, [1, 3]]
    turned = np.stack([c * x - s * y, s * x + c * y], axis=2).reshape(len(ends), 4)
    return _Planes(result.t_exposure_ns, turned, fixed=False)


def _range_m(result: PrismsResult, planes: _Planes) -> NDArray[np.float64]:
    """Returns the range from the vehicle to the middle of each plane, (N,)."""
    here = np.array(result.pose.position_ned_m[:2]) if planes.fixed and result.pose is not None else np.zeros(2)
    middle = 0.5 * (planes.ends_m[:, :2] + planes.ends_m[:, 2:]) - here
    out: NDArray[np.float64] = np.hypot(middle[:, 0], middle[:, 1])
    return out


def _found(planes: _Planes, i: int, frame: _Planes, slack_m: float) -> bool:
    """True if a frame has a plane at the place of plane i."""
    if not len(frame.ends_m) or planes.fixed != frame.fixed:
        return False
    if not planes.fixed:
        slack_m += GREATEST_SPEED_M_S * (planes.t_ns - frame.t_ns) / NS
    middle = 0.5 * (planes.ends_m[i, :2] + planes.ends_m[i, 2:])
    half_m = 0.5 * float(np.hypot(*(planes.ends_m[i, 2:] - planes.ends_m[i, :2])))
    a, along = frame.ends_m[:, :2], frame.ends_m[:, 2:] - frame.ends_m[:, :2]
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((middle - a) * along).sum(axis=1) / length2, 0.0, 1.0)
    distance = np.hypot(*(a + share[:, None] * along - middle).T)
    return bool((distance <= slack_m + half_m).any())


SEEN_FRAMES = 3
"""Number of consecutive frames that must see a sector before it is kept through one that does not."""
ELSEWHERE_M = 0.5
"""Two ends of the free space that are farther apart than this plus the distance flown between them have different causes."""
KEPT_FRAMES, LONGEST_KEPT_NS = 1.5, 150_000_000
"""A sector is kept until this number of frame intervals, and at most this time, has passed since it was last seen."""
KEPT_TWICE, LONGEST_TWICE_NS = 2.5, 250_000_000
"""The same limits where a second frame in a row does not see the sector."""
MOST_KEPT = 2
"""A sector is kept in at most this number of eight consecutive frames: repeated losses are not caused by mismatches."""


@dataclass(frozen=True, slots=True, eq=False)
class SectorSight:
    """The views that a scan was made from.

    Attributes:
        exposed_ns: (72,) exposure of the newest frame that covers each sector; 0: none.
        blind: (72,) sectors that a blind camera covers in part.
        heading_rad: heading of the vehicle, clockwise from north.
        speed_m_s: horizontal speed; None: not known.
        now_ns: instant of the decision.
        down_m_s: vertical speed; None: not known."""

    exposed_ns: NDArray[np.int64]
    blind: NDArray[np.bool_]
    heading_rad: float
    speed_m_s: float | None
    now_ns: int
    down_m_s: float | None = None


class SeenSectors:
    """Bridges single frames that do not see a sector. `take` gets each scan, in order."""

    def __init__(self, avoid: AvoidParams) -> None:
        """Starts without any sector seen.

        avoid: confirm_px = 0 switches the bridging off; obstacles from max_distance_m on are not sent."""
        self._avoid = avoid
        self._distance_m, self._free_m = np.full(SECTORS, np.inf), np.zeros(SECTORS)
        self._heading_rad = np.zeros(SECTORS)
        self._frame_ns = np.zeros(SECTORS, np.int64)
        self._interval_ns = np.zeros(SECTORS, np.int64)
        self._in_a_row = np.zeros(SECTORS, np.int64)
        self._seen_exposed_ns = np.zeros(SECTORS, np.int64)
        self._seen_ns = np.zeros(SECTORS, np.int64)
        self._kept_frame_ns = np.zeros(SECTORS, np.int64)
        self._established = np.zeros(SECTORS, np.bool_)
        self._lost_free_m, self._lost_ns = np.full(SECTORS, np.inf), np.zeros(SECTORS, np.int64)
        self._lost_lacking = np.zeros((SECTORS, avoid.slices, avoid.rays), np.bool_)
        self._losses = np.zeros(SECTORS, np.int64)
        self._kept_bits = np.zeros(SECTORS, np.uint8)  # the newest frame is the lowest bit
        self._lost_after_row = np.zeros(SECTORS, np.bool_)

    def take(self, found: SectorScan, sight: SectorSight) -> SectorScan:
        """Returns the scan to use.

        A sector is not kept once the vehicle has turned by half of the sector's width. Kept distances are shortened
        by the distance that the vehicle may have flown since."""
        seen = found.state != SectorState.UNSEEN
        speed_m_s = GREATEST_SPEED_M_S if sight.speed_m_s is None else sight.speed_m_s
        apart_m = np.abs(found.free_m - self._lost_free_m)
        other_heights = self._at_other_heights(found.lacking)
        elsewhere = apart_m > ELSEWHERE_M + speed_m_s * (sight.now_ns - self._lost_ns) / NS
        new_loss = ~seen & (sight.exposed_ns > self._frame_ns)
        kept = self._kept(seen, elsewhere, other_heights, sight)
        self._lost_free_m = np.where(new_loss, found.free_m, self._lost_free_m)
        self._lost_ns = np.where(new_loss, sight.now_ns, self._lost_ns)
        self._lost_lacking[new_loss] = found.lacking[new_loss]
        way_m = speed_m_s * (sight.now_ns - self._seen_ns) / NS
        before_m = np.maximum(0.0, self._distance_m - way_m)
        distance_m = np.where(kept, np.minimum(found.distance_m, before_m), found.distance_m)
        free_m = np.where(kept, np.maximum(0.0, self._free_m - way_m), found.free_m)
        far_m = self._avoid.max_distance_m
        kept &= (distance_m < far_m) | (
            free_m >= far_m - self._avoid.step_m
        )  # else it is not seen as far as a clear one
        distance_m, free_m = np.where(kept, distance_m, found.distance_m), np.where(kept, free_m, found.free_m)
        state = np.where(distance_m < far_m, SectorState.OBSTACLE, SectorState.CLEAR)
        self._distance_m = np.where(seen, found.distance_m, self._distance_m)
        self._free_m = np.where(seen, found.free_m, self._free_m)
        self._heading_rad = np.where(seen, sight.heading_rad, self._heading_rad)
        self._seen_exposed_ns = np.where(seen, sight.exposed_ns, self._seen_exposed_ns)
        self._seen_ns = np.where(seen, sight.now_ns, self._seen_ns)
        state = np.where(kept, state, found.state).astype(np.uint8)
        return SectorScan(state, distance_m, free_m, found.azimuth_rad, found.lacking)

    def _same_height(self, since_frame_ns: NDArray[np.int64], sight: SectorSight) -> NDArray[np.bool_]:
        """Returns (72,): the vehicle has hardly changed its height since the frame before. Heights are relative to
        it."""
        if sight.down_m_s is None:
            return np.zeros(SECTORS, np.bool_)
        slice_m = (self._avoid.band_above_m + self._avoid.band_below_m) / self._avoid.slices
        return np.asarray(abs(sight.down_m_s) * since_frame_ns / NS <= 0.5 * slice_m)

    def _at_other_heights(self, lacking: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns (72,): the rays missing now at the heights of the last loss, or next to them, are too few to lose
        the sector.

        Only heights are compared: an object that the vehicle passes moves over the rays of a sector from frame to
        frame."""
        rows: NDArray[np.bool_] = np.asarray(self._lost_lacking.any(axis=2))
        near = rows.copy()
        near[:, 1:] |= rows[:, :-1]
        near[:, :-1] |= rows[:, 1:]
        most = lacking[0].size - math.ceil(self._avoid.clear_share * lacking[0].size)
        common = (lacking & near[:, :, None]).sum(axis=(1, 2))
        # a loss that missing rays do not explain has another cause
        by_rays = (lacking.sum(axis=(1, 2)) > most) & (self._lost_lacking.sum(axis=(1, 2)) > most)
        return np.asarray(by_rays & (common <= most))

    def _kept(
        self,
        seen: NDArray[np.bool_],
        elsewhere: NDArray[np.bool_],
        other_heights: NDArray[np.bool_],
        sight: SectorSight,
    ) -> NDArray[np.bool_]:
        """Returns (72,): unseen sectors that are used as they were. A frame may be used by several decisions.

        Args:
            seen: (72,) sectors that are seen now.
            elsewhere: (72,) the free space ends at another place than at the last loss.
            other_heights: (72,) of `_at_other_heights`.
            sight: the views of the scan."""
        exposed_ns = sight.exposed_ns
        since_frame_ns = exposed_ns - self._frame_ns
        new = since_frame_ns > 0
        missed = since_frame_ns > LONGEST_KEPT_NS
        after_row = self._in_a_row >= SEEN_FRAMES
        first = ~seen & (after_row | (self._established & elsewhere & (self._in_a_row >= 1)))
        second = ~seen & new & ~missed & (self._losses == 1) & self._lost_after_row & other_heights
        second &= self._same_height(since_frame_ns, sight)
        self._kept_bits = np.where(new, self._kept_bits << 1, self._kept_bits).astype(np.uint8)
        before = np.unpackbits(self._kept_bits[:, None] & np.uint8(0xFE), axis=1).sum(axis=1)
        lost = (first | second) & (before < MOST_KEPT)
        self._kept_bits |= lost.astype(np.uint8)
        self._lost_after_row = np.where(~seen & new, after_row, self._lost_after_row)
        self._losses = np.where(new, np.where(seen, 0, self._losses + 1), self._losses)
        self._kept_frame_ns = np.where(seen, 0, np.where(lost, exposed_ns, self._kept_frame_ns))
        in_a_row = np.where(missed, 0, self._in_a_row) + 1  # a missing frame did not see it
        self._in_a_row = np.where(seen & ~sight.blind, np.where(new, in_a_row, self._in_a_row), 0)
        gone = sight.blind | (new & missed) | (~seen & new & ~first)
        self._established = (self._established & ~gone) | (self._in_a_row >= SEEN_FRAMES)
        self._interval_ns = np.where(seen & new, since_frame_ns, self._interval_ns)
        self._frame_ns = exposed_ns.copy()
        once_ns = np.minimum(LONGEST_KEPT_NS, KEPT_FRAMES * self._interval_ns)
        twice_ns = np.minimum(LONGEST_TWICE_NS, KEPT_TWICE * self._interval_ns)
        limit_ns = np.where(self._losses > 1, twice_ns, once_ns)
        turned = np.abs(np.remainder(sight.heading_rad - self._heading_rad + np.pi, math.tau) - np.pi)
        kept: NDArray[np.bool_] = ~seen & ~sight.blind & (exposed_ns > 0) & (self._kept_frame_ns == exposed_ns)
        kept &= turned < 0.5 * STEP_RAD
        kept &= (sight.now_ns - self._seen_ns <= limit_ns) & (exposed_ns - self._seen_exposed_ns <= limit_ns)
        return kept & (self._avoid.confirm_px > 0)
