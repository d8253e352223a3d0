"""Open space in queries: an answer of its own, only for callers that ask for it, and never above an obstacle or the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.types import FrameModel, Ground
from osape_client.query.space import Occupancy, PlacedModel, Space

from .test_queries import HERE, model, profile

FREE, OPEN, UNKNOWN, OCCUPIED = Occupancy.FREE, Occupancy.OPEN, Occupancy.UNKNOWN, Occupancy.OCCUPIED


def half_open(*planes: tuple[float, ...]) -> FrameModel:
    """Measured free to 4 m, and presumed free from 1 to 10 m in the middle layer."""
    f = profile(0.5, 4.0)
    from_dm, to_dm = np.zeros((16, 3), np.uint8), np.zeros((16, 3), np.uint8)
    from_dm[:, 1], to_dm[:, 1] = 10, 100
    return model(*planes, margin=0.1, free=replace(f, open_from_dm=from_dm, open_to_dm=to_dm))


def test_open_space_is_unknown_unless_asked_for() -> None:
    space = Space([PlacedModel(half_open(), HERE)])
    p = [[3, 0, 0], [7, 0, 0], [11, 0, 0], [7, 0, 2]]
    assert space.points(p).tolist() == [FREE, UNKNOWN, UNKNOWN, UNKNOWN]
    assert space.points(p, allow_open=True).tolist() == [FREE, OPEN, UNKNOWN, UNKNOWN]


def test_a_ball_that_is_free_in_part_is_open() -> None:
    space = Space([PlacedModel(half_open(), HERE)])
    assert space.points([[4, 0, 0]], 0.5).tolist() == [UNKNOWN]
    assert space.points([[4, 0, 0]], 0.5, allow_open=True).tolist() == [OPEN]
    assert space.points([[7, 0, 0.8]], 0.5, allow_open=True).tolist() == [UNKNOWN]  # reaches into the next layer


def test_a_way_through_open_space() -> None:
    space = Space([PlacedModel(half_open(), HERE)])
    a, b = [[2, 0, 0]] * 3, [[3, 0, 0], [9, 0, 0], [12, 0, 0]]
    assert space.segments(a, b, 0.1).tolist() == [FREE, UNKNOWN, UNKNOWN]
    assert space.segments(a, b, 0.1, allow_open=True).tolist() == [FREE, OPEN, UNKNOWN]


def test_obstacles_outrank_open_space() -> None:
    space = Space([PlacedModel(half_open((7.0, -1.0, 7.0, 1.0, -1.0, 1.0)), HERE)])
    assert space.points([[7, 0, 0]], allow_open=True).tolist() == [OCCUPIED]
    assert space.segments([[5, 0, 0]], [[9, 0, 0]], allow_open=True).tolist() == [OCCUPIED]


def test_nothing_is_open_near_the_ground() -> None:
    above = replace(half_open(), ground=Ground(seen=True, height_m=1.0, tolerance_m=0.5))
    space = Space([PlacedModel(above, HERE)])
    assert space.points([[7, 0, 0.3], [7, 0, 0.7]], allow_open=True).tolist() == [OPEN, UNKNOWN]


@pytest.mark.parametrize("allow_open", [False, True])
def test_a_service_that_presumes_nothing_answers_as_before(allow_open: bool) -> None:
    space = Space([PlacedModel(model(free=profile(1.0, 7.5)), HERE)])
    assert space.points([[5, 0, 0], [9, 0, 0]], allow_open=allow_open).tolist() == [FREE, UNKNOWN]
    assert space.segments([[2, 0, 0]], [[9, 0, 0]], allow_open=allow_open).tolist() == [UNKNOWN]


def test_two_cameras_cover_a_way_together() -> None:
    other = model(free=profile(0.5, 14.0))
    space = Space([PlacedModel(half_open(), HERE), PlacedModel(other, (8.0, 0.0, 0.0))])
    assert space.segments([[5, 0, 0]], [[15, 0, 0]], 0.1).tolist() == [UNKNOWN]
    assert space.segments([[5, 0, 0]], [[15, 0, 0]], 0.1, allow_open=True).tolist() == [OPEN]
