"""Section `[sync]` of the configuration: how far apart attitude, pose and frame may lie in time."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, critical, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncParams:
    """Bounds of the synchronisation. Raises ValueError naming the field, its value and its range."""

    max_gap_s: float = critical(
        0.15,
        0.005,
        1.0,
        "s",
        "greatest gap between two attitudes that is interpolated; else the frame is dropped",
    )
    max_extrapolation_s: float = critical(
        0.05, 0.0, 0.5, "s", "greatest time over which the newest attitude is extrapolated by its body rates"
    )
    max_clock_error_deg: float = critical(
        3.0,
        0.5,
        30.0,
        "deg",
        "greatest turn within the error of the autopilot's timestamps; frames in faster turns are dropped",
    )
    max_clock_error_m: float = critical(
        0.25,
        0.02,
        5.0,
        "m",
        "greatest distance flown within the error of the autopilot's timestamps; beyond it frames have no position",
    )
    pose_max_extrapolation_s: float = critical(
        0.2, 0.0, 2.0, "s", "greatest time over which the newest position is extrapolated by its velocity"
    )
    use_pose: bool = switch(True, "publish in ned where the position is known, otherwise always in level")

    def __post_init__(self) -> None:
        check("sync", self)
