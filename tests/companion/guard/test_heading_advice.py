"""Which parameters of the heading let the camera look along the path, for the guard."""

from __future__ import annotations

import math

import pytest

from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.parameters import ParameterReader
from companion.config.guard import GuardParams
from companion.guard.heading_advice import heading_advice, look_all_around

PX4, ARDUPILOT = "PX4", "ArduPilot"
ON = GuardParams(enabled=True)
NO_RETURN = GuardParams(enabled=True, return_home=False)
RETURN_ALONE = GuardParams(enabled=True, mission=False)


def advice_for(kind: str, guard: GuardParams = ON, **values: float) -> str:
    return "\n".join(heading_advice(AutopilotFacts(kind=kind, values=values), guard))


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (PX4, {"MPC_YAW_MODE": 4.0}),
        (PX4, {"MPC_YAW_MODE": 4.0, "RTL_HDG_MD": 0.0}),
        (ARDUPILOT, {"WP_YAW_BEHAVIOR": 1.0}),
        (PX4, {}),
        (ARDUPILOT, {}),
        ("", {"MPC_YAW_MODE": 1.0, "WP_YAW_BEHAVIOR": 0.0}),
    ],
)
def test_a_camera_along_the_path_is_not_reported(kind: str, values: dict[str, float]) -> None:
    assert advice_for(kind, **values) == ""


@pytest.mark.parametrize("mode", [0.0, 1.0, 2.0, 3.0, 5.0, 6.0])
def test_px4_that_does_not_turn_before_it_flies(mode: float) -> None:
    text = advice_for(PX4, MPC_YAW_MODE=mode)
    assert f"MPC_YAW_MODE = {mode:g}" in text
    assert "set it to 4" in text


@pytest.mark.parametrize("mode", [1.0, 2.0])
def test_px4_that_returns_with_another_heading(mode: float) -> None:
    """RTL_HDG_MD exists up to PX4 v1.14."""
    text = advice_for(PX4, MPC_YAW_MODE=4.0, RTL_HDG_MD=mode)
    assert f"RTL_HDG_MD = {mode:g}" in text
    assert "set it to 0" in text
    assert advice_for(PX4, NO_RETURN, MPC_YAW_MODE=4.0, RTL_HDG_MD=mode) == ""


def test_px4_s_yaw_mode_decides_in_a_return_where_no_parameter_of_the_return_exists() -> None:
    assert "MPC_YAW_MODE = 1" in advice_for(PX4, RETURN_ALONE, MPC_YAW_MODE=1.0)


@pytest.mark.parametrize("behaviour", [0.0, 3.0, 7.0])
def test_arducopter_that_does_not_face_the_next_waypoint(behaviour: float) -> None:
    text = advice_for(ARDUPILOT, WP_YAW_BEHAVIOR=behaviour)
    assert f"WP_YAW_BEHAVIOR = {behaviour:g}" in text
    assert "set it to 1" in text


def test_arducopter_s_default_is_blind_in_rtl_alone() -> None:
    text = advice_for(ARDUPILOT, WP_YAW_BEHAVIOR=2.0)
    assert "RTL" in text
    assert "return_home = false" in text
    assert advice_for(ARDUPILOT, NO_RETURN, WP_YAW_BEHAVIOR=2.0) == ""


def test_no_advice_while_neither_missions_nor_returns_are_guarded() -> None:
    guided = GuardParams(enabled=True, mission=False, return_home=False)
    assert advice_for(PX4, guided, MPC_YAW_MODE=1.0) == advice_for(ARDUPILOT, guided, WP_YAW_BEHAVIOR=0.0) == ""


@pytest.mark.parametrize(
    ("yaws_deg", "around"),
    [
        ((0,), False),
        ((0, 180), False),
        ((-45, 0, 45), False),
        ((0, 120, -120), True),
        ((0, 90, 180, -90), True),
        ((), False),
    ],
)
def test_cameras_all_around(yaws_deg: tuple[int, ...], around: bool) -> None:
    assert look_all_around([math.radians(y) for y in yaws_deg]) == around


def test_the_parameters_are_requested_for_the_guard_alone() -> None:
    for kind, name in (
        (PX4, "MPC_YAW_MODE"),
        (PX4, "RTL_HDG_MD"),
        (ARDUPILOT, "WP_YAW_BEHAVIOR"),
        (ARDUPILOT, "FLTMODE_GCSBLOCK"),
    ):
        for guard in (False, True):
            reader = ParameterReader(guard=guard)
            reader.begin(kind)
            asked: set[str] = set()
            for n in range(8):
                asked |= {str(m.param_id) for m in reader.due((n + 1) * 100_000_000, 1)}
            assert (name in asked) == guard


def test_a_missing_yaw_mode_is_reported_and_a_missing_return_heading_is_not() -> None:
    reader = ParameterReader(guard=True)
    reader.begin(PX4)
    for n in range(40):
        reader.due((n + 1) * 1_000_000_000, 1)
    assert "MPC_YAW_MODE" in reader.silent()
    assert "RTL_HDG_MD" not in reader.silent()
