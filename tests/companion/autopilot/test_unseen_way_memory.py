"""What messages and the memory of obstacles make of a plane whose way was not seen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.failsafe import AutopilotNow, BlindPolicy, Policy, PolicyInput, policy_of
from companion.autopilot.obstacle_distance import (
    UNKNOWN,
    clear_cm,
    for_coarse_bins,
    only_near,
)
from companion.autopilot.obstacle_memory import Here, ObstacleMemory, Remembered, nothing_remembered
from companion.autopilot.polar_histogram import SECTORS, SectorScan, SectorState, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform

from ..sector_models import model, wall_at

NS = 1_000_000_000
AVOID = AvoidParams()
STOP, NOT_KNOWN = policy_of(AVOID, AutopilotNow(kind="ArduPilot")), Policy("unknown")
HERE = LevelTransform(0.0, (0.0, 0.0, 0.0))


def unseen_behind(distance_m: float) -> SectorScan:
    """A scan with a plane at this distance from the hull in sector 0, whose way was not seen; all else is clear."""
    state = np.full(SECTORS, SectorState.CLEAR, np.uint8)
    distance = np.full(SECTORS, np.inf)
    state[0], distance[0] = SectorState.UNSEEN, distance_m
    return SectorScan(state, distance, np.zeros(SECTORS), np.zeros(SECTORS), np.zeros((SECTORS, 1, 1), np.bool_))


def test_an_unseen_way_survives_in_the_coarse_bins() -> None:
    """A bin of 10 degrees stands for three sectors: one of them unseen, its neighbours do not decide it."""
    values = np.full(SECTORS, clear_cm(AVOID), np.uint16)
    values[10:13] = (900, UNKNOWN, 950)
    out = for_coarse_bins(values, clear_cm(AVOID), only_near(200))
    assert (out[10], out[11], out[12]) == (UNKNOWN, UNKNOWN, UNKNOWN)
    values[10] = 150
    out = for_coarse_bins(values, clear_cm(AVOID), only_near(200))
    assert (out[10], out[12]) == (150, UNKNOWN)


def test_where_unknown_means_clear_the_plane_is_better_than_nothing() -> None:
    """At the border of the view no wall stands: there ArduPilot keeps the plane, PX4 is sent unknown."""
    found = unseen_behind(5.0)
    everywhere, nowhere = np.ones(SECTORS, bool), np.zeros(SECTORS, bool)
    border = PolicyInput(found, nothing_remembered(), nowhere, everywhere, nowhere, 0)
    inside = replace(border, whole=everywhere)
    for sight, policy, expected in (
        (border, STOP, 500),
        (border, NOT_KNOWN, UNKNOWN),
        (inside, STOP, 212),
        (inside, NOT_KNOWN, UNKNOWN),
    ):
        values = BlindPolicy(AVOID).values(sight, policy, 0)
        assert values is not None
        assert values[0] == expected
    off = BlindPolicy(replace(AVOID, unseen="unknown")).values(inside, STOP, 0)
    assert off is not None
    assert off[0] == 500
    near = BlindPolicy(AVOID).values(replace(inside, scan=unseen_behind(1.0)), STOP, 0)
    assert near is not None
    assert near[0] == 100


def test_a_remembered_obstacle_does_not_stand_for_an_unseen_way() -> None:
    """Sector 0 is unseen, sector 3 clear, sector 6 unseen and no camera looks there."""
    everywhere, nowhere = np.ones(SECTORS, bool), np.zeros(SECTORS, bool)
    scanned = unseen_behind(9.0)
    scanned.state[6] = SectorState.UNSEEN
    looking = everywhere & (np.arange(SECTORS) != 6)

    def sectors_of(distance_m: float, way_seen: bool) -> list[int]:
        recalled = np.full(SECTORS, np.inf)
        recalled[[0, 3, 6]] = distance_m
        remembered = Remembered(recalled, recalled if way_seen else np.full(SECTORS, np.inf))
        sight = PolicyInput(scanned, remembered, nowhere, looking, looking, 0)
        values = BlindPolicy(AVOID).values(sight, NOT_KNOWN, 0)
        assert values is not None
        return [int(values[i]) for i in (0, 3, 6)]

    assert sectors_of(5.0, way_seen=True) == [UNKNOWN, 500, 500]
    assert sectors_of(5.0, way_seen=False) == [UNKNOWN, 500, UNKNOWN]
    assert sectors_of(1.5, way_seen=False) == [150, 150, 150]


THERE = Here(0.0, (0.0, 0.0, -2.0), 1)


def test_what_is_remembered_keeps_whether_its_way_was_seen() -> None:
    for free_to_m, way_seen in ((0.0, False), (4.5, True)):
        memory = ObstacleMemory(AVOID)
        memory.recall(scan([View(model(wall_at(0.0, 5.0), free_to_m=free_to_m), HERE)], AVOID), [], THERE, 0)
        then = memory.recall(scan([], AVOID), [], THERE, NS)
        assert then.distance_m[0] == pytest.approx(5.0 - AVOID.radius_m, abs=0.01)
        assert np.isfinite(then.way_seen_m[0]) == way_seen


@pytest.mark.parametrize(
    ("here", "way_seen"),
    [
        (Here(math.pi, (0.0, 0.0, -2.0), 1), True),  # turned round
        (Here(math.pi / 2, (1.5, 0.0, -2.0), 1), True),  # on the way
        (Here(0.0, (-2.0, 0.1, -2.0), 1), True),
        (Here(0.0, (0.0, 4.0, -2.0), 1), False),  # beside it
        (Here(0.0, (2.0, -0.5, -2.0), 1), False),
        (Here(0.0, (0.0, 0.0, -2.0), 2), False),  # the estimate of the position has jumped
        (Here(0.0), False),
    ],
)
def test_the_way_to_a_remembered_obstacle_was_seen_from_one_place_alone(here: Here, way_seen: bool) -> None:
    """A pole 5 m ahead, with the way to it seen. From beside, the way to it leads through places never looked at."""
    memory = ObstacleMemory(AVOID)
    pole = View(model(wall_at(0.0, 5.0), free_to_m=4.5), HERE)
    memory.recall(scan([pole], AVOID), [], THERE, 0)
    then = memory.recall(scan([], AVOID), [], here, NS)
    assert np.isfinite(then.distance_m).any()
    assert np.isfinite(then.way_seen_m).any() == way_seen


def test_without_a_position_no_way_is_remembered_as_seen() -> None:
    """The vehicle may have moved aside meanwhile."""
    memory = ObstacleMemory(AVOID)
    pole = View(model(wall_at(0.0, 5.0), free_to_m=4.5), HERE)
    memory.recall(scan([pole], AVOID), [], Here(0.0), 0)
    then = memory.recall(scan([], AVOID), [], Here(0.0), NS)
    assert np.isfinite(then.distance_m).any()
    assert not np.isfinite(then.way_seen_m).any()


def test_a_plane_without_any_free_range_is_sent_only_when_it_is_near() -> None:
    for distance_m, state in ((2.0, SectorState.OBSTACLE), (2.8, SectorState.OBSTACLE), (6.0, SectorState.UNSEEN)):
        found = scan([View(model(wall_at(0.0, distance_m)), HERE)], AVOID)
        assert found.state[0] == state
        found = scan([View(model(wall_at(0.0, distance_m), free_to_m=distance_m - 0.5), HERE)], AVOID)
        assert found.state[0] == SectorState.OBSTACLE
