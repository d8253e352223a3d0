"""What leaves the view above or below the image is kept, as what leaves it to the side."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker
from core.types import FreeEnd

from ..nightly import nightly
from .tracked import SMALL, STEP, distance, without_position
from .worlds import seen, wall

LOW = wall(4.0, -0.5, 4.0, 0.5, -0.5, 0.5)
BACK = wall(12.0, -9.0, 12.0, 9.0, -9.0, 9.0)
HALF_RAD = math.radians(28.0)
"""Half of the vertical field of view."""
LAYERS_M = np.arange(-3.0, 3.1, 0.5, dtype=np.float32)


def frame(walls: list[list[float]], k: int, z: float = 0.0, pitch_deg: float = 0.0) -> TrackingFrame:
    """Frame k of walls from a height z (down), with the layers that the image of a pitched camera contains as a whole, from
    where it does, and the part of the walls that it contains."""
    o = seen(np.array(walls, float).reshape(-1, 6), (0.0, 0.0), 0.0, k * STEP, z=z)
    pitch = math.radians(pitch_deg)
    up, down = math.tan(-pitch - HALF_RAD), math.tan(-pitch + HALF_RAD)
    reach = o.model.free.free_to_m[:, :1]
    ranges = np.arange(0.25, 20.0, 0.25)
    top, bottom = LAYERS_M[:-1, None], LAYERS_M[1:, None]
    inside = (top >= up * ranges) & (bottom <= down * ranges)
    begin = np.where(inside.any(axis=1), ranges[np.argmax(inside, axis=1)], np.inf)
    near = np.repeat(begin[None, :], len(reach), axis=0)
    far = np.repeat(reach, len(begin), axis=1)
    blank = near >= far
    end = np.where(far < 19.0, int(FreeEnd.OBSTACLE), int(FreeEnd.MAX_RANGE))
    end[blank & (far >= 19.0)] = int(FreeEnd.NOT_SEEN)
    near[blank] = far[blank] = 0.0
    free = dataclasses.replace(
        o.model.free,
        layer_edges_m=LAYERS_M + np.float32(z),
        free_from_m=near.astype(np.float32),
        free_to_m=far.astype(np.float32),
        end=end.astype(np.uint8),
    )
    planes = o.model.planes.copy()
    range_m = np.hypot(planes[:, [0, 2]].mean(axis=1), planes[:, [1, 3]].mean(axis=1))
    planes[:, 4], planes[:, 5] = (
        np.maximum(planes[:, 4], z + up * range_m),
        np.minimum(planes[:, 5], z + down * range_m),
    )
    assert (planes[:, 4] < planes[:, 5]).all()
    model = dataclasses.replace(o.model, free=free, planes=planes)
    return TrackingFrame(model=model, camera_m=o.place_m, t_ns=o.t_ns, positioned=True, origin_m=o.place_m)


@pytest.mark.parametrize("behind", [[], [BACK]], ids=["nothing behind", "a wall behind"])
@pytest.mark.parametrize(
    ("z", "pitch_deg"),
    [
        pytest.param(-3.2, 0.0, id="climb"),
        pytest.param(3.2, 0.0, id="descent"),
        pytest.param(-8.0, 0.0, id="beyond the layers"),
        pytest.param(8.0, 0.0, id="under the layers"),
        pytest.param(0.0, 45.0, id="pitched up"),
        pytest.param(0.0, -45.0, id="pitched down"),
    ],
)
@pytest.mark.parametrize("frames", [2, *nightly(5), 20])
def test_what_is_above_or_below_the_image_is_kept_for_the_whole_memory(frames, z, pitch_deg, behind):
    """The camera has moved there within a second."""
    tracker, last, memory = Tracker(SMALL), frames - 1, round(10 * SMALL.memory_s)
    for k in range(frames):
        tracker.observe(frame([LOW, *behind], k))
    there = frame(behind, 0, z, pitch_deg)
    for k in range(frames + 10, last + memory + 2):
        s = tracker.observe(dataclasses.replace(there, t_ns=k * STEP))
        assert (distance(s, 4.0, 0.0) < 0.1) is (k - last <= memory), k


@pytest.mark.parametrize("pitch_deg", [45.0, -45.0])
def test_the_same_without_a_position(pitch_deg):
    tracker, memory = Tracker(SMALL), round(10 * SMALL.memory_without_position_s)
    for k in range(5):
        tracker.observe(without_position(frame([LOW, BACK], k)))
    for k in range(5, 4 + memory + 2):
        s = tracker.observe(without_position(frame([BACK], k, 0.0, pitch_deg)))
        assert (distance(s, 4.0, 0.0) < 0.1) is (k - 4 <= memory), k


@pytest.mark.nojit
@pytest.mark.parametrize("sign", [-1.0, pytest.param(1.0, marks=pytest.mark.compiled)], ids=["above", "below"])
def test_the_part_of_an_obstacle_that_has_left_the_view_is_not_removed_with_the_rest(sign):
    """Most of it is seen through, but a third lies beyond the border of the image, where nothing proves it free."""
    low, high = sorted((sign * 3.2, sign * -0.3))
    tall, tracker = wall(4.0, -0.5, 4.0, 0.5, low, high), Tracker(SMALL)
    for k in range(20):
        f = frame([tall, BACK], k)
        planes = f.model.planes.copy()
        planes[np.abs(planes[:, 0] - 4.0) < 0.1, 4:6] = low, high  # seen from farther away
        tracker.observe(dataclasses.replace(f, model=dataclasses.replace(f.model, planes=planes)))
    for k in range(20, 60):
        s = tracker.observe(frame([BACK], k))
        assert distance(s, 4.0, 0.0) < 0.1, k


@pytest.mark.nojit
def test_an_obstacle_of_which_little_is_out_of_view_is_removed_when_it_is_seen_through():
    tall, tracker = wall(4.0, -0.5, 4.0, 0.5, -2.4, 1.0), Tracker(SMALL)
    for k in range(20):
        tracker.observe(frame([tall, BACK], k))
    for k in range(20, 25):
        s = tracker.observe(frame([BACK], k))
    assert distance(s, 4.0, 0.0) > 0.5
