"""Parameters of the tracked obstacles, section `[tracking]` of the configuration."""

from __future__ import annotations

from dataclasses import dataclass

from ..param_field import check, critical, number, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingParams:
    """Parameters of the tracker. Raises ValueError naming the field, its value and its range."""

    enabled: bool = switch(False, "track obstacles over frames, publish and record them; nothing else depends on it")

    # How long an obstacle is kept without an observation
    memory_s: float = critical(
        10.0,
        0.5,
        120.0,
        "s",
        "an obstacle that is hidden or out of view is removed after this time; sooner where one frame alone observed it, or where fewer than ten did and it is hidden",
    )
    memory_without_position_s: float = critical(
        2.0, 0.2, 30.0, "s", "the same without a position of the vehicle, where its place becomes uncertain"
    )
    speed_error_m_s: float = critical(
        5.0,
        0.0,
        20.0,
        "m/s",
        "without a position, margins of obstacles grow by this for each second out of view; at least the greatest speed flown so",
    )
    most_tracks: int = critical(
        2048,
        64,
        16384,
        "",
        "tracks held; those not observed longest are removed, and counted in `Tracks` (evicted, left_out)",
    )

    # When a plane of a frame is an observation of a track
    gate_sigmas: float = number(2.0, 0.5, 6.0, "sigma", "largest distance of an observation from the track's line")
    gate_min_m: float = number(0.15, 0.02, 1.0, "m", "distance that is always accepted")
    gate_max_m: float = number(0.4, 0.05, 2.0, "m", "distance that is never exceeded")
    pose_sigma_m: float = number(0.03, 0.0, 2.0, "m", "error of position and attitude from frame to frame")
    drift_m: float = number(0.03, 0.001, 1.0, "m", "change of a track's place within one second, standard deviation")
    turn_deg: float = number(1.0, 0.01, 30.0, "deg", "change of a track's direction within one second")
    shrink_share: float = number(
        0.1, 0.01, 1.0, "", "share of the difference by which a track shrinks to a smaller observation, each frame"
    )

    # When an obstacle is removed
    free_evidence_frames: int = critical(
        4, 2, 100, "", "frames that must observe free space through an obstacle; fewer where it was observed less often"
    )
    free_evidence_behind_m: float = critical(
        0.3, 0.0, 5.0, "m", "observed free space must reach this far behind an obstacle and its margin"
    )
    free_evidence_sigmas: float = critical(
        2.0, 0.0, 10.0, "sigma", "noise of its distance that is added to free_evidence_behind_m"
    )

    # Moving obstacles
    mover_min_speed_m_s: float = number(0.5, 0.1, 10.0, "m/s", "slower obstacles are static")
    mover_max_speed_m_s: float = number(15.0, 1.0, 60.0, "m/s", "faster motion is not associated")
    mover_sigmas: float = number(
        4.0, 1.0, 20.0, "sigma", "least speed of a moving obstacle, as a multiple of its error"
    )
    mover_max_size_m: float = number(7.0, 0.5, 30.0, "m", "larger groups of planes are static")

    def __post_init__(self) -> None:
        check("tracking", self)
        if self.gate_min_m > self.gate_max_m:
            raise ValueError(
                f"tracking: gate_min_m = {self.gate_min_m:g} exceeds gate_max_m = {self.gate_max_m:g}; make it smaller"
            )
