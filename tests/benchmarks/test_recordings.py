"""What of a model is found again, on models made by hand; and the page of the recordings."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import benchmarks.fidelity.recordings as page
from benchmarks.fidelity.recordings import comparable, fly, section
from benchmarks.fidelity.stability import Seen, covered, found_again, in_image
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import AttitudeAt, DropCause, Source
from companion.pipeline.transform import LevelTransform
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, quaternion_from_euler, rotation_from_euler
from core.types import CameraInfo, Intrinsics
from tests.conftest import CHECKOUT

CAMERA = CameraInfo("front", Intrinsics(640, 480, 450.0, 450.0, 319.5, 239.5), max_range_m=20.0)
WALL = (8.0, -2.0, 8.0, 2.0, -1.0, 1.0)
"""4 m wide, 2 m high, 8 m ahead: well inside the image."""


def seen(*planes: tuple[float, ...], at: tuple[float, float, float] = (0.0, 0.0, 0.0), yaw: float = 0.0) -> Seen:
    R = rotation_from_euler(0.0, 0.0, yaw) @ R_CAMFRD_OPTICAL
    table = np.array(planes, np.float64).reshape(-1, 6)
    return Seen(planes=table, info=CAMERA, R_ned_optical=R, position_m=np.array(at))


def moved(plane: tuple[float, ...], x: float) -> tuple[float, ...]:
    return (plane[0] + x, plane[1], plane[2] + x, *plane[3:])


def test_the_same_model_is_found_again_whole() -> None:
    found = found_again(seen(WALL), seen(WALL), 0.01)
    assert (found.by_area, found.by_view) == (1.0, 1.0)
    assert found.area_m2 == pytest.approx(8.0)


def test_a_model_that_moved_is_found_within_the_distance_only() -> None:
    assert found_again(seen(WALL), seen(moved(WALL, 0.25)), 0.3).by_area == 1.0
    assert found_again(seen(WALL), seen(moved(WALL, -0.25)), 0.3).by_area == 1.0
    assert found_again(seen(WALL), seen(moved(WALL, 0.25)), 0.2).by_area == 0.0


def test_half_of_a_wall_is_half_found() -> None:
    half = (8.0, -2.0, 8.0, 0.0, -1.0, 1.0)
    assert found_again(seen(WALL), seen(half), 0.01).by_area == pytest.approx(0.5)
    assert found_again(seen(half), seen(WALL), 0.01).by_area == 1.0, "what is new does not count against the old"
    low = (8.0, -2.0, 8.0, 2.0, 0.0, 1.0)
    assert found_again(seen(WALL), seen(low), 0.01).by_area == pytest.approx(0.5), "heights count as well"


def test_by_view_near_objects_count_more_than_by_area() -> None:
    """A wall at 4 m and one of the same size at 16 m, side by side: the far one is lost."""
    near, far = (4.0, -1.5, 4.0, -0.5, -0.5, 0.5), (16.0, 0.5, 16.0, 1.5, -0.5, 0.5)
    found = found_again(seen(near, far), seen(near), 0.3)
    assert found.by_area == pytest.approx(0.5)
    assert 0.92 < found.by_view < 0.95  # 16 to 1, a little less: the near one is seen at an angle


def test_a_wall_seen_edge_on_has_no_share_of_the_view() -> None:
    edge_on = (4.0, 0.0, 8.0, 0.0, -0.01, 0.01)
    found = found_again(seen(edge_on), seen(edge_on), 0.1)
    assert found.by_area == 1.0
    assert math.isnan(found.by_view)


def test_only_what_the_next_exposure_can_see_is_asked_for() -> None:
    """The next camera looks 60 degrees to the right, or stands behind the wall, or the wall is beyond its range."""
    assert math.isnan(found_again(seen(WALL), seen(yaw=math.radians(60.0)), 0.3).by_area)
    assert found_again(seen(WALL), seen(at=(9.0, 0.0, 0.0)), 0.3).area_m2 == 0.0
    assert found_again(seen(WALL), seen(at=(-14.0, 0.0, 0.0)), 0.3).area_m2 == 0.0
    turned = found_again(seen(WALL), seen(yaw=math.radians(40.0)), 0.3)
    assert 0.0 < turned.area_m2 < 8.0
    assert turned.by_area == 0.0, "an empty model finds nothing of it"
    assert math.isnan(found_again(seen(), seen(WALL), 0.3).by_area), "and of an empty one nothing can be found"


def test_pose_is_taken_out_before_comparing() -> None:
    """The same wall from another place and heading is the same; with the pose forgotten it is not."""
    there = seen(WALL, at=(1.0, 0.5, 0.0), yaw=0.1)
    assert found_again(seen(WALL), there, 0.01).by_area == 1.0
    as_if_not_moved = seen((7.0, -2.5, 7.0, 1.5, -1.0, 1.0))
    assert found_again(seen(WALL), as_if_not_moved, 0.3).by_area == 0.0


def test_points_cover_the_area_and_have_their_normal() -> None:
    points, area, normals = covered(np.array([(1.0, 0.0, 1.0, 0.25, -0.1, 0.15), (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)]))
    assert len(points) == 3 * 3, "a plane without length has no area"
    assert area.sum() == pytest.approx(0.25 * 0.25)
    np.testing.assert_allclose(points[:, 0], 1.0)
    np.testing.assert_allclose(np.abs(normals), np.tile([1.0, 0.0, 0.0], (9, 1)))
    assert points[:, 1].min() > 0.0
    assert points[:, 1].max() < 0.25


def test_in_image_follows_the_cameras_attitude() -> None:
    """A point 30 degrees below the horizon is in the image of a camera that looks down by 30, not of a level one."""
    point = np.array([[10.0, 0.0, 5.77]])
    level = seen()
    down = replace(level, R_ned_optical=rotation_from_euler(0.0, math.radians(-30.0), 0.0) @ R_CAMFRD_OPTICAL)
    assert in_image(point, down).tolist() == [True]
    assert in_image(point, level).tolist() == [False]


def result(frame: str = "ned", drop: DropCause = DropCause.NONE) -> PrismsResult:
    depth: NDArray[np.uint16] = np.full((480, 640), 8000, np.uint16)
    model, _ = Extractor().extract(depth, CAMERA, R_CAMFRD_OPTICAL)
    attitude = AttitudeAt(quaternion_from_euler(0.0, 0.0, 0.3), Source.EXACT, 0)
    return PrismsResult(
        camera="front",
        sequence=0,
        t_exposure_ns=0,
        t_arrival_ns=0,
        frame=frame,
        drop=drop,
        model=model if drop is DropCause.NONE else None,
        attitude=attitude,
        transform=LevelTransform(0.3, (1.0, 2.0, -3.0)),
    )


def test_frames_without_a_position_or_a_model_are_not_compared() -> None:
    good, level, blind = result(), result("level"), result(drop=DropCause.NO_ATTITUDE)
    assert len(comparable([good, good, level, good, good, blind, good], CAMERA)) == 2
    (pair,) = comparable([good, good], CAMERA)
    assert pair[0].position_m.tolist() == [1.0, 2.0, -3.0]
    np.testing.assert_allclose(pair[0].R_ned_optical @ [0.0, 0.0, 1.0], [math.cos(0.3), math.sin(0.3), 0.0], atol=1e-12)


def test_without_recordings_the_page_states_it(tmp_path: Path) -> None:
    assert "No recordings lie beside this checkout" in section(tmp_path, quick=True, data=tmp_path / "nowhere")


def test_a_recording_becomes_a_page(shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "RECORDINGS", page.RECORDINGS[1:])
    text = section(tmp_path, quick=True, data=shared_data)
    assert "a photoreal simulated living room" in text
    assert "| 640x480 | 5 | 5 |" in text
    assert "## What of one frame is found again in the next" in text
    assert f"{CHECKOUT}" not in text


def test_a_slow_flight_through_a_room_keeps_its_model(shared_data: Path) -> None:
    """What each asserts was measured with some room to spare: 0.99 within 0.5 m, 0.93 within 0.3 m."""
    flown = fly(shared_data / "o3d_livingroom_sim", "room", "a room", "indoor.toml", 1)
    assert [len(flown.again[r]) for r in flown.again] == [4, 4, 4, 4]
    means = {reach: float(np.mean([f.by_area for f in found])) for reach, found in flown.again.items()}
    assert means[0.1] <= means[0.2] <= means[0.3] <= means[0.5]
    assert means[0.5] > 0.9
    assert means[0.3] > 0.8
