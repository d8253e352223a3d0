"""Several cameras as one model: equal places coincide, and a blind camera is marked."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.pipeline.multi_camera import (
    AllCamerasModel,
    AllCamerasModelBuilder,
    UnavailableCamera,
    all_cameras_message,
)
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.frames import horizontal_heading_rad, rotation_frd_optical, rotation_from_euler, rotation_from_quaternion
from core.types import CameraInfo, CameraMount, PoseSample
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import INFO, MS, START_NS, EasyExtractor, attitude, frame, pose

RIGHT = replace(INFO, camera="right", mount=CameraMount(yaw_rad=1.5, roll_rad=0.1, x_m=-0.1, y_m=0.3, z_m=-0.05))
BOTH = (INFO, RIGHT)


def sees(camera: str) -> str:
    return ""


def results(poses: dict[str, PoseSample | None] | None = None) -> dict[str, PrismsResult]:
    """A frame of each camera, 60 ms apart in a turn, each with its own position or none."""
    out = {}
    for info, t_ns in ((INFO, START_NS), (RIGHT, START_NS + 60 * MS)):
        pipeline = Pipeline((info,), EasyExtractor)
        for t in range(t_ns - 40 * MS, t_ns + 1, 20 * MS):
            pipeline.handle(attitude(t))
        located = pose(t_ns) if poses is None else poses[info.camera]
        if located is not None:
            pipeline.handle(located)
        result = pipeline.handle(frame(7, t_ns, camera=info.camera))[1]
        assert isinstance(result, PrismsResult)
        assert result.valid
        out[info.camera] = result
    return out


def keeper(found: dict[str, PrismsResult]) -> AllCamerasModelBuilder:
    keeper = AllCamerasModelBuilder(tuple(info.camera for info in BOTH))
    for result in found.values():
        keeper.result(result)
    return keeper


def corners_ned_minus_vehicle(info: CameraInfo, t_ns: int) -> np.ndarray:
    """(N, 2) points a of the camera's planes from the vehicle, north and east: the geometry anew, from the
    planes of the small extractor."""
    R_ned_frd = rotation_from_quaternion(attitude(t_ns).q_ned_frd_wxyz)
    heading = horizontal_heading_rad(R_ned_frd @ rotation_frd_optical(info.mount))
    lever = R_ned_frd @ np.array([info.mount.x_m, info.mount.y_m, info.mount.z_m])
    model, _ = EasyExtractor(info).extract(frame(7, t_ns).depth_mm, info, np.eye(3))
    points = np.column_stack([model.planes[:, :2], np.zeros(len(model.planes))])
    return (rotation_from_euler(0.0, 0.0, heading) @ points.T).T[:, :2] + lever[:2]


def planes_of(surround: AllCamerasModel, camera: str) -> np.ndarray:
    part = next(p for p in surround.parts if p.camera == camera)
    assert isinstance(part, PrismsResult)
    assert part.model is not None
    return part.model.planes


def test_with_positions_all_stand_in_ned_as_they_were() -> None:
    found = results()
    surround = keeper(found).model(sees)
    assert (surround.frame, surround.t_ns) == ("ned", START_NS + 60 * MS)
    assert list(surround.parts) == [found["front"], found["right"]]


@pytest.mark.parametrize("known", [(), ("front",), ("right",)])
def test_without_a_position_of_all_the_turn_between_exposures_is_taken_out(known: tuple[str, ...]) -> None:
    times = {"front": START_NS, "right": START_NS + 60 * MS}
    found = results({name: pose(t) if name in known else None for name, t in times.items()})
    surround = keeper(found).model(sees)
    assert (surround.frame, surround.t_ns) == ("level", times["right"])
    R_ned_frd = rotation_from_quaternion(attitude(times["right"]).q_ned_frd_wxyz)
    heading = math.atan2(R_ned_frd[1, 0], R_ned_frd[0, 0])
    for info in BOTH:
        there = corners_ned_minus_vehicle(info, times[info.camera])
        expected = (rotation_from_euler(0.0, 0.0, -heading)[:2, :2] @ there.T).T
        assert planes_of(surround, info.camera)[:, :2] == pytest.approx(expected, abs=1e-4)
    parts = [p for p in surround.parts if isinstance(p, PrismsResult)]
    assert all(p.frame == "level" and p.pose is None for p in parts)


def test_level_is_along_the_heading_of_the_newest_exposure_also_after_jumps_of_the_heading() -> None:
    found = results(dict.fromkeys(("front", "right")))
    plain = keeper(found).model(sees)
    jumped = {}
    for camera, result in found.items():
        assert result.attitude is not None
        jumped[camera] = replace(result, attitude=replace(result.attitude, turned_rad=0.7))
    after = keeper(jumped).model(sees)
    assert after.frame == "level"
    for camera in ("front", "right"):
        np.testing.assert_allclose(planes_of(after, camera), planes_of(plain, camera), atol=1e-5)


def test_the_place_of_a_camera_moves_with_what_it_saw() -> None:
    """Ranges are counted from there: a point at a range and direction must stay where it is."""
    found = results({"front": pose(START_NS), "right": None})
    part = keeper(found).model(sees).parts[0]
    assert isinstance(part, PrismsResult)
    assert part.transform is not None
    assert part.model is not None
    lever = corners_ned_minus_vehicle(INFO, START_NS) - corners_ned_minus_vehicle(
        replace(INFO, mount=replace(INFO.mount, x_m=0.0, y_m=0.0, z_m=0.0)), START_NS
    )
    R_ned_frd = rotation_from_quaternion(attitude(START_NS + 60 * MS).q_ned_frd_wxyz)
    heading = math.atan2(R_ned_frd[1, 0], R_ned_frd[0, 0])
    expected = rotation_from_euler(0.0, 0.0, -heading)[:2, :2] @ lever[0]
    assert part.transform.translation_m[:2] == pytest.approx(expected, abs=1e-6)
    assert part.model.free.azimuth_edges_rad[1] == pytest.approx(part.transform.yaw_rad, abs=1e-6)


def test_a_jump_of_the_position_between_the_exposures_is_not_smeared_over_the_model() -> None:
    jumped = replace(pose(START_NS + 60 * MS), reset_counter=2, position_ned_m=(80.0, 0.0, -4.0))
    surround = keeper(results({"front": pose(START_NS), "right": jumped})).model(sees)
    assert surround.frame == "level"
    assert np.abs(planes_of(surround, "right")[:, :4]).max() < 12.0


def test_a_blind_camera_is_reported_and_keeps_no_planes() -> None:
    surround = keeper(results()).model(lambda camera: "silent: unplugged" if camera == "right" else "")
    blind = surround.parts[1]
    assert blind == UnavailableCamera(
        camera="right", sequence=7, t_exposure_ns=START_NS + 60 * MS, cause_text="silent: unplugged"
    )
    assert surround.t_ns == START_NS
    message = all_cameras_message(surround, frozenset({"front"}))
    assert message.valid
    assert [c.valid for c in message.cameras] == [True, False]
    assert not message.cameras[1].planes.corners_m
    assert not message.cameras[1].free.free_to_m
    assert message.cameras[1].cause == pb.CAUSE_CAMERA


def test_a_result_of_long_ago_is_not_taken_for_the_frame_that_ended_the_blindness() -> None:
    """Whoever judges blindness may know of a good frame before its result is here."""
    surround = keeper(results()).model(sees, oldest_ns=START_NS + 30 * MS)
    assert isinstance(surround.parts[0], UnavailableCamera)
    assert surround.parts[0].cause_text
    assert isinstance(surround.parts[1], PrismsResult)


@pytest.mark.parametrize("required", [frozenset(), frozenset({"front"}), frozenset({"right"})])
def test_without_a_required_camera_or_without_any_it_is_not_valid(required: frozenset[str]) -> None:
    only_front = AllCamerasModelBuilder(("front", "right"))
    only_front.result(results()["front"])
    assert all_cameras_message(only_front.model(sees), required).valid == ("right" not in required)
    nothing = AllCamerasModelBuilder(("front", "right")).model(sees)
    assert nothing.t_ns == 0
    assert [p.cause_text for p in nothing.parts] == ["no frame yet", "no frame yet"]
    assert not all_cameras_message(nothing, required).valid


def test_an_invalid_frame_takes_the_place_of_a_valid_one() -> None:
    found = results()
    both = keeper(found)
    pipeline = Pipeline((INFO,), EasyExtractor)
    dropped = pipeline.handle(frame(8, START_NS + 100 * MS))[1]  # no attitude
    assert isinstance(dropped, PrismsResult)
    both.result(dropped)
    part = both.model(sees).parts[0]
    assert isinstance(part, UnavailableCamera)
    assert part.cause_text == dropped.cause_text != ""
