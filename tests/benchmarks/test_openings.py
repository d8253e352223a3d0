"""Opening sizes in hand-made models."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fidelity.openings import in_view, opening_size
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered, camera_info, render


def facade(yaw: float = 0.0) -> tuple[Rendered, np.ndarray]:
    """A wall 6 m ahead with a window of 2.9 x 2.1 m from 1 m up, and its exact planes in level_cam for yaw 0."""
    b = SceneBuilder("test")
    b.ground()
    b.wall("facade", (6.0, -5.0), (6.0, 5.0), 5.0, ((3.5, 1.0, 2.9, 2.1),))
    frame = render(b.build(), camera_info(64, 48), yaw_rad=yaw)
    y0, y1 = -1.5, 1.4
    planes = [[6, -5, 6, y0, -3, 2], [6, y1, 6, 5, -3, 2], [6, y0, 6, y1, -3, -1.1], [6, y0, 6, y1, 1.0, 2]]
    return frame, np.array(planes, np.float64)


def test_exact_model_keeps_the_exact_size() -> None:
    frame, planes = facade()
    size = opening_size(frame.scene.openings[0], frame, planes)
    assert (size.true_width_m, size.true_height_m) == pytest.approx((2.9, 2.1))
    assert (size.width_m, size.height_m) == pytest.approx((2.9, 2.1), abs=0.021)
    assert size.free_share > 0.98
    assert (size.passable, size.kept, size.to_be_passed, size.too_large) == (True, True, True, False)
    assert size.distance_m == pytest.approx(np.linalg.norm([6.0, -0.05, 0.05 + 2.0 - 2.1]), abs=0.01)
    assert size.angle_deg < 1.0
    assert size.px_m == pytest.approx(6.0 / 45.0, rel=0.01)


def test_kept_and_passable_ask_for_both_lengths_at_once() -> None:
    """A bar of 0.3 m off one side leaves 2.6 x 2.1 m: passable, yet less than 2.7 x 2.0 m; a bar across the middle
    leaves twice 2.9 x 0.95 m, which nothing passes."""
    frame, planes = facade()
    opening = frame.scene.openings[0]
    less = opening_size(opening, frame, np.vstack([planes, [[6.0, -1.5, 6.0, -1.2, -3, 2]]]))
    assert (less.passable, less.kept) == (True, False)
    just = opening_size(
        opening, frame, np.vstack([planes, [[6.0, -1.5, 6.0, -1.31, -1.1, -1.01], [6, -1.5, 6, -1.31, -3, 2]]])
    )
    assert (just.passable, just.kept) == (True, True)
    halves = opening_size(opening, frame, np.vstack([planes, [[6.0, -1.5, 6.0, 1.4, -0.15, 0.05]]]))
    assert (halves.passable, halves.kept) == (False, False)
    assert halves.free_share == pytest.approx(1.0 - 0.2 / 2.1, abs=0.02)


def test_larger_than_it_is_by_more_than_a_pixel_on_each_side() -> None:
    frame, planes = facade()
    opening = frame.scene.openings[0]
    for more, too_large in ((0.2, False), (0.4, True)):  # a pixel spans 0.13 m; the border shows at most 0.25 m of it
        wide = planes.copy()
        wide[0, 3] -= more / 2
        wide[1, 1] += more / 2
        wide[2:, 1] -= more / 2
        wide[2:, 3] += more / 2
        size = opening_size(opening, frame, wide)
        assert size.width_m == pytest.approx(2.9 + more, abs=0.021)
        assert size.too_large == too_large


def test_an_opening_down_to_the_ground_ends_there() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("facade", (6.0, -5.0), (6.0, 5.0), 5.0, ((3.0, 0.0, 3.0, 2.2),))
    frame = render(b.build(), camera_info(64, 48))
    size = opening_size(frame.scene.openings[0], frame, np.array([[6, -5, 6, -2, -3, 2], [6, 1, 6, 5, -3, 2]], float))
    assert size.width_m == pytest.approx(3.0, abs=0.021)
    assert size.height_m == pytest.approx(2.2 + 0.25, abs=0.021)  # open above, not below


def test_seen_from_the_side() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("facade", (4.0, 2.0), (4.0 + 5.0, 2.0), 5.0, ((1.0, 1.0, 2.0, 2.0),))
    frame = render(b.build(), camera_info(64, 48))
    size = opening_size(frame.scene.openings[0], frame, np.zeros((0, 6)))
    assert size.angle_deg == pytest.approx(np.degrees(np.arctan2(6.0, 2.0)), abs=0.1)


def test_turned_camera_finds_the_same_opening() -> None:
    frame, planes = facade(yaw=0.3)
    c, s = np.cos(0.3), np.sin(0.3)
    turned = planes.copy()
    turned[:, 0:2] = planes[:, 0:2] @ np.array([[c, -s], [s, c]])
    turned[:, 2:4] = planes[:, 2:4] @ np.array([[c, -s], [s, c]])
    size = opening_size(frame.scene.openings[0], frame, turned)
    assert (size.width_m, size.height_m) == pytest.approx((2.9, 2.1), abs=0.021)


def test_narrowed_widened_filled_and_missing() -> None:
    frame, planes = facade()
    opening = frame.scene.openings[0]
    narrow = planes.copy()
    narrow[0, 3] += 0.2
    assert opening_size(opening, frame, narrow).width_m == pytest.approx(2.7, abs=0.021)
    wide = planes.copy()
    wide[1, 1] += 0.2
    wide[2:, 3] += 0.2
    assert opening_size(opening, frame, wide).width_m == pytest.approx(3.1, abs=0.021)
    filled = np.vstack([planes, [[6.3, -2, 6.3, 2, -3, 2]]])
    size = opening_size(opening, frame, filled)
    assert (size.width_m, size.height_m, size.free_share) == (0.0, 0.0, 0.0) or size.free_share == 0.0
    assert opening_size(opening, frame, np.zeros((0, 6))).free_share == 1.0


def test_planes_far_behind_the_wall_do_not_close_it() -> None:
    frame, planes = facade()
    behind = np.vstack([planes, [[8.0, -9, 8.0, 9, -9, 2]]])
    assert opening_size(frame.scene.openings[0], frame, behind).free_share > 0.98


def test_plane_that_crosses_the_wall_closes_only_its_part() -> None:
    frame, planes = facade()
    door = np.vstack([planes, [[0.0, 0.0, 12.0, 0.0, -3, 2]]])
    size = opening_size(frame.scene.openings[0], frame, door)
    assert size.width_m == pytest.approx(1.5, abs=0.03)


def test_openings_cut_by_the_image_or_behind_the_camera_are_not_in_view() -> None:
    frame, _ = facade()
    opening = frame.scene.openings[0]
    assert in_view(opening, frame)
    assert not in_view(opening, facade(yaw=0.5)[0])
    assert not in_view(opening, facade(yaw=3.1)[0])


def test_an_opening_behind_something_is_not_in_view() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("facade", (6.0, -5.0), (6.0, 5.0), 5.0, ((3.5, 1.0, 2.9, 2.1),))
    open_one = render(b.build(), camera_info(64, 48))
    b.box("van", 4.0, 0.5, 1.0, 2.0, 2.4)
    hidden = render(b.build(), camera_info(64, 48))
    assert in_view(open_one.scene.openings[0], open_one)
    assert not in_view(hidden.scene.openings[0], hidden)
