"""Free space that left the view: remembered where it was observed, for a limited time, only where no camera looks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.autopilot.free_space_memory import FreeMemory
from companion.autopilot.obstacle_memory import Here
from companion.autopilot.polar_histogram import SectorState, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform
from core.frames import rotation_frd_optical
from core.types import CameraMount, Intrinsics

from ..sector_models import HERE, model

AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, remember_free_s=3.0)
NS = 1_000_000_000
START = Here(0.3, (10.0, -5.0, -2.0), 1)
AHEAD = model(free_to_m=13.0, view_deg=72.0)


def looking(pitch_deg: float, free: bool = True) -> View:
    """A view of 56 degrees, straight ahead."""
    R = rotation_frd_optical(CameraMount(pitch_rad=math.radians(pitch_deg))).T
    shown = AHEAD if free else model(free_to_m=0.0, view_deg=72.0)
    return View(shown, HERE, Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5), R)


def remembering(at: Here = START) -> FreeMemory:
    memory = FreeMemory(AVOID)
    memory.see("front", 10 * NS, looking(0.0), at)
    return memory


def free(
    memory: FreeMemory, here: Here, x: float, y: float, z: float, views: tuple[View, ...] = (), t_ns: int = 10 * NS
) -> bool:
    return bool(memory.free(views, here, t_ns, np.array([x]), np.array([y]), np.array([z]))[0])


@given(st.floats(2.0, 11.0), st.floats(-33.0, 33.0), st.floats(-0.75, 0.75), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_it_stays_where_it_was_seen_while_the_vehicle_moves_and_turns(
    range_m: float, azimuth_deg: float, z: float, forward_m: float, turn_rad: float
) -> None:
    memory = remembering()
    x, y = range_m * math.cos(math.radians(azimuth_deg)), range_m * math.sin(math.radians(azimuth_deg))
    assert free(memory, START, x, y, z)
    assert not free(memory, START, -x, -y, z)
    px, py, pz = START.position_ned_m or (0.0, 0.0, 0.0)
    c, s = math.cos(START.heading_rad), math.sin(START.heading_rad)
    later = Here(START.heading_rad + turn_rad, (px + c * forward_m, py + s * forward_m, pz + 0.3), 1)
    moved_x, c, s = x - forward_m, math.cos(turn_rad), math.sin(turn_rad)
    memory.see("front", 11 * NS, View(model(free_to_m=0.0), HERE), later)  # the grid moves along
    assert free(memory, later, c * moved_x + s * y, -s * moved_x + c * y, z - 0.3, t_ns=11 * NS)


def test_where_a_later_frame_finds_an_obstacle_nothing_is_free() -> None:
    """A thin obstacle may be found from nearer only, or move into the space; then it leaves the image, too."""
    memory = remembering()
    assert free(memory, START, 5.0, 0.0, -0.7)
    found = model((5.0, -1.0, 5.0, 1.0, -2.0, 2.0), free_to_m=4.5, view_deg=72.0)
    memory.see("front", 11 * NS, replace(looking(0.0), model=found), START)
    for x, y in ((4.8, 0.9), (5.2, -0.9), *((5.0, y) for y in np.arange(-1.0, 1.01, 0.1))):
        assert not free(memory, START, x, float(y), -0.7, t_ns=11 * NS)
    assert free(memory, START, 5.0, 2.0, -0.7, t_ns=11 * NS)
    assert free(memory, START, 7.0, 0.0, -0.7, t_ns=11 * NS)


def test_an_older_frame_of_another_camera_does_not_free_the_place_of_an_obstacle() -> None:
    memory = FreeMemory(AVOID)
    found = model((5.0, -1.0, 5.0, 1.0, -2.0, 2.0), free_to_m=4.5, view_deg=72.0)
    memory.see("left", 11 * NS, replace(looking(0.0), model=found), START)
    memory.see("front", 11 * NS - NS // 20, looking(0.0), START)
    assert not free(memory, START, 5.0, 0.0, -0.7, t_ns=11 * NS)
    assert free(memory, START, 5.0, 2.0, -0.7, t_ns=11 * NS)


WALL = model((5.0, -1.0, 5.0, 1.0, -2.0, 2.0), free_to_m=4.5, view_deg=72.0)


def test_older_frames_never_free_the_place_of_an_obstacle() -> None:
    """However many: two newer ones would. One of the same instant is no newer one."""
    memory = FreeMemory(AVOID)
    memory.see("left", 11 * NS, replace(looking(0.0), model=WALL), START)
    for after_ns in (-2 * NS // 10, -NS // 10, 0, NS // 10):
        memory.see("front", 11 * NS + after_ns, looking(0.0), START)
    assert not free(memory, START, 5.0, 0.0, -0.7, t_ns=11 * NS)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0])
@pytest.mark.parametrize("at_m", [4.9, 5.3])
def test_beside_an_obstacle_the_next_cell_is_not_free(at_m: float, heading_deg: float) -> None:
    """A ray passes between two cells that touch at a corner."""
    here = replace(START, heading_rad=math.radians(heading_deg))
    memory = remembering(here)
    found = model((5.1, -1.0, 5.1, 1.0, -2.0, 2.0), free_to_m=4.0, view_deg=72.0)
    assert free(memory, here, at_m, 0.0, -0.7)
    memory.see("front", 11 * NS, replace(looking(0.0), model=found), here)
    assert not free(memory, here, at_m, 0.0, -0.7, t_ns=11 * NS)


def test_only_the_memory_of_the_named_cameras_counts() -> None:
    place = np.array([5.0]), np.array([0.0]), np.array([-0.7])
    memory = remembering()
    assert memory.free((), START, 10 * NS, *place, cameras=("front",)).all()
    assert not memory.free((), START, 10 * NS, *place, cameras=("left",)).any()


def test_a_view_of_which_the_place_is_not_known_adds_no_free_space() -> None:
    memory = FreeMemory(AVOID)
    memory.see("front", 10 * NS, looking(0.0), START, placed=False)
    assert not free(memory, START, 5.0, 0.0, -0.7)


def test_an_obstacle_in_a_frame_soon_after_the_last_one_counts() -> None:
    """Frames of a camera with 30 Hz: not all of them are searched for free space."""
    memory = remembering()
    memory.see("front", 10 * NS + NS // 30, replace(looking(0.0), model=WALL), START)
    assert not free(memory, START, 5.0, 0.0, -0.7, t_ns=10 * NS + NS // 30)
    assert free(memory, START, 5.0, 2.0, -0.7, t_ns=10 * NS + NS // 30)


@pytest.mark.parametrize("again", [0, 1])
def test_the_place_of_an_obstacle_is_free_only_after_two_frames_that_see_it_free(again: int) -> None:
    """A thin obstacle is not found in every frame."""
    memory = remembering()
    memory.see("front", 11 * NS, replace(looking(0.0), model=WALL), START)
    memory.see("front", 11 * NS + NS // 10, looking(0.0), START)
    memory.see("front", 11 * NS + NS // 10, looking(0.0), START)  # used by another decision
    assert not free(memory, START, 5.0, 0.0, -0.7, t_ns=12 * NS)
    if again:
        memory.see("front", 11 * NS + 2 * NS // 10, replace(looking(0.0), model=WALL), START)
    memory.see("front", 11 * NS + 3 * NS // 10, looking(0.0), START)
    assert free(memory, START, 5.0, 0.0, -0.7, t_ns=12 * NS) == (not again)


def test_below_an_obstacle_it_stays_free() -> None:
    memory = remembering()
    memory.see("front", 11 * NS, replace(looking(0.0), model=model((5.0, -1.0, 5.0, 1.0, -2.0, -0.6))), START)
    assert not free(memory, START, 5.0, 0.0, -0.7, t_ns=11 * NS)
    assert free(memory, START, 5.0, 0.0, 0.5, t_ns=11 * NS)


def test_above_an_obstacle_it_stays_free() -> None:
    memory = remembering()
    memory.see("front", 11 * NS, replace(looking(0.0), model=model((5.0, -1.0, 5.0, 1.0, 0.1, 2.0))), START)
    assert not free(memory, START, 5.0, 0.0, 0.15, t_ns=11 * NS)
    assert free(memory, START, 5.0, 0.0, -0.5, t_ns=11 * NS)


def test_after_a_while_it_is_forgotten() -> None:
    memory = remembering()
    assert free(memory, START, 4.0, 0.0, 0.0, t_ns=13 * NS)
    assert not free(memory, START, 4.0, 0.0, 0.0, t_ns=13 * NS + NS // 100)


@pytest.mark.parametrize(("reach_m", "to_m"), [(0.0, 12.0), (20.0, 20.0), (5.0, 12.0)])
def test_it_reaches_as_far_as_is_asked_for(reach_m: float, to_m: float) -> None:
    """The guard looks farther than the obstacle output sends: a vehicle that leans for its acceleration needs it all."""
    memory = FreeMemory(AVOID, reach_m)
    at = Here(0.0, (0.0, 0.0, 0.0), 1)
    memory.see("front", 10 * NS, replace(looking(0.0), model=model(free_to_m=30.0, view_deg=72.0)), at)
    assert free(memory, at, to_m - 0.1, 0.0, -0.7)
    assert not free(memory, at, to_m + 1.5, 0.0, -0.7)


def test_without_a_position_and_after_a_jump_of_it_nothing_is_remembered() -> None:
    memory = remembering()
    assert not free(memory, replace(START, position_ned_m=None, section=None), 4.0, 0.0, 0.0)
    assert not free(memory, replace(START, section=2), 4.0, 0.0, 0.0)
    memory.see("front", 11 * NS, View(model(free_to_m=0.0), HERE), replace(START, section=2))
    assert not free(memory, replace(START, section=2), 4.0, 0.0, 0.0, t_ns=11 * NS)
    assert not free(memory, START, 4.0, 0.0, 0.0, t_ns=11 * NS)
    assert not free(remembering(Here(0.0)), Here(0.0), 4.0, 0.0, 0.0)


def test_far_away_from_it_and_back_the_grid_holds_nothing_wrong() -> None:
    memory = remembering()
    away = Here(0.3, (500.0, 300.0, -40.0), 1)
    memory.see("front", 11 * NS, View(model(free_to_m=0.0), HERE), away)
    assert not free(memory, away, 4.0, 0.0, 0.0, t_ns=11 * NS)
    assert not free(memory, START, 4.0, 0.0, 0.0, t_ns=11 * NS)


def test_what_a_camera_looks_at_now_is_not_remembered() -> None:
    memory = remembering()
    assert not free(memory, START, 4.0, 0.0, 0.0, (looking(0.0, free=False),))
    assert not free(memory, START, 4.0, 0.0, -0.7, (View(AHEAD, HERE),))  # its direction is unknown
    assert free(memory, START, 4.0, 0.0, -0.7, (looking(-25.0, free=False),))  # above its image


def test_an_invalid_frame_adds_nothing() -> None:
    memory = FreeMemory(AVOID)
    memory.see("front", 10 * NS, replace(looking(0.0), model=replace(AHEAD, valid=False)), START)
    assert not free(memory, START, 4.0, 0.0, 0.0)


@pytest.mark.parametrize("seen_now", [True, False])
def test_it_completes_a_view_and_is_none(seen_now: bool) -> None:
    """The lower two thirds of the band seen at this instant, or nothing at all."""
    memory = remembering()
    begins, ends = np.zeros((36, 3), np.float32), np.zeros((36, 3), np.float32)
    if seen_now:
        begins[:, 1:], ends[:, 1:] = 1.5, 13.0
    layers = np.array([-3.0, -0.3, 1.0, 3.0], np.float32)
    part = replace(AHEAD, free=replace(AHEAD.free, layer_edges_m=layers, free_from_m=begins, free_to_m=ends))
    view = replace(looking(-25.0), model=part)

    def recall(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return memory.free((view,), START, 11 * NS, x, y, z)

    assert scan([view], AVOID).state[0] == SectorState.UNSEEN
    found = scan([view], AVOID, recall)
    assert found.state[0] == (SectorState.CLEAR if seen_now else SectorState.UNSEEN)
    assert found.state[36] == SectorState.UNSEEN
    assert scan([], AVOID, recall).state[0] == SectorState.UNSEEN  # a blind camera is completed by nothing


def test_an_obstacle_seen_outranks_what_was_free() -> None:
    memory = remembering()
    blocked = replace(looking(-25.0), model=model((5.0, -1.0, 5.0, 1.0, -2.0, 2.0), free_to_m=4.5, view_deg=72.0))
    found = scan([blocked], AVOID, lambda x, y, z: memory.free((blocked,), START, 11 * NS, x, y, z))
    assert found.state[0] == SectorState.OBSTACLE


def test_another_place_of_the_camera_moves_its_image() -> None:
    memory = remembering()
    high = replace(looking(0.0, free=False), transform=LevelTransform(0.0, (0.0, 0.0, -5.0)))
    assert free(memory, START, 4.0, 0.0, 0.0, (high,))
