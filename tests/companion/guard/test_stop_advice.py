"""ArduCopter's parameter that refuses flight modes to a command: the guard could not stop the vehicle."""

from __future__ import annotations

import pytest

from companion.autopilot.parameter_fault import AutopilotFacts
from companion.guard.stop_advice import stop_advice
from drivers.mavlink.session_types import ARDUPILOT, PX4

BRAKE, LOITER, POSHOLD = 1 << 12, 1 << 5, 1 << 11


def advised(kind: str, blocked: int | None) -> str:
    """The advice for a value of FLTMODE_GCSBLOCK; None: not read."""
    values = {} if blocked is None else {"FLTMODE_GCSBLOCK": float(blocked)}
    return "\n".join(stop_advice(AutopilotFacts(kind=kind, values=values)))


@pytest.mark.parametrize(
    ("kind", "blocked"), [(ARDUPILOT, None), (ARDUPILOT, 0), (ARDUPILOT, 1 << 17), (PX4, BRAKE), (ARDUPILOT, POSHOLD)]
)
def test_nothing_is_said_while_the_stop_modes_are_permitted(kind: str, blocked: int | None) -> None:
    assert advised(kind, blocked) == ""


def test_a_blocked_mode_and_what_is_left_without_it_are_named() -> None:
    assert advised(ARDUPILOT, BRAKE | LOITER).startswith(
        "FLTMODE_GCSBLOCK = 4128 refuses BRAKE and LOITER to the guard: it cannot stop the vehicle;"
    )
    assert "the guard stops with LOITER alone" in advised(ARDUPILOT, BRAKE)
    assert "no second stop mode" in advised(ARDUPILOT, LOITER | 1)
    for blocked in (BRAKE | LOITER | 3, BRAKE, LOITER):
        kept = blocked & ~(BRAKE | LOITER)
        assert f"set it to {kept}" in advised(ARDUPILOT, blocked)
