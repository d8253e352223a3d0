"""Whether a camera can see a sector free as far as a clear sector must be: to [avoid] max_distance_m.

Otherwise the sector straight ahead of this camera is never clear: PX4 does not move there, and ArduPilot is sent the
artificial wall."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from core.frames import rotation_frd_optical
from core.params import Params
from core.types import CameraInfo

from .avoidance import AvoidParams
from .obstacle_range import obstacle_range_m

_BEFORE_M = 1e-3
"""A ring that ends at the range itself is not free."""
_FINE_RINGS, _MOST_RINGS = 16, 250
"""Number of rings of the free ranges that are half a step apart, the nearest ones, and of all rings. As in
core/stages/free_rings.py and free_space.py, of which the kernels are not needed here."""


STEEP_DEG = 45.0
"""A camera that looks more steeply up or down is not expected to find directions clear."""


def looks_ahead(info: CameraInfo) -> bool:
    """Whether a camera is expected to find directions clear."""
    down = float(rotation_frd_optical(info.mount)[2, 2])
    return abs(down) <= math.sin(math.radians(STEEP_DEG))


def clear_reach_m(info: CameraInfo, params: Params) -> float:
    """Returns the distance from the vehicle's middle to which a camera sees free space ahead of it, by its prior noise.

    Free ranges end at the last ring before the range up to which depths count as measured, less the camera's bias."""
    measured_m = _last_ring_m(params.profile_ring_m, obstacle_range_m(info, params=params) - _BEFORE_M)
    mount = info.mount
    ahead_m = mount.x_m * math.cos(mount.yaw_rad) + mount.y_m * math.sin(mount.yaw_rad)
    return measured_m / (1.0 + info.bias_per_m * measured_m) + ahead_m


def _last_ring_m(step_m: float, range_m: float) -> float:
    """Returns the distance of the last ring that is not beyond a range, 0 if there is none.

    step_m: profile_ring_m; range_m: see above."""
    half_steps = min(math.floor(2.0 * range_m / step_m), _FINE_RINGS)
    if half_steps < _FINE_RINGS:
        return 0.5 * step_m * half_steps
    return step_m * min(math.floor(range_m / step_m), _MOST_RINGS - _FINE_RINGS // 2)


def must_reach_m(avoid: AvoidParams) -> float:
    """Returns the distance of the last sample of a sector: it is seen in steps from near_m on."""
    steps = math.ceil((avoid.max_distance_m - avoid.near_m) / avoid.step_m - 1e-9)
    return avoid.near_m + max(steps, 0) * avoid.step_m


def clear_reach_text(info: CameraInfo, avoid: AvoidParams, params: Params) -> str:
    """Returns why the range of this camera is too short for a clear sector ahead, and what to do; empty: it is not."""
    reach_m = clear_reach_m(info, params)
    if must_reach_m(avoid) <= reach_m:
        return ""
    least_m = max(avoid.near_m, avoid.min_distance_m + 0.1)
    advised_m = math.floor(reach_m / avoid.step_m) * avoid.step_m
    remedy = (
        f"set [avoid] max_distance_m to at most {advised_m:g}"
        if advised_m >= least_m
        else "raise max_range_m of the camera, or lower [avoid] near_m"
    )
    return (
        f"camera {info.camera} sees free space up to {reach_m:.1f} m, and a clear sector must be seen free to [avoid] "
        f"max_distance_m = {avoid.max_distance_m:g} m: straight ahead of it no sector is ever clear; {remedy}"
    )


def clear_reach_texts(infos: Sequence[CameraInfo], avoid: AvoidParams, params: Params) -> list[str]:
    """Returns the text of clear_reach_text for the cameras of a vehicle that look ahead, except those straight ahead of which
    another one sees far enough: two cameras may find a sector clear together.

    Without the cameras it is not known whether they cover the height band; the service examines that."""
    far = [info for info in infos if not clear_reach_text(info, avoid, params)]
    return [
        text
        for info in infos
        if looks_ahead(info)
        and (text := clear_reach_text(info, avoid, params))
        and not any(_in_view(other, _straight_ahead(info)) for other in far)
    ]


def _straight_ahead(info: CameraInfo) -> tuple[float, float, float]:
    """Returns the horizontal direction in frd of the optical axis of a camera."""
    forward, right, _ = (float(c) for c in rotation_frd_optical(info.mount)[:, 2])
    length = math.hypot(forward, right)
    return forward / length, right / length, 0.0


def _in_view(info: CameraInfo, direction_frd: tuple[float, float, float]) -> bool:
    """Returns whether a direction lies in the image of a camera."""
    right, down, ahead = (float(c) for c in np.asarray(direction_frd) @ rotation_frd_optical(info.mount))
    k = info.intrinsics
    if ahead <= 0.0:
        return False
    u, v = k.fx * right / ahead + k.cx, k.fy * down / ahead + k.cy
    return 0.0 <= u <= k.width - 1 and 0.0 <= v <= k.height - 1
