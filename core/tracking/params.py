"""Parameters of the tracked obstacles, section `[tracking]` of the configuration."""

from __future__ import annotations

from dataclasses import dataclass

from ..param_field import check, critical, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingParams:
    """Parameters of the tracker. Raises ValueError naming the field, its value and its range."""

    enabled: bool = switch(False, "track obstacles over frames, publish and record them; nothing else depends on it")

    memory_s: float = critical(
        10.0,
        0.5,
        120.0,
        "s",
        "an obstacle that is hidden or out of view is removed after this time; sooner where one frame alone observed "
        "it, or where fewer than ten did and it is hidden",
    )
    memory_without_position_s: float = critical(
        2.0,
        0.2,
        30.0,
        "s",
        "an obstacle is removed sooner, after so much time without a position of the vehicle, where its place becomes "
        "uncertain",
    )
    speed_error_m_s: float = critical(
        5.0,
        0.0,
        20.0,
        "m/s",
        "margins of obstacles grow by this for each second without a position since they were detected; at least the "
        "greatest speed flown so",
    )
    most_tracks: int = critical(
        2048, 64, 16384, "", "tracks held; those unobserved longest are removed and counted (`evicted`, `left_out`)"
    )

    def __post_init__(self) -> None:
        check("tracking", self)
