"""Flags of joined planes of the merged world: what one part is not certain of, the whole is not certain of either."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from core.types import PlaneFlags
from core.world.world import Observation, World

from .worlds import NS, seen, wall

pytestmark = pytest.mark.nojit
FIRST, SECOND, WHOLE = wall(0.0, -4.0, 5.0, -4.0), wall(4.0, -4.0, 9.0, -4.0), wall(0.0, -4.0, 9.0, -4.0)


def add(world: World, part: list[float], flags: PlaneFlags, t_ns: int) -> None:
    """Adds a frame that observes a plane in its whole length."""
    model = seen(np.array([part]), (4.5, 8.0), -math.pi / 2, t_ns, flags=int(flags)).model
    whole = replace(model, planes=np.array([part], np.float32))
    world.add(Observation(model=whole, place_m=(4.5, 8.0, 0.0), t_ns=t_ns))


def flags_of(world: World, now_ns: int) -> PlaneFlags:
    """The flags of the only plane."""
    (flags,) = world.picture(now_ns).flags
    return PlaneFlags(int(flags))


@pytest.mark.parametrize("saved", [False, True])
@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (PlaneFlags.UNKNOWN_BEHIND, PlaneFlags(0), PlaneFlags.UNKNOWN_BEHIND),
        (PlaneFlags(0), PlaneFlags.UNKNOWN_BEHIND, PlaneFlags.UNKNOWN_BEHIND),
        (PlaneFlags.IRREGULAR, PlaneFlags(0), PlaneFlags.IRREGULAR),
        (PlaneFlags(0), PlaneFlags.IRREGULAR, PlaneFlags.IRREGULAR),
        (PlaneFlags.INFERRED, PlaneFlags(0), PlaneFlags.INFERRED),
        (PlaneFlags(0), PlaneFlags.INFERRED, PlaneFlags.INFERRED),
        (PlaneFlags.CUT_LEFT, PlaneFlags(0), PlaneFlags(0)),
        (PlaneFlags(0), PlaneFlags.CUT_TOP, PlaneFlags(0)),
        (PlaneFlags.CUT_LEFT, PlaneFlags.CUT_LEFT, PlaneFlags.CUT_LEFT),
        (PlaneFlags(0), PlaneFlags(0), PlaneFlags(0)),
    ],
)
def test_the_flags_of_two_parts_as_observations_and_as_saved_planes(
    first: PlaneFlags, second: PlaneFlags, expected: PlaneFlags, saved: bool
) -> None:
    worlds = [World(), World()]
    add(worlds[0], FIRST, first, 0)
    add(worlds[saved], SECOND, second, NS)
    world = worlds[0]
    if saved:
        world = World()
        world.load((*worlds[0].saved(), *worlds[1].saved()))
    assert flags_of(world, NS) == expected


def test_only_a_measurement_of_all_of_it_makes_an_inferred_plane_measured() -> None:
    world = World()
    add(world, WHOLE, PlaneFlags.INFERRED, 0)
    add(world, SECOND, PlaneFlags(0), NS)
    assert flags_of(world, NS) == PlaneFlags.INFERRED
    add(world, WHOLE, PlaneFlags.INFERRED, 2 * NS)
    assert flags_of(world, 2 * NS) == PlaneFlags.INFERRED
    add(world, WHOLE, PlaneFlags(0), 3 * NS)
    assert flags_of(world, 3 * NS) == PlaneFlags(0)
