"""Random faults of the autopilot's line: what is used for an exposure is compared with the truth."""

from __future__ import annotations

import random

import pytest

from tests.nightly import first

from ..random_line import Exposure, RandomFlight, harder_conditions

MOST_DEG, MOST_M = 3.5, 0.5
"""Greatest errors: max_clock_error_deg and max_clock_error_m, and what is interpolated."""


def wrong(found: list[Exposure]) -> list[Exposure]:
    return [e for e in found if (e.attitude_deg or 0.0) > MOST_DEG or (e.position_m or 0.0) > MOST_M]


@pytest.mark.parametrize("seed", first(5, range(12)))
def test_no_attitude_or_position_of_another_instant_is_used(seed: int) -> None:
    flight = RandomFlight(seed)
    found = flight.fly()
    assert wrong(found) == []
    assert not any("two autopilots" in e.conflicts for e in found)


@pytest.mark.parametrize("seed", first(4, range(1000, 1010)))
def test_nothing_wrong_is_used_with_routes_bursts_late_requests_and_a_corrected_clock(seed: int) -> None:
    found = RandomFlight(seed, **harder_conditions(random.Random(-seed - 1))).fly()
    assert wrong(found) == []


def test_on_lines_that_work_most_frames_have_an_attitude() -> None:
    fixed = {"hz": 50, "position_hz": 30, "answers": True, "delay_s": 0.003, "loss": 0.0, "stalls": 0, "reboot": False}
    found = RandomFlight(3, **fixed, jitter_s=0.005, bytes_per_s=92_160, jumps=0).fly()
    later = [e for e in found if e.t_s > 2.0]
    assert sum(e.attitude_deg is not None and e.position_m is not None for e in later) > 0.98 * len(later)
    assert max(e.attitude_deg for e in later if e.attitude_deg is not None) < 0.5


@pytest.mark.parametrize("seed", first(1, range(4)))
@pytest.mark.parametrize("after_s", [-5.0, -0.3, 0.02, 0.3, 5.0])
def test_nothing_of_a_second_vehicle_with_the_same_ids_is_used(seed: int, after_s: float) -> None:
    """Attitudes of both were used, wrong by up to 180 degrees."""
    found = RandomFlight(seed, second_after_s=after_s, loss=0.0, stalls=0, reboot=False, seconds=13.0).fly()
    assert wrong(found) == []
    assert {"two autopilots", "two clocks"} & set(found[-1].conflicts)


@pytest.mark.parametrize("seed", first(1, range(3)))
def test_an_autopilot_without_body_rates_has_no_jumps_of_the_heading(seed: int) -> None:
    """Each turn was one: remembered obstacles were rotated by it."""
    fixed = {"hz": 10, "answers": True, "loss": 0.0, "copies": 0.0, "stalls": 0, "reboot": False, "jumps": 0}
    flight = RandomFlight(seed, zero_rates=True, **fixed, delay_s=0.003, jitter_s=0.0005)
    found = flight.fly()
    assert sum(e.attitude_deg is not None for e in found) > 0.5 * len(found)
    assert wrong(found) == []
    assert flight.heading_jumps == 0
