"""The section `[avoid]`: what the autopilot is told of obstacles (OBSTACLE_DISTANCE), and what when we are blind."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, choice, critical, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class AvoidParams:
    """The vehicle's size, the range told, and the policies. Raises ValueError naming the field, its value and range."""

    send: bool = switch(False, "tell the autopilot of obstacles; it brakes when its own parameters say so")
    rate_hz: float = critical(15.0, 10.0, 20.0, "Hz", "rate of the messages")
    radius_m: float = critical(0.4, 0.0, 5.0, "m", "of the vehicle, rotors included; distances count from there")
    band_above_m: float = critical(0.8, 0.1, 10.0, "m", "obstacles count from so much above the vehicle's middle")
    band_below_m: float = critical(0.8, 0.1, 10.0, "m", "down to so much below it")
    min_distance_m: float = critical(0.2, 0.0, 5.0, "m", "what is nearer is told as just beyond this")
    max_distance_m: float = critical(
        12.0, 2.0, 100.0, "m", "farthest obstacle told, and how far clear must have been seen"
    )
    near_m: float = critical(
        2.5, 0.5, 10.0, "m", "a sector must have been seen free from here on; nearer obstacles are always told"
    )
    clear_share: float = critical(0.8, 0.5, 1.0, "", "share of a sector's rays and heights seen free to call it clear")
    seen_share: float = critical(
        0.4, 0.2, 1.0, "", "share that must be seen at this instant before what was seen free earlier completes it"
    )
    remember_free_s: float = critical(
        3.0, 0.0, 10.0, "s", "free space that left the view, as when leaning, counts for so long; 0: never"
    )
    rays: int = critical(3, 2, 15, "", "rays looked along in each sector, from side to side")
    slices: int = critical(10, 1, 20, "", "heights looked along in the band")
    step_m: float = critical(0.25, 0.05, 2.0, "m", "step along the rays")
    remember_s: float = critical(3.0, 0.0, 30.0, "s", "a near obstacle that left the view is told for so long")
    remember_m: float = critical(6.0, 0.5, 50.0, "m", "obstacles nearer than this are remembered")
    blind: str = choice(
        "auto", ("auto", "unknown", "stop"), "when blind; auto: unknown for PX4, stop for all others", safety=True
    )
    unseen: str = choice(
        "stop",
        ("stop", "unknown"),
        "sectors in view nobody saw clear, where the autopilot takes unknown as clear",
        safety=True,
    )
    silence_s: float = critical(2.0, 0.5, 10.0, "s", "policy unknown: so long blind, then silence, which stops PX4")
    stop_inside_m: float = critical(
        0.04,
        0.0,
        0.09,
        "m",
        "policy stop: the wall's fence comes so far within AVOID_MARGIN; less than AVOID_BACKUP_DZ",
    )
    stop_hold_s: float = critical(
        3.0,
        0.0,
        8.0,
        "s",
        "policy stop: told to stop while armed, the service shows the wall for so long before it ends",
    )
    avoid_margin_m: float = critical(
        2.0, 0.5, 20.0, "m", "AVOID_MARGIN to believe in until the autopilot has told its own"
    )
    points: bool = switch(
        False, "ArduPilot: OBSTACLE_DISTANCE_3D instead, with layers above and below; work in progress there"
    )
    upward: bool = switch(False, "DISTANCE_SENSOR upward, where something was seen to stand over the vehicle")
    downward: bool = switch(
        False, "DISTANCE_SENSOR downward to the ground seen; the autopilot may take its height from it"
    )
    remember_up_s: float = critical(20.0, 0.0, 120.0, "s", "what stands over the vehicle's way is known for so long")
    recover_frames: int = critical(3, 1, 50, "", "good frames in a row after which a blind camera is believed again")

    def __post_init__(self) -> None:
        check("avoid", self)
        if self.min_distance_m + 0.1 > self.max_distance_m or self.near_m > self.max_distance_m:
            raise ValueError(
                f"[avoid] max_distance_m = {self.max_distance_m:g} must be greater than min_distance_m = "
                f"{self.min_distance_m:g} and near_m = {self.near_m:g}"
            )
