"""The kinds of live cameras: one entry each, read by the configuration, its checks and `companion setup`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraKind:
    """One kind of live camera. CONTRIBUTING describes how to add one."""

    # keys of `[[camera]]` that must be set, since neither the device nor a default gives them
    needs: tuple[str, ...] = ()
    # keys of `[[camera]]` that it reads and some other kind does not
    own_keys: tuple[str, ...]
    # its device is a path below /dev; another path is a file, whose images would count as taken now
    is_video: bool = False
    owns_device: bool = True  # no two cameras may have the same device
    # width_px, height_px, fps, exposure_latency_s, max_range_m: written by `companion setup`, as in the shipped configuration
    width_px: int
    height_px: int
    fps: float = 30.0
    exposure_latency_s: float = 0.0  # 0: the driver stamps the exposure
    max_range_m: float
    # distance to which a clear sector is seen free, written by `companion setup` as `[avoid] max_distance_m`. Less than
    # what noise and bias leave of the range, so that more noise than assumed does not close every direction.
    clear_m: float
    # typical_range_m, typical_ke_per_m, typical_bias_per_m: what its driver reports of a common model, for checks that
    # do not open the device
    typical_range_m: float
    typical_ke_per_m: float
    typical_bias_per_m: float


_MATCHED = ("disparities", "match_correlation", "match_texture", "match_period", "mark_smooth")

CAMERA_KINDS: Final = {
    "oak": CameraKind(
        own_keys=(*_MATCHED, "match_on", "confidence", "emitter"),
        width_px=640,
        height_px=400,
        max_range_m=15.0,
        clear_m=9.0,
        typical_range_m=15.0,  # OAK-D
        typical_ke_per_m=0.0076,
        typical_bias_per_m=0.0045,
    ),
    "zed": CameraKind(
        needs=("device", "calibration"),
        own_keys=(*_MATCHED, "calibration", "exposure_latency_s"),
        is_video=True,
        width_px=672,
        height_px=376,
        fps=15.0,
        exposure_latency_s=0.02,
        max_range_m=12.0,
        clear_m=8.0,
        typical_range_m=15.0,  # ZED 2
        typical_ke_per_m=0.0071,
        typical_bias_per_m=0.0037,
    ),
    "v4l2": CameraKind(
        needs=("device", "fx_px", "fy_px", "cx_px", "cy_px"),
        own_keys=("fx_px", "fy_px", "cx_px", "cy_px", "depth_unit_mm", "serial", "exposure_latency_s"),
        is_video=True,
        width_px=640,
        height_px=480,
        exposure_latency_s=0.015,
        max_range_m=6.0,
        clear_m=4.5,
        typical_range_m=10.0,  # RealSense D435
        typical_ke_per_m=0.005,
        typical_bias_per_m=0.01,
    ),
    "simulated": CameraKind(
        own_keys=(
            *("disparities", "mark_smooth", "exposure_latency_s"),
            *("flight", "follow", "seed", "render", "sky_is_far"),
        ),
        owns_device=False,
        width_px=640,
        height_px=480,
        max_range_m=20.0,
        clear_m=12.0,
        typical_range_m=20.0,
        typical_ke_per_m=0.0015,
        typical_bias_per_m=0.0,
    ),
}
"""Kind, as in `[[camera]] kind` -> what is known of it. companion/cameras/factory.py creates the source of each."""

RECORDED: Final = "mcap"
"""The kind of a camera whose frames come from a log."""


def ignored_keys(kind: str) -> frozenset[str]:
    """The keys of `[[camera]]` that a live kind does not read, since they are those of other kinds; none for a recording."""
    if kind not in CAMERA_KINDS:
        return frozenset()
    return frozenset(key for k in CAMERA_KINDS.values() for key in k.own_keys).difference(CAMERA_KINDS[kind].own_keys)


def live_kinds() -> str:
    """The kinds of live cameras as text, such as "oak, zed or simulated"."""
    *others, last = CAMERA_KINDS
    return f"{', '.join(others)} or {last}"
