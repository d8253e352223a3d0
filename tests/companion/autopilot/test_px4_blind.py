"""PX4 in Position mode after a camera failure, both generations: the distance flown until it stops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.autopilot.blind_px4 import VERSIONS, stopped
from benchmarks.autopilot.px4_position_mode import Px4Params, drag_m_s2
from tests.nightly import nightly

STICKS = [(1.0, 30.0), (0.1, 0.0), *nightly((1.0, 0.0), (0.4, -30.0))]


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(("deflection", "angle_deg"), STICKS)
def test_the_wall_all_around_stops_both_generations(
    version: tuple[int, int], deflection: float, angle_deg: float
) -> None:
    brake = stopped(version, "brake", deflection, angle_deg)
    unknown = stopped(version, "unknown", deflection, angle_deg)
    assert brake.start_m_s > 3.0 * deflection
    assert brake.greatest_m_s < 0.05
    assert brake.distance_m < unknown.distance_m
    assert brake.distance_m < 6.5


@pytest.mark.parametrize(("policy", "angle_deg", "at_least_m_s"), [("near", 0.0, 8.0), ("front", 30.0, 3.0)])
def test_what_the_wall_must_not_be(policy: str, angle_deg: float, at_least_m_s: float) -> None:
    """Nearer than CP_DIST, PX4 v1.16 flies backwards (8.5 m/s with its own code); in front alone, it slides sideways."""
    assert stopped((1, 16), policy, 1.0, angle_deg).greatest_m_s > at_least_m_s


@pytest.mark.parametrize(("deflection", "distance_m"), [(1.0, 14.3), (0.4, 6.9)])
def test_without_data_v1_16_coasts_as_its_own_code_did(deflection: float, distance_m: float) -> None:
    assert stopped((1, 16), "unknown", deflection, 0.0).distance_m == pytest.approx(distance_m, rel=0.12)


@pytest.mark.parametrize(("boost", "drag"), [(1.0, 0.6 * 0.25), (2.0, 1.2 * 0.5), (1.5, 0.9 * 0.375)])
def test_drag_below_1_m_s_is_linear_while_the_stick_is_held(boost: float, drag: float) -> None:
    """StickAccelerationXY::calculateDrag: the root of the speed counts while the stick is released alone."""
    velocity = np.array([0.0, -0.25])
    assert drag_m_s2(velocity, boost, Px4Params()) == pytest.approx(np.array([0.0, -drag]))
    assert math.hypot(*drag_m_s2(8.0 * velocity, boost, Px4Params())) == pytest.approx(boost * 0.6 * 2.0)
