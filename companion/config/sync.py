"""Section `[sync]` of the configuration: how far apart attitude, pose and frame may lie in time."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, critical, number, switch


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
    pose_max_gap_s: float = critical(0.5, 0.01, 5.0, "s", "greatest gap between two positions that is interpolated")
    pose_max_extrapolation_s: float = critical(
        0.2, 0.0, 2.0, "s", "greatest time over which the newest position is extrapolated by its velocity"
    )
    restart_step_s: float = number(
        1.0,
        0.1,
        60.0,
        "s",
        "timestamps that step back by more are a restart of the autopilot; those of a camera, when its frames have "
        "done so for this time",
    )
    held_samples: int = number(256, 8, 4096, "", "number of attitudes, and of positions, that are kept for late frames")
    use_pose: bool = switch(True, "publish in ned where the position is known, otherwise always in level")

    def __post_init__(self) -> None:
        check("sync", self)
