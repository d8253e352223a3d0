"""Near planes with little support need a second frame before the autopilot is sent them.

Single mismatches of a stereo camera, of 3 to 8 pixels, appear as planes anywhere before the true surface, in about 2 % of the
frames before a bare wall. Sent at once and remembered, each of them stops the vehicle for seconds, and PX4 v1.16 flies
backwards from one nearer than CP_DIST. A plane of few pixels is therefore used only if a plane was found at its place in one
of the FRAMES frames before. It costs a thin obstacle one frame; a plane of more pixels is used at once.

The same holds for free space: a mismatch ends it in one direction of one frame. A sector that a single frame does not see stays
as the frame before saw it, until a second frame does not see it either.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel

from ..config.avoidance import AvoidParams
from ..pipeline.multi_camera import heading_rad
from ..pipeline.pipeline import PrismsResult
from .polar_histogram import SECTORS, STEP_RAD, SectorScan, SectorState

NS = 1_000_000_000
FRAMES = 3
"""A plane found in any of so many frames before confirms one at its place: thin obstacles are not found in each frame."""
LONGEST_NS = NS // 2
"""Older frames confirm nothing."""
PLACE_M = 0.3
SIGMAS = 4.0
UNKNOWN_WAY_M = 0.5
"""Without a position: the vehicle may have moved by so much from one frame to the next."""
FULL_IMAGE_PX = 320 * 240
"""`confirm_px` is meant for an image of so many pixels; it grows with the image."""


@dataclass(frozen=True, slots=True, eq=False)
class _Planes:
    """Planes of one frame. ends_m: (N, 4) a and b in north-aligned axes; fixed: counted from the origin of ned, else from the
    vehicle."""

    t_ns: int
    ends_m: NDArray[np.float64]
    fixed: bool


class PlaneConfirmation:
    """`take` each valid result of one camera, in order."""

    def __init__(self, avoid: AvoidParams, image_px: int) -> None:
        self._avoid = avoid
        self._least_px = avoid.confirm_px * max(1.0, image_px / FULL_IMAGE_PX)
        self._frames: deque[_Planes] = deque(maxlen=FRAMES)

    def take(self, result: PrismsResult) -> PrismsResult:
        """The result without the planes that are near, have little support, and were not found before."""
        model = result.model
        assert model is not None
        if not np.isfinite(model.planes[:, :4]).all():  # refused by whoever uses it
            return result
        planes = _north_aligned(result, model)
        recent = [f for f in self._frames if 0 < planes.t_ns - f.t_ns <= LONGEST_NS]
        doubtful = np.zeros(len(model.planes), np.bool_)
        if self._avoid.confirm_px > 0:
            range_m = _range_m(result, planes)
            weak = (model.support_px <= self._least_px) & (range_m < self._avoid.remember_m + self._avoid.radius_m)
            for i in np.flatnonzero(weak):
                slack_m = PLACE_M + SIGMAS * model.ke_per_m * float(range_m[i]) ** 2
                doubtful[i] = not any(_found(planes, int(i), frame, slack_m) for frame in recent)
        self._frames.append(planes)
        return replace(result, model=without(model, doubtful)) if doubtful.any() else result


def without(model: FrameModel, left_out: NDArray[np.bool_]) -> FrameModel:
    """The model without some of its planes, (N,) True, and without prisms. Its free space stays as it was measured."""
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
    ends = model.planes[:, :4].astype(np.float64)
    if result.frame == "ned":
        return _Planes(result.t_exposure_ns, ends, fixed=True)
    c, s = (math.cos(heading_rad(result)), math.sin(heading_rad(result))) if result.attitude is not None else (1.0, 0.0)
    x, y = ends[:, [0, 2]], ends[:, [1, 3]]
    turned = np.stack([c * x - s * y, s * x + c * y], axis=2).reshape(len(ends), 4)
    return _Planes(result.t_exposure_ns, turned, fixed=False)


def _range_m(result: PrismsResult, planes: _Planes) -> NDArray[np.float64]:
    """(N,) from the vehicle to the middle of each plane."""
    here = np.array(result.pose.position_ned_m[:2]) if planes.fixed and result.pose is not None else np.zeros(2)
    middle = 0.5 * (planes.ends_m[:, :2] + planes.ends_m[:, 2:]) - here
    out: NDArray[np.float64] = np.hypot(middle[:, 0], middle[:, 1])
    return out


def _found(planes: _Planes, i: int, frame: _Planes, slack_m: float) -> bool:
    """Whether a frame has a plane at the place of plane i."""
    if not len(frame.ends_m) or planes.fixed != frame.fixed:
        return False
    if not planes.fixed:
        slack_m += UNKNOWN_WAY_M
    middle = 0.5 * (planes.ends_m[i, :2] + planes.ends_m[i, 2:])
    half_m = 0.5 * float(np.hypot(*(planes.ends_m[i, 2:] - planes.ends_m[i, :2])))
    a, along = frame.ends_m[:, :2], frame.ends_m[:, 2:] - frame.ends_m[:, :2]
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((middle - a) * along).sum(axis=1) / length2, 0.0, 1.0)
    distance = np.hypot(*(a + share[:, None] * along - middle).T)
    return bool((distance <= slack_m + half_m).any())


class SeenSectors:
    """`take` each scan: keeps a sector that a single frame does not see as it was seen before."""

    def __init__(self, stale_ns: int) -> None:
        """stale_ns: what was seen longer ago is not kept."""
        self._stale_ns = stale_ns
        self._distance_m, self._free_m = np.full(SECTORS, np.inf), np.zeros(SECTORS)
        self._heading_rad = np.zeros(SECTORS)
        self._seen_ns = np.zeros(SECTORS, np.int64)
        self._lost_ns = np.zeros(SECTORS, np.int64)

    def take(
        self, found: SectorScan, exposed_ns: NDArray[np.int64], heading: float, now_ns: int, farthest_m: float
    ) -> SectorScan:
        """The scan to use. exposed_ns: (72,) exposure of the newest frame that covers each sector, 0: none. heading: of the
        vehicle, clockwise from north, rad; a sector is not kept once the vehicle has turned by half of its width.
        farthest_m: obstacles from there on are not sent."""
        seen = found.state != SectorState.UNSEEN
        turned = np.abs(np.remainder(heading - self._heading_rad + np.pi, math.tau) - np.pi)
        self._lost_ns = np.where(seen, 0, np.where(self._lost_ns == 0, exposed_ns, self._lost_ns))
        kept = ~seen & (exposed_ns > 0) & (self._lost_ns == exposed_ns) & (turned < 0.5 * STEP_RAD)
        kept &= (self._seen_ns > 0) & (now_ns - self._seen_ns <= self._stale_ns)
        distance_m = np.where(kept, np.minimum(found.distance_m, self._distance_m), found.distance_m)
        state = np.where(distance_m < farthest_m, SectorState.OBSTACLE, SectorState.CLEAR)
        self._distance_m = np.where(seen, found.distance_m, self._distance_m)
        self._free_m = np.where(seen, found.free_m, self._free_m)
        self._heading_rad = np.where(seen, heading, self._heading_rad)
        self._seen_ns = np.where(seen, exposed_ns, self._seen_ns)
        return SectorScan(
            np.where(kept, state, found.state).astype(np.uint8),
            distance_m,
            np.where(kept, self._free_m, found.free_m),
            found.azimuth_rad,
        )
