"""Confirmation of near planes with weak support over several frames.

Single mismatches of a stereo camera, of 3 to 8 pixels, appear as planes anywhere before the true surface, in about 2 % of
the frames of a bare wall. If they were sent at once and remembered, each of them would stop the vehicle for seconds, and
PX4 v1.16 flies backwards from a plane nearer than CP_DIST. A plane of few pixels, or of pixels that cover less than
SMALL_M2, is therefore used only if a plane was found at its place in one of the FRAMES frames before, or in two of them if
its pixels cover less than TINY_M2. This delays a thin obstacle by one frame. A plane of more pixels is used at once."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.segment_distance import segment_distance_m
from core.types import FrameModel, Intrinsics

from ..config.avoidance import AvoidParams
from ..pipeline.multi_camera import heading_rad
from ..pipeline.results import PrismsResult
from ..pipeline.transform import LevelTransform

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
    """Planes of one frame."""

    t_ns: int  # exposure
    ends_m: NDArray[np.float64]  # (N, 4) a and b in north-aligned axes
    fixed: bool  # relative to the origin of ned; otherwise to the vehicle


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
    turn = LevelTransform(heading_rad(result) if result.attitude is not None else 0.0)
    turned = np.stack(turn.places(ends[:, [0, 2]], ends[:, [1, 3]]), axis=2).reshape(len(ends), 4)
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
    distance = segment_distance_m(middle, frame.ends_m[:, :2], frame.ends_m[:, 2:])
    return bool((distance <= slack_m + half_m).any())
