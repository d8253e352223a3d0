"""Jumps of the position estimate, with and without a counter of them."""

from __future__ import annotations

import numpy as np
import pytest

from companion.autopilot.position_sections import PositionSections
from companion.autopilot.publisher import ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from core.types import PoseSample

from .test_obstacle_sender import AVOID, CLEAR, NS, PX4, Chain
from .test_sectors import model

Vector = tuple[float, float, float]
MS = NS // 1000


def sample(t_ms: int, position: Vector, velocity: Vector | None = (0.0, 0.0, 0.0), counter: int = 0) -> PoseSample:
    return PoseSample(t_ms * MS, t_ms * MS, position, velocity, counter)


def numbers(*samples: PoseSample) -> list[int]:
    sections = PositionSections()
    out = []
    for one in samples:
        sections.take(one)
        out.append(sections.number)
    return out


@pytest.mark.parametrize("every_ms", [20, 250])
def test_a_flight_with_hard_turns_is_one_section(every_ms: int) -> None:
    at_s = np.arange(0.0, 20.0, every_ms / 1000.0)
    north = [(5.0 * np.sin(t), 3.0 * np.cos(1.3 * t), -2.0) for t in at_s]  # up to 5 m/s2
    speed = [(5.0 * np.cos(t), -3.9 * np.sin(1.3 * t), 0.0) for t in at_s]
    rng = np.random.default_rng(1)
    noisy = [tuple(p + rng.normal(0.0, 0.05, 3)) for p in north]
    flown = [sample(round(1000 * t), p, v) for t, p, v in zip(at_s, noisy, speed, strict=True)]
    assert set(numbers(*flown)) == {1}


@pytest.mark.parametrize("velocity", [(4.0, 0.0, 0.0), None])
@pytest.mark.parametrize("step", [(1.6, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 0.0, 2.0)])
def test_a_step_that_the_velocity_does_not_explain_begins_a_section(step: Vector, velocity: Vector | None) -> None:
    x, y, z = step
    after = sample(33, (0.13 + x, y, z), velocity)
    assert numbers(sample(0, (0.0, 0.0, 0.0), velocity), after) == [1, 2]
    assert numbers(sample(0, (0.0, 0.0, 0.0), velocity), sample(33, (0.13, 0.0, 0.0), velocity)) == [1, 1]


def test_a_counted_reset_begins_a_section_and_a_late_position_changes_nothing() -> None:
    assert numbers(sample(0, (0.0, 0.0, 0.0)), sample(33, (0.0, 0.0, 0.0), counter=1)) == [1, 2]
    late = sample(10, (50.0, 0.0, 0.0))
    assert numbers(sample(0, (0.0, 0.0, 0.0)), sample(33, (0.0, 0.0, 0.0)), late) == [1, 1, 1]


def test_after_a_gap_a_section_begins() -> None:
    assert numbers(sample(0, (0.0, 0.0, 0.0)), sample(1000, (0.1, 0.0, 0.0)), sample(2001, (0.1, 0.0, 0.0))) == [
        1,
        1,
        2,
    ]


def jumping_chain() -> tuple[Chain, list[Surroundings]]:
    """A hover, then a step of the position by 5 m with the same counter."""
    seen: list[Surroundings] = []
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, ("front",), 0.3, observer=seen.append)
    chain.builder.announce(chain.pipeline.cameras[0])
    chain.position = (0.0, 0.0, -2.0)
    for _ in range(20):
        chain.fly(0.05)
        chain.report(PX4)
    return chain, seen


def recalled(surroundings: Surroundings) -> bool:
    """Whether a place above the image counts as seen free before."""
    assert surroundings.recall is not None
    return bool(surroundings.recall(np.array([2.6]), np.array([0.0]), np.array([-1.6]))[0])


def test_free_space_that_was_remembered_before_a_jump_does_not_count_after_it() -> None:
    chain, seen = jumping_chain()
    assert recalled(seen[-1])
    chain.position = (2.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert not recalled(seen[-1])


def test_a_frame_from_before_a_jump_stays_where_it_was_seen() -> None:
    chain, seen = jumping_chain()
    chain.sees.found = model((8.0, -6.0, 8.0, 6.0, -2.0, 2.0), free_to_m=7.5, view_deg=72.0)
    chain.fly(0.1)
    chain.report(PX4)
    before_m = seen[-1].views[0].model.planes[0, 0]
    chain.position = (-5.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert seen[-1].views[0].model.planes[0, 0] == pytest.approx(before_m, abs=0.3)


def test_a_frame_from_before_a_jump_adds_no_remembered_free_space() -> None:
    """It is not known where the vehicle was at the exposure, in the positions after the jump."""
    chain, seen = jumping_chain()
    chain.fly(0.1)  # a frame that no decision has used yet
    chain.position = (2.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert not recalled(seen[-1])
