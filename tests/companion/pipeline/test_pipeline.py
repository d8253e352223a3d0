"""The pipeline with an extractor that is easy to foresee: decisions, frames, state."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import FrameDecision, PrismsResult
from companion.pipeline.state_messages import state_from_message, state_message
from companion.pipeline.sync import DropCause, PoseAt, Source
from companion.pipeline.transform import LevelTransform, seed_ground_height, transform_from_level_cam, transform_model
from core.frames import (
    level_cam_at,
    quaternion_from_euler,
    rotation_frd_optical,
    rotation_from_euler,
    rotation_level_cam_optical,
)
from core.types import CameraInfo, CameraMount, DepthFrame, ExtractorState, Intrinsics, InvalidCause

from ..small_recordings import INFO, MS, START_NS, EasyExtractor, attitude, easy_model, flight, frame, pose


def pipeline(state=None, cameras=(INFO,)) -> Pipeline:
    return Pipeline(cameras, EasyExtractor, state=state)


def outputs(events, line: Pipeline | None = None):
    line = line or pipeline()
    return [output for event in events for output in line.handle(event)]


def test_each_frame_gives_a_decision_and_prisms():
    found = outputs(flight(5))
    decisions, results = found[::2], found[1::2]
    assert all(isinstance(d, FrameDecision) and d.used for d in decisions)
    assert [r.sequence for r in results] == list(range(5))
    assert all(r.valid and r.frame == "ned" and r.cause_text == "" for r in results)
    assert {d.attitude for d in decisions} == {Source.INTERPOLATED}
    assert all(d.attitude_cutoff_ns <= d.t_arrival_ns for d in decisions)


def test_only_what_has_arrived_is_used():
    """The attitude after the exposure arrives after the frame: the frame is carried forward, not interpolated."""
    early = frame(0, START_NS + 10 * MS, arrival_ns=START_NS + 12 * MS)
    before, after = attitude(START_NS), attitude(START_NS + 20 * MS)
    (decision, _) = outputs([before, early, after])
    assert decision.attitude is Source.EXTRAPOLATED
    assert decision.attitude_cutoff_ns == START_NS
    (decision, _) = outputs([before, after, early])
    assert decision.attitude is Source.INTERPOLATED


def test_a_frame_without_attitude_is_published_as_blind():
    decision, result = outputs([frame(0, START_NS)])
    assert decision.cause is DropCause.NO_ATTITUDE
    assert decision.attitude_cutoff_ns is None
    assert isinstance(result, PrismsResult)
    assert not result.valid
    assert result.model is None
    assert result.cause_text == "no attitude had arrived"


def test_an_invalid_frame_keeps_its_cause():
    empty = dataclasses.replace(frame(0, START_NS), depth_mm=np.zeros((48, 64), np.uint16))
    decision, result = outputs([attitude(START_NS), empty])
    assert decision.used
    assert not result.valid
    assert result.cause_text == InvalidCause.NO_MEASUREMENT.text


def test_an_image_of_the_wrong_size_is_blind():
    wrong = dataclasses.replace(frame(0, START_NS), depth_mm=np.ones((24, 64), np.uint16))
    decision, result = outputs([attitude(START_NS), wrong])
    assert decision.cause is DropCause.WRONG_SIZE
    assert not result.valid


def test_the_same_and_earlier_exposures_are_reported_but_not_published():
    samples = [attitude(START_NS + i * 20 * MS) for i in range(6)]
    later = frame(2, START_NS + 50 * MS)
    found = outputs([*samples, later, later, frame(1, START_NS + 40 * MS)])
    assert [type(f) for f in found] == [FrameDecision, PrismsResult, FrameDecision, FrameDecision]
    assert [found[2].cause, found[3].cause] == [DropCause.DUPLICATE_FRAME, DropCause.LATE_FRAME]


def test_the_state_of_a_restarted_camera_is_reset():
    """Its frames count from when they have stepped back for RESTART_STEP_NS in a row, also from a snapshot in between."""
    line = pipeline()
    outputs([attitude(START_NS), frame(0, START_NS), frame(1, START_NS + 10 * MS)], line)
    assert dict(line.state().cameras)["front"].extractor.ground_height_m == 2.0
    back_ns = START_NS - 5000 * MS
    for k in range(10):
        at_ns = back_ns + k * 100 * MS
        found = outputs([attitude(at_ns), frame(k, at_ns)], line)
        assert [d.cause for d in found] == [DropCause.LATE_FRAME], k
        assert dict(line.state().cameras)["front"].extractor.ground_height_m == 2.0
    line = pipeline(state_from_message(state_message(line.state())))
    at_ns = back_ns + 1000 * MS
    (decision, result) = outputs([attitude(at_ns), frame(10, at_ns)], line)
    assert decision.used
    assert result.model.ground.height_m == 0.0
    assert dict(line.state().cameras)["front"].extractor.ground_height_m == 1.0
    assert line.counts["camera_restarts"] == 1


@pytest.mark.parametrize("back_ms", [[2000], [4000, 3950, 3900], [3900, 3950, 4000]])
def test_a_few_frames_with_stamps_of_the_past_are_left_out_and_reset_nothing(back_ms):
    """A camera's buffer that is read late, or a stamp that is wrong: attitudes of that time are still held."""
    line = pipeline()
    samples = [attitude(START_NS + k * 100 * MS) for k in range(-50, 30)]
    assert outputs([*samples, frame(0, START_NS)], line)[0].used
    for again in range(2):
        for k, ms in enumerate(back_ms):
            found = outputs([frame(1 + k, START_NS - ms * MS)], line)
            assert [d.cause for d in found] == [DropCause.LATE_FRAME]
        decision, result = outputs([frame(9, START_NS + (1 + again) * 800 * MS)], line)
        assert decision.used
        assert result.model.ground.height_m == 1.0 + again
    assert line.counts["camera_restarts"] == 0


def test_frames_that_follow_a_late_one_do_not_count_as_a_step_back_in_a_row():
    line = pipeline()
    outputs([attitude(START_NS + k * 100 * MS) for k in range(-50, 30)], line)
    for number, ms in enumerate((0, -4000, -100, -2900)):
        found = outputs([frame(number, START_NS + ms * MS)], line)
        assert (found[0].cause is DropCause.LATE_FRAME) is (number > 0)
    assert line.counts["camera_restarts"] == 0


def test_a_camera_whose_stamps_step_back_twice_is_blind_for_the_last_step_only():
    """It restarts while frames of its first start are still late."""
    line = pipeline()
    outputs([attitude(START_NS), frame(0, START_NS), frame(1, START_NS - 2000 * MS)], line)
    for k in range(11):
        at_ns = START_NS - 4500 * MS + k * 100 * MS
        found = outputs([attitude(at_ns), frame(k, at_ns)], line)
    assert found[0].used
    assert line.counts["camera_restarts"] == 1


def test_a_camera_described_otherwise_gets_an_extractor_of_its_description():
    made = []

    def make_extractor(info: CameraInfo) -> EasyExtractor:
        made.append(info)
        return EasyExtractor(info)

    line = Pipeline((INFO,), make_extractor)
    outputs([attitude(START_NS), frame(0, START_NS)], line)
    changed = dataclasses.replace(INFO, max_range_m=INFO.max_range_m / 2.0)
    line.announce(INFO)
    assert made == [INFO]
    line.announce(changed)
    assert made == [INFO, changed]
    assert line.cameras == (changed,)
    assert dict(line.state().cameras)["front"].extractor == ExtractorState()


def test_an_unknown_camera_is_refused():
    with pytest.raises(ValueError, match=r"camera 'rear', which was not announced; announced: front"):
        outputs([frame(0, START_NS, camera="rear")])


def test_two_cameras_need_two_names():
    with pytest.raises(ValueError, match="same name"):
        pipeline(cameras=(INFO, INFO))


def test_cameras_do_not_share_state():
    rear = dataclasses.replace(INFO, camera="rear", mount=CameraMount(yaw_rad=np.pi))
    line = pipeline(cameras=(INFO, rear))
    outputs([attitude(START_NS), frame(0, START_NS), frame(1, START_NS + MS), frame(0, START_NS, camera="rear")], line)
    states = dict(line.state().cameras)
    assert states["front"].extractor.ground_height_m == 2.0
    assert states["rear"].extractor.ground_height_m == 1.0


@pytest.mark.parametrize("cut", [1, 17, 40, 61])
def test_a_pipeline_started_from_a_snapshot_goes_on_exactly(cut):
    events = flight(8)
    whole = [o for o in outputs(events) if isinstance(o, PrismsResult)]
    first = pipeline()
    early = [o for o in outputs(events[:cut], first) if isinstance(o, PrismsResult)]
    late = [o for o in outputs(events[cut:], pipeline(first.state())) if isinstance(o, PrismsResult)]
    assert len(early) + len(late) == len(whole) == 8
    for a, b in zip(whole, early + late, strict=True):
        assert (a.sequence, a.attitude, a.pose, a.transform) == (b.sequence, b.attitude, b.pose, b.transform)
        np.testing.assert_array_equal(a.model.planes, b.model.planes)
        assert a.model.ground == b.model.ground


def test_without_a_position_the_model_is_in_level():
    found = outputs(flight(2, poses=False))
    assert {r.frame for r in found[1::2]} == {"level"}
    assert found[0].pose_text == "no position had arrived"


@pytest.mark.parametrize("with_pose", [False, True])
@pytest.mark.parametrize(
    "mount", [CameraMount(), INFO.mount, CameraMount(yaw_rad=np.pi, x_m=-0.3), CameraMount(pitch_rad=-0.6, yaw_rad=1.5)]
)
def test_a_point_ends_where_the_chain_of_rotations_puts_it(mount, with_pose):
    """level_cam -> published, against optical -> frd -> ned done directly."""
    R_ned_frd = rotation_from_euler(0.2, -0.15, 2.1)
    R_frd_optical = rotation_frd_optical(mount)
    p_optical = np.array([0.7, -0.4, 5.0])
    p_frd = R_frd_optical @ p_optical + [mount.x_m, mount.y_m, mount.z_m]
    p_ned = R_ned_frd @ p_frd
    at = PoseAt((10.0, -20.0, -30.0), Source.EXACT, 0, 0) if with_pose else None
    expected = p_ned + at.position_ned_m if at else rotation_from_euler(0.0, 0.0, -2.1) @ p_ned

    p_level_cam = rotation_level_cam_optical(R_ned_frd @ R_frd_optical) @ p_optical
    _, *level_cam = level_cam_at(quaternion_from_euler(0.2, -0.15, 2.1), mount)
    transform = transform_from_level_cam(*level_cam, at)
    found = rotation_from_euler(0.0, 0.0, transform.yaw_rad) @ p_level_cam + transform.translation_m
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_reframing_moves_everything_alike_and_back():
    transform = LevelTransform(0.7, (3.0, -4.0, 5.0))
    model = easy_model(4.0, 2.0)
    moved = transform_model(model, transform)
    c, s = np.cos(0.7), np.sin(0.7)
    a = model.planes[0, 0:2]
    np.testing.assert_allclose(moved.planes[0, 0:2], [c * a[0] - s * a[1] + 3, s * a[0] + c * a[1] - 4], rtol=1e-6)
    np.testing.assert_allclose(moved.planes[:, 4:], model.planes[:, 4:] + 5.0)
    np.testing.assert_array_equal(moved.prisms[0].vertices_m[0], moved.planes[0, 0:2])
    assert moved.prisms[0].top_m == moved.planes[0, 4]
    np.testing.assert_allclose(moved.free.azimuth_edges_rad, model.free.azimuth_edges_rad + 0.7, rtol=1e-6)
    np.testing.assert_allclose(moved.free.layer_edges_m, model.free.layer_edges_m + 5.0)
    assert moved.ground.slope_x == pytest.approx(c * 0.01 + s * 0.02)
    assert moved.ground.height_m == model.ground.height_m
    back = transform_model(moved, transform.inverse())
    np.testing.assert_allclose(back.planes, model.planes, atol=1e-5)
    np.testing.assert_allclose(back.ground.slope_y, model.ground.slope_y)


def test_a_very_low_plane_far_from_the_origin_stays_a_plane():
    low = dataclasses.replace(easy_model(4.0, 2.0), prisms=())
    planes = low.planes.copy()
    planes[:, 5] = np.nextafter(planes[:, 4], np.float32(np.inf))
    moved = transform_model(dataclasses.replace(low, planes=planes), LevelTransform(0.0, (0.0, 0.0, -5000.0)))
    assert np.all(moved.planes[:, 4] < moved.planes[:, 5])


@pytest.mark.parametrize(
    ("field", "value"), [("planes", np.nan), ("margin_m", np.inf), ("free_to_m", np.nan), ("vertices_m", -np.inf)]
)
def test_what_is_no_number_makes_the_frame_blind(field, value):
    model = easy_model(4.0, 2.0)
    (prism,) = model.prisms
    if field == "vertices_m":
        model = dataclasses.replace(
            model, prisms=(dataclasses.replace(prism, vertices_m=spoilt(prism.vertices_m, value)),)
        )
    elif field == "free_to_m":
        model = dataclasses.replace(
            model, free=dataclasses.replace(model.free, free_to_m=spoilt(model.free.free_to_m, value))
        )
    else:
        model = dataclasses.replace(model, **{field: spoilt(getattr(model, field), value)})
    assert_says_nothing(transform_model(model, LevelTransform(0.7, (3.0, -4.0, 5.0))))


def test_a_place_that_is_no_number_makes_the_frame_blind():
    assert_says_nothing(transform_model(easy_model(4.0, 2.0), LevelTransform(0.7, (np.nan, 0.0, 0.0))))
    assert_says_nothing(transform_model(easy_model(4.0, 2.0), LevelTransform(0.7, (0.0, 0.0, 1e39))))  # not in float32


def spoilt(values, value):
    """A copy with its first number replaced."""
    copy = values.copy()
    copy.flat[0] = value
    return copy


def assert_says_nothing(model):
    assert not model.valid
    assert model.cause is InvalidCause.NON_FINITE
    assert len(model.planes) == len(model.prisms) == len(model.margin_m) == 0
    assert not model.free.free_to_m.any()
    assert np.isfinite(model.free.azimuth_edges_rad).all()


def test_the_wrong_size_does_not_reach_the_extractor():
    info = CameraInfo("front", Intrinsics(32, 24, 25.0, 25.0, 15.5, 11.5))
    found = outputs([attitude(START_NS), frame(0, START_NS)], pipeline(cameras=(info,)))
    assert found[0].cause is DropCause.WRONG_SIZE


def test_positions_can_be_left_aside():
    from companion.config.sync import SyncParams

    line = Pipeline((INFO,), EasyExtractor, SyncParams(use_pose=False))
    _, result = outputs([attitude(START_NS), pose(START_NS), frame(0, START_NS)], line)
    assert result.frame == "level"


def test_a_frame_is_not_a_sample_anomaly():
    line = pipeline()
    outputs([attitude(START_NS), attitude(START_NS)], line)
    assert line.sample_anomalies() == {"attitude_duplicates": 1}
    assert isinstance(frame(0, 0), DepthFrame)


@pytest.mark.parametrize(
    ("z_m", "seen_m", "with_pose", "expected_m"),
    [
        (-3.5, float("nan"), True, 3.5),  # no frame has seen the ground yet: the height is a hint
        (-3.5, 2.0, True, 2.0),  # a measured value goes before a configured one
        (-3.5, float("nan"), False, float("nan")),
        (0.2, float("nan"), True, float("nan")),  # below the origin: no height
    ],
)
def test_the_height_of_the_pose_seeds_the_ground_until_it_was_seen(z_m, seen_m, with_pose, expected_m):
    place = PoseAt((0.0, 0.0, z_m), Source.EXACT, 0, 0) if with_pose else None
    seeded = seed_ground_height(ExtractorState(seen_m, 0.002), place, LevelTransform(0.1, (1.0, 2.0, z_m)))
    np.testing.assert_equal(seeded.ground_height_m, expected_m)
    assert seeded.ke_per_m == 0.002
