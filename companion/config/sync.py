"""Section `[sync]` of the configuration: how far apart attitude, pose and frame may lie in time."""

from __future__ import annotations

from dataclasses import dataclass, field

from core.param_field import check, critical, number


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncParams:
    """Bounds of the synchronisation. Raises ValueError naming the field, its value and its range."""

    max_gap_s: float = critical(0.15, 0.005, 1.0, "s", "widest gap between two attitudes that is interpolated across")
    max_extrapolation_s: float = critical(0.05, 0.0, 0.5, "s", "farthest an attitude is carried by its body rates")
    pose_max_gap_s: float = critical(
        0.5, 0.01, 5.0, "s", "widest gap between two positions that is interpolated across"
    )
    pose_max_extrapolation_s: float = critical(0.2, 0.0, 2.0, "s", "farthest a position is carried by its velocity")
    restart_step_s: float = number(1.0, 0.1, 60.0, "s", "stamps that step back this far mean a restart: start again")
    held_samples: int = number(256, 8, 4096, "", "attitudes, and positions, held for late frames")
    use_pose: bool = field(default=True, metadata={"unit": "", "doc": "publish in ned where the position is known"})

    def __post_init__(self) -> None:
        check("sync", self)
