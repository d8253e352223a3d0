"""Parameters of the merged world."""

from __future__ import annotations

from dataclasses import dataclass

from ..param_field import check, critical, number


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldParams:
    """Parameters of the world. Raises ValueError naming the field, its value and its range."""

    # When two planes are one
    passable_width_m: float = critical(
        2.0, 0.2, 20.0, "m", "gap between facing ends below which planes may be one [Ws]; never across seen free space"
    )
    longest_m: float = number(100.0, 5.0, 400.0, "m", "greatest length of a joined plane")

    # The position estimate
    pose_sigma_m: float = critical(0.1, 0.0, 5.0, "m", "error of the position and attitude, common to one frame")

    # Free space that is remembered
    free_age_s: float = critical(
        60.0, 1.0, 3600.0, "s", "free space that is not seen again becomes unknown after half of this time to all of it"
    )
    most_free_blocks: int = number(
        4096, 64, 262144, "", "blocks of 8 x 8 x 32 m of free space held; those unseen for the longest time are removed"
    )

    # Bounds, jumps
    most_planes: int = critical(
        65536, 64, 4194304, "", "greatest number of planes; those not seen for the longest time are removed and counted"
    )
    jump_m: float = critical(
        1.0, 0.05, 100.0, "m", "a step of the position above jump_m + jump_speed_m_s * time begins a new section"
    )
    jump_speed_m_s: float = critical(30.0, 1.0, 500.0, "m/s", "speed in that limit")
    most_sections: int = number(
        4, 0, 64, "", "greatest number of earlier sections whose planes are kept; the oldest are removed and counted"
    )

    def __post_init__(self) -> None:
        check("world", self)
