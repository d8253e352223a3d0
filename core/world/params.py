"""Parameters of the merged world."""

from __future__ import annotations

from dataclasses import dataclass

from ..param_field import check, critical, number


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldParams:
    """Parameters of the world. Raises ValueError naming the field, its value and its range."""

    # When two planes are one (section 5.3)
    plane_angle_deg: float = number(20.0, 1.0, 60.0, "deg", "planes within this angle may be one [phi0]")
    passable_width_m: float = critical(
        2.0, 0.2, 20.0, "m", "gap between facing ends below which planes may be one [Ws]; never across seen free space"
    )
    join_m: float = number(0.3, 0.05, 2.0, "m", "greatest distance of the ends from a joined plane, without noise")
    join_sigmas: float = number(2.0, 0.0, 6.0, "sigma", "noise of the farther plane that is added to join_m")
    join_noise_cap_m: float = number(0.5, 0.0, 2.0, "m", "upper bound of that noise")
    join_corner_m: float = number(
        0.5, 0.1, 3.0, "m", "a joined plane contains no empty square of this side at a corner"
    )
    short_m: float = number(1.0, 0.0, 5.0, "m", "planes shorter than this join at any angle below 90 degrees")
    longest_m: float = number(100.0, 5.0, 400.0, "m", "greatest length of a joined plane")

    # Weight of an observation
    pose_sigma_m: float = critical(0.1, 0.0, 5.0, "m", "error of the position and attitude, common to one frame")
    memory_frames: float = critical(
        40.0,
        1.0,
        10000.0,
        "",
        "earlier observations of a plane count at most as this many new ones, so that drift is followed",
    )

    # What goes again
    free_evidence_limit: int = critical(
        5,
        1,
        1000,
        "",
        "free evidence at which a step of a plane is removed: observations through it minus those onto it",
    )
    free_evidence_limit_extra: int = critical(
        15, 0, 1000, "", "the limit grows by one for every four earlier observations of the step, by at most this"
    )
    free_evidence_per_hit: int = critical(2, 1, 100, "", "free evidence that one observation of the step cancels")
    free_evidence_behind_m: float = critical(
        0.5, 0.0, 5.0, "m", "observed free space must reach this far behind a plane and its margin to be free evidence"
    )
    free_evidence_sigmas: float = critical(
        3.0, 0.0, 10.0, "sigma", "noise of the plane's distance that is added to free_evidence_behind_m"
    )
    free_evidence_share: float = critical(
        0.5, 0.05, 1.0, "", "least share of a plane's height that must be observed free"
    )
    free_evidence_step_m: float = critical(
        0.25, 0.05, 2.0, "m", "steps along a plane in which free evidence is counted"
    )

    # Free space that is remembered
    free_age_s: float = critical(
        60.0,
        1.0,
        3600.0,
        "s",
        "free space that is not seen again becomes unknown after half of this time to all of it",
    )
    most_free_blocks: int = number(
        4096,
        64,
        262144,
        "",
        "greatest number of blocks of 8 x 8 x 32 m of free space; those not seen for the longest time are removed",
    )

    # Bounds, jumps
    most_planes: int = critical(
        65536, 64, 4194304, "", "greatest number of planes; those not seen for the longest time are removed and counted"
    )
    jump_m: float = critical(
        1.0, 0.05, 100.0, "m", "a step of the position above jump_m + jump_speed_m_s * time begins a new section"
    )
    jump_speed_m_s: float = critical(30.0, 1.0, 500.0, "m/s", "speed in that limit")
    jump_gap_s: float = critical(5.0, 0.1, 3600.0, "s", "a longer time without a position begins a new section")
    restart_s: float = number(
        1.0,
        0.1,
        60.0,
        "s",
        "timestamps that step back by more than this, for as long, mean a restart: a new section begins",
    )
    most_sections: int = number(
        4, 0, 64, "", "greatest number of earlier sections that are kept; the oldest are removed and counted"
    )

    def __post_init__(self) -> None:
        check("world", self)
