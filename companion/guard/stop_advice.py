"""Checks that ArduCopter lets the guard change to its stop modes.

FLTMODE_GCSBLOCK refuses flight modes to commands (MAV_CMD_DO_SET_MODE), also to those of the guard. Its bits are not
the numbers of the modes. Source: Copter::gcs_mode_enabled in ArduCopter's mode.cpp."""

from __future__ import annotations

from typing import Final

from drivers.mavlink.session_types import ARDUPILOT

from ..autopilot.parameter_fault import AutopilotFacts

_LOITER_BIT, _BRAKE_BIT = 1 << 5, 1 << 12
_WITHOUT: Final = {
    _BRAKE_BIT: ("BRAKE", "the guard stops with LOITER alone, which reads the throttle stick"),
    _LOITER_BIT: ("LOITER", "the guard has no second stop mode where BRAKE is refused"),
    _BRAKE_BIT | _LOITER_BIT: ("BRAKE and LOITER", "it cannot stop the vehicle"),
}


def stop_advice(facts: AutopilotFacts) -> list[str]:
    """Returns the fault of FLTMODE_GCSBLOCK, as text; empty: none, or it was not read."""
    blocked = int(facts.values.get("FLTMODE_GCSBLOCK", 0.0)) if facts.kind == ARDUPILOT else 0
    refused = _WITHOUT.get(blocked & (_BRAKE_BIT | _LOITER_BIT))
    if refused is None:
        return []
    modes, effect = refused
    kept = blocked & ~(_BRAKE_BIT | _LOITER_BIT)
    return [f"FLTMODE_GCSBLOCK = {blocked} refuses {modes} to the guard: {effect}; set it to {kept}"]
