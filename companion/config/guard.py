"""The section `[guard]`: stop before obstacles in the modes in which the autopilot does not brake by itself."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, critical, number, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardParams:
    """When the guard asks the autopilot to slow down or to stop. Raises ValueError naming the field, its value and range."""

    enabled: bool = switch(
        False,
        "ask the autopilot to stop where the braking distance does not fit into the space seen free; needs [avoid] send",
    )
    mission: bool = switch(True, "active in Mission (PX4) and AUTO (ArduPilot)", safety=True)
    return_home: bool = switch(True, "active in Return (PX4), RTL and SMART_RTL (ArduPilot)", safety=True)
    guided: bool = switch(True, "active in Offboard (PX4) and GUIDED (ArduPilot)", safety=True)
    limit_speed: bool = switch(True, "ask for a lower speed before asking to stop", safety=True)
    deceleration_m_s2: float = critical(
        2.0,
        0.3,
        10.0,
        "m/s2",
        "measured deceleration when the autopilot is asked to stop; larger: later stops",
    )
    reaction_s: float = critical(
        0.8,
        0.2,
        3.0,
        "s",
        "measured time from the decision to the deceleration; larger: earlier stops",
    )
    margin_m: float = critical(
        1.5, 0.2, 10.0, "m", "distance between hull and obstacle that is kept; larger: earlier stops"
    )
    side_m: float = critical(0.3, 0.0, 3.0, "m", "width beside the hull, on each side, that must be free")
    horizon_m: float = critical(
        20.0, 4.0, 60.0, "m", "greatest distance along the path that is used; it bounds the speed without a limit"
    )
    cruise_m_s: float = number(
        0.0,
        0.0,
        30.0,
        "m/s",
        "greatest speed that the guard commands, also at the end of a limit; 0: the speed just before the limit",
    )

    def __post_init__(self) -> None:
        check("guard", self)
