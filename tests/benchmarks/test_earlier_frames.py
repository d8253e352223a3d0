"""What earlier frames add to the newest one: not more than what nothing can have entered since."""

from __future__ import annotations

from collections.abc import Collection
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.open_air.earlier_frames import FRAMES, Sequence, is_known, known_free
from core.types import FreeProfile

DIRECTIONS, LAYERS, HOLE = 41, 5, 20


def sequence(holes: set[int], invalid: Collection[int] = ()) -> Sequence:
    """Frames of a camera at rest that show all directions free from 0.5 to 12 m, but the middle one in the frames `holes`."""
    models = []
    for number in range(FRAMES):
        to_m = np.full((DIRECTIONS, LAYERS), 12.0, np.float32)
        if number in holes:
            to_m[HOLE] = 6.0
        free = FreeProfile(
            azimuth_edges_rad=np.radians(np.linspace(-50.0, 50.0, DIRECTIONS + 1)).astype(np.float32),
            layer_edges_m=np.linspace(-1.25, 1.25, LAYERS + 1).astype(np.float32),
            free_from_m=np.full((DIRECTIONS, LAYERS), 0.5, np.float32),
            free_to_m=to_m,
            end=np.zeros((DIRECTIONS, LAYERS), np.uint8),
        )
        models.append(cast(Any, SimpleNamespace(valid=number not in invalid, free=free)))
    return Sequence(models=models, positions_m=np.zeros((FRAMES, 3)), heading_rad=0.0, newest=cast(Any, None))


@pytest.mark.parametrize(
    ("holes", "mover_m_s", "known"),
    [
        ({4}, 0.0, True),
        ({4}, 5.0, True),  # 0.5 m from everything that the frame before did not show
        ({4}, 15.0, False),  # 1.5 m: a thing may have come from above or below
        ({1, 2, 3, 4}, 0.0, True),
        ({1, 2, 3, 4}, 5.0, False),  # 2 m in four frames
        ({0, 1, 2, 3, 4}, 0.0, False),
    ],
)
def test_an_earlier_frame_counts_where_nothing_can_have_come(holes: set[int], mover_m_s: float, known: bool) -> None:
    s = sequence(holes)
    assert is_known(known_free(s, mover_m_s), s, HOLE, 2.5) == known


def test_an_invalid_frame_empties_what_was_known() -> None:
    s = sequence({3, 4}, invalid={3})
    assert not is_known(known_free(s, 0.0), s, HOLE, 2.5)
    assert is_known(known_free(s, 0.0), s, HOLE - 3, 2.5)
