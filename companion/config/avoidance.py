"""The section `[avoid]`: which obstacles the autopilot receives (OBSTACLE_DISTANCE), and what it receives without depth."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, choice, critical, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class AvoidParams:
    """The vehicle's size, the reported range, and the policies. Raises ValueError naming the field, its value and range."""

    send: bool = switch(False, "send obstacles to the autopilot; whether it brakes depends on its own parameters")
    rate_hz: float = critical(15.0, 10.0, 20.0, "Hz", "rate of the obstacle messages")
    radius_m: float = critical(
        0.4, 0.0, 5.0, "m", "radius of the vehicle, rotors included; distances are measured from its hull"
    )
    band_above_m: float = critical(
        0.8, 0.1, 10.0, "m", "obstacles up to this height above the middle of the vehicle are sent"
    )
    band_below_m: float = critical(
        0.8,
        0.1,
        10.0,
        "m",
        "obstacles down to this depth below the middle of the vehicle are sent; larger: the ground closes all "
        "directions earlier",
    )
    min_distance_m: float = critical(0.2, 0.0, 5.0, "m", "nearer obstacles are sent as just beyond this")
    max_distance_m: float = critical(
        12.0,
        2.0,
        100.0,
        "m",
        "greatest distance of an obstacle that is sent; a clear sector must have been seen free up to it",
    )
    near_m: float = critical(
        2.5, 0.5, 10.0, "m", "a clear sector must have been seen free from here on; nearer obstacles are always sent"
    )
    clear_share: float = critical(
        0.8,
        0.5,
        1.0,
        "",
        "least share of a clear sector's rays and heights that were seen free; larger: fewer clear sectors",
    )
    remember_free_s: float = critical(
        3.0, 0.0, 10.0, "s", "free space that left the view, as by leaning, is used for this time; 0: never"
    )
    rays: int = critical(3, 2, 15, "", "number of rays that are checked in each sector")
    slices: int = critical(10, 1, 20, "", "number of heights that are checked in the height band")
    step_m: float = critical(0.25, 0.05, 2.0, "m", "step along the rays; smaller: finer and slower")
    remember_s: float = critical(3.0, 0.0, 30.0, "s", "a near obstacle that left the view is still sent for this time")
    remember_m: float = critical(6.0, 0.5, 50.0, "m", "obstacles nearer than this are remembered")
    confirm_px: int = critical(
        8,
        0,
        1000,
        "px",
        "an obstacle nearer than remember_m with at most this many pixels (at 320x240; more in larger images), or of "
        "less than 10 cm2, is sent when a second frame shows it; 0: at once",
    )
    blind: str = choice(
        "auto",
        ("auto", "unknown", "stop"),
        "what is sent when blind; auto: a wall for PX4 (unknown while CP_DIST is not known), stop for others",
        safety=True,
    )
    unseen: str = choice(
        "stop",
        ("stop", "unknown"),
        "what is sent for unseen sectors in view to an autopilot that treats unknown as clear",
        safety=True,
    )
    silence_s: float = critical(
        2.0,
        0.5,
        10.0,
        "s",
        "PX4: time of blindness after which nothing more is sent and PX4 (MAV_SYS_ID 1) changes to Hold; duration of its wall",
    )
    stop_hold_s: float = critical(
        3.0,
        0.0,
        8.0,
        "s",
        "policy stop: stopped while armed, the service sends the wall for this time before it ends",
    )
    avoid_margin_m: float = critical(2.0, 0.5, 20.0, "m", "AVOID_MARGIN that is used until the parameter has been read")
    points: bool = switch(
        False, "ArduPilot: send OBSTACLE_DISTANCE_3D instead, with layers above and below (work in progress in MAVLink)"
    )
    upward: bool = switch(False, "send DISTANCE_SENSOR upward where an obstacle above the vehicle was seen")
    downward: bool = switch(
        False, "send DISTANCE_SENSOR downward to the ground; the autopilot may use it for its height"
    )
    remember_up_s: float = critical(
        20.0, 0.0, 120.0, "s", "an obstacle above that left the view is remembered for this time"
    )
    recover_frames: int = critical(3, 1, 50, "", "valid frames in a row after which a blind camera is used again")

    def __post_init__(self) -> None:
        check("avoid", self)
        if self.min_distance_m + 0.1 > self.max_distance_m or self.near_m > self.max_distance_m:
            raise ValueError(
                f"[avoid] max_distance_m = {self.max_distance_m:g} must be greater than min_distance_m = "
                f"{self.min_distance_m:g} and near_m = {self.near_m:g}"
            )
