"""Messages: lossless encoding and decoding, and complete tables."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion

from companion.log.foxglove_scene import distance_colour, scene_message, transform_messages
from companion.pipeline import encode as m
from companion.pipeline.causes import CAUSES
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.quaternion import product
from companion.pipeline.results import FrameDecision, PrismsResult
from companion.pipeline.state import CameraState, PipelineState
from companion.pipeline.state_messages import state_from_message, state_message
from companion.pipeline.sync import AttitudeAt, DropCause, PoseAt, Source
from core.frames import rotation_frd_optical, rotation_from_quaternion
from core.types import ExtractorState, FrameStats, InvalidCause
from drivers.logs import codec as wire
from drivers.logs.topics import TOPICS, camera_name_fits, find_topic
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import INFO, START_NS, EasyExtractor, attitude, easy_model, flight, frame, pose


def results() -> list[PrismsResult]:
    line = Pipeline((INFO,), EasyExtractor)
    return [o for e in flight(3) for o in line.handle(e) if isinstance(o, PrismsResult)]


def wired(message):
    """Through the wire."""
    return type(message).FromString(m.wire_bytes(message))


@pytest.mark.parametrize("sample", [attitude(START_NS), attitude(START_NS, rates=False)])
def test_attitudes_return_unchanged(sample):
    assert wire.attitude_from_message(wired(wire.attitude_message(sample))) == sample


@pytest.mark.parametrize("sample", [pose(START_NS), dataclasses.replace(pose(START_NS), velocity_ned_m_s=None)])
def test_positions_return_unchanged(sample):
    assert wire.pose_from_message(wired(wire.pose_message(sample))) == sample


def test_what_stands_still_at_the_origin_is_reported_and_not_absent():
    still = dataclasses.replace(pose(START_NS), position_ned_m=(0.0, 0.0, 0.0), velocity_ned_m_s=(0.0, 0.0, 0.0))
    assert wire.pose_from_message(wired(wire.pose_message(still))) == still
    turning = dataclasses.replace(attitude(START_NS), rates_frd_rad_s=(0.0, 0.0, 0.0))
    assert wire.attitude_from_message(wired(wire.attitude_message(turning))) == turning


def test_cameras_return_unchanged():
    assert wire.camera_from_message(wired(wire.camera_message(INFO))) == INFO


def test_depth_returns_unchanged_and_may_have_padded_rows():
    before = frame(7, START_NS)
    message = wired(wire.depth_message(before))
    after = wire.depth_from_message(message, INFO, 7, before.t_arrival_ns)
    np.testing.assert_array_equal(after.depth_mm, before.depth_mm)
    assert (after.camera, after.sequence, after.t_exposure_ns) == ("front", 7, START_NS)
    padded = np.zeros((48, 70), "<u2")
    padded[:, :64] = before.depth_mm
    message.step, message.data = 140, padded.tobytes()
    again = wire.depth_from_message(message, INFO, 7, before.t_arrival_ns)
    np.testing.assert_array_equal(again.depth_mm, before.depth_mm)
    assert again.depth_mm.flags.c_contiguous


@pytest.mark.parametrize(
    ("field", "value", "cause"),
    [
        ("encoding", "32FC1", "encoding '32FC1', expected 16UC1"),
        ("width", 63, "image of 63x48, but its camera info says 64x48"),
        ("step", 100, "rows of 100 bytes"),
        ("data", b"\0\0", "holds 2 bytes"),
    ],
)
def test_images_that_do_not_fit_are_refused(field, value, cause):
    message = wire.depth_message(frame(0, START_NS))
    setattr(message, field, value)
    with pytest.raises(ValueError, match=cause):
        wire.depth_from_message(message, INFO, 0, 0)


@pytest.mark.parametrize("t_ns", [0, 1, 999_999_999, 12_345_678_901_234_567, -5])
def test_stamps_return_unchanged(t_ns):
    assert wire.stamp_ns(wire.stamp(t_ns)) == t_ns


def assert_same_fields(a, b, without=()):
    """Every field, so that a new one that is not encoded fails."""
    for name in (f.name for f in dataclasses.fields(a) if f.name not in without):
        one, other = getattr(a, name), getattr(b, name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other, name)
            assert one.dtype == other.dtype, name
        else:
            assert one == other, name


def test_prisms_return_unchanged_bit_by_bit():
    for before in results():
        after = m.prisms_from_message(wired(m.prisms_message(before)))
        assert (after.camera, after.sequence, after.t_exposure_ns) == ("front", before.sequence, before.t_exposure_ns)
        assert (after.frame, after.valid, after.attitude, after.pose) == ("ned", True, before.attitude, before.pose)
        assert after.transform == before.transform
        a, b = before.model, after.model
        assert_same_fields(a, b, without=("free", "prisms", "strips"))
        assert_same_fields(a.free, b.free)
        for one, other in zip(a.prisms, b.prisms, strict=True):
            assert_same_fields(one, other)
        assert m.wire_bytes(m.prisms_message(after)) == m.wire_bytes(m.prisms_message(before))


def blind(drop: DropCause) -> PrismsResult:
    return PrismsResult(
        camera="front", sequence=1, t_exposure_ns=2, t_arrival_ns=3, frame="level", drop=drop, model=None
    )


@pytest.mark.parametrize("cause", [c for c in DropCause if c])
def test_each_cause_of_a_drop_returns(cause):
    message = wired(m.prisms_message(blind(cause)))
    assert not message.valid
    assert message.cause_text == cause.text
    assert m.prisms_from_message(message).drop is cause


@pytest.mark.parametrize("cause", [c for c in InvalidCause if c])
def test_each_cause_of_silence_returns(cause):
    model = dataclasses.replace(easy_model(1.0, 0.0, valid=False), cause=cause)
    message = wired(m.prisms_message(dataclasses.replace(results()[0], model=model)))
    assert not message.valid
    assert m.prisms_from_message(message).model.cause is cause


def test_the_causes_are_those_of_the_schema():
    assert len(set(CAUSES.values())) == len(CAUSES)
    live_only = {pb.CAUSE_CAMERA}  # no frame at all: set by the service, never by the pipeline
    assert set(CAUSES.values()) | {pb.CAUSE_NONE} | live_only == set(pb.Cause.values())
    names = {pb.Cause.Name(number).removeprefix("CAUSE_") for number in pb.Cause.values()}
    assert {c.name for c in CAUSES} == names - {"NONE", "CAMERA"}
    assert {s.name: int(s) for s in Source} == {
        name.removeprefix("SOURCE_"): number for name, number in pb.AttitudeUsed.Source.items()
    }


def test_the_schema_holds_every_field_of_statistics_and_state():
    assert {f.name for f in dataclasses.fields(FrameStats)} == set(pb.FrameStats.DESCRIPTOR.fields_by_name)
    state = {f.name for f in dataclasses.fields(ExtractorState)}
    assert state | {"camera", "last_t_exposure_ns", "back_since_ns", "mount"} == set(
        pb.CameraState.DESCRIPTOR.fields_by_name
    )


@pytest.mark.parametrize("cutoff", [None, 0, START_NS])
def test_a_decision_has_its_fields(cutoff):
    decision = FrameDecision(
        camera="front",
        sequence=9,
        t_exposure_ns=START_NS,
        t_arrival_ns=START_NS + 1,
        cause=DropCause.GAP_TOO_WIDE,
        attitude_cutoff_ns=cutoff,
        pose=Source.EXACT,
        pose_text="no position had arrived",
    )
    message = wired(m.decision_message(decision))
    assert (message.camera, message.sequence) == ("front", 9)
    assert (message.t_exposure_ns, message.t_arrival_ns) == (START_NS, START_NS + 1)
    assert (message.used, message.cause) == (False, pb.CAUSE_GAP_TOO_WIDE)
    assert (message.attitude, message.pose) == (pb.AttitudeUsed.SOURCE_NONE, pb.AttitudeUsed.SOURCE_EXACT)
    assert (message.attitude_cutoff_ns if message.HasField("attitude_cutoff_ns") else None) == cutoff
    assert message.pose_text == "no position had arrived"


def test_a_state_returns_unchanged():
    cameras = (
        ("front", CameraState(ExtractorState(3.25, 0.004, 0.003, b"\x01\x02", 2, 120.5, 7.25), START_NS)),
        ("rear", CameraState(ExtractorState(1.0, 0.1), START_NS, back_since_ns=5)),
    )
    state = PipelineState(cameras, (attitude(0), attitude(20)), (pose(5),))
    # by their texts: since Python 3.13 dataclasses with NaN in a field are not equal
    assert repr(state_from_message(wired(state_message(state)))) == repr(state)
    fresh = state_from_message(state_message(PipelineState((("c", CameraState()),)))).cameras[0][1]
    assert math.isnan(fresh.extractor.ground_height_m)
    assert fresh.last_t_exposure_ns is None


def test_messages_that_do_not_fit_are_refused():
    message = m.prisms_message(results()[0])
    message.schema_version = 2
    with pytest.raises(ValueError, match="schema version 2; this version reads 1"):
        m.prisms_from_message(message)
    message = m.prisms_message(results()[0])
    message.planes.corners_m.append(1.0)
    with pytest.raises(ValueError, match="rows of 6"):
        m.prisms_from_message(message)
    message = m.prisms_message(results()[0])
    message.free.end = b"\0"
    with pytest.raises(ValueError, match="2 directions x 3 layers"):
        m.prisms_from_message(message)


# ---- drawn for viewers ------------------------------------------------------------------------------------------


def test_prisms_are_drawn_as_triangles_that_cover_their_faces():
    result = results()[0]
    (entity,) = scene_message(result).entities
    assert (entity.frame_id, entity.lifetime.seconds, entity.frame_locked) == ("ned", 1, False)
    corners = np.array([[p.x, p.y, p.z] for p in entity.triangles[0].points])
    points = corners[list(entity.triangles[0].indices)].reshape(-1, 3, 3)
    area = sum(0.5 * np.linalg.norm(np.cross(b - a, c - a)) for a, b, c in points)
    prism = result.model.prisms[0]
    lengths = np.linalg.norm(np.diff(prism.vertices_m.astype(float), axis=0), axis=1)
    assert area == pytest.approx(lengths.sum() * (prism.bottom_m - prism.top_m), rel=1e-5)
    assert len(entity.triangles[0].colors) == len(entity.triangles[0].points)


def test_a_closed_prism_has_its_last_face():
    result = results()[0]
    prism = result.model.prisms[0]
    closed = dataclasses.replace(prism, closed=True, plane=np.array([0, 1, 0], np.int32))
    drawn = scene_message(dataclasses.replace(result, model=dataclasses.replace(result.model, prisms=(closed,))))
    assert len(drawn.entities[0].triangles[0].indices) == 3 * 6


def test_a_blind_camera_takes_its_drawing_away():
    update = scene_message(blind(DropCause.NO_ATTITUDE))
    assert not update.entities
    assert update.deletions[0].type == SceneEntityDeletion.MATCHING_ID
    assert update.deletions[0].id == scene_message(results()[0]).entities[0].id


@pytest.mark.parametrize(
    ("vertices", "nearest_m"), [([[5, -3], [5, 3]], 5.0), ([[3, 4], [9, 4]], 5.0), ([[3, 4], [3, 4]], 5.0)]
)
def test_colours_go_by_the_nearest_point_of_a_face(vertices, nearest_m):
    result = dataclasses.replace(results()[0], transform=None)
    face = dataclasses.replace(
        result.model.prisms[0], vertices_m=np.array(vertices, np.float32), plane=np.array([0], np.int32)
    )
    drawn = scene_message(dataclasses.replace(result, model=dataclasses.replace(result.model, prisms=(face,))))
    assert drawn.entities[0].triangles[0].colors[0] == distance_colour(nearest_m)


def test_near_is_red_and_far_is_blue():
    near, far = distance_colour(0.5), distance_colour(40.0)
    assert (near.r, near.g, near.b) == (1.0, 0.0, 0.0)
    assert (far.r, far.g, far.b) == (0.0, 0.0, 1.0)


def test_the_chain_of_transforms_is_that_of_the_frames():
    result = results()[1]
    tree = transform_messages(result, INFO)
    assert [t.parent_frame_id for t in tree] == ["up", "ned", "level", "frd"]
    assert [t.child_frame_id for t in tree] == ["ned", "level", "frd", "front_optical"]
    total = (1.0, 0.0, 0.0, 0.0)
    for t in tree:
        total = product(total, (t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z))
    R_ned_frd = rotation_from_quaternion(result.attitude.q_ned_frd_wxyz)
    up_from_ned = np.diag([1.0, -1.0, -1.0])
    expected = up_from_ned @ R_ned_frd @ rotation_frd_optical(INFO.mount)
    np.testing.assert_allclose(rotation_from_quaternion(total), expected, atol=1e-12)
    level = rotation_from_quaternion((tree[1].rotation.w, 0.0, 0.0, tree[1].rotation.z))
    camera = level.T @ (np.array(result.transform.translation_m) - result.pose.position_ned_m)
    lever = R_ned_frd @ [INFO.mount.x_m, INFO.mount.y_m, INFO.mount.z_m]
    np.testing.assert_allclose(level @ camera, lever, atol=1e-12)
    assert tree[1].translation.x == result.pose.position_ned_m[0]


def test_without_attitude_nothing_is_transformed():
    assert transform_messages(blind(DropCause.NO_ATTITUDE), INFO) == ()


def test_without_a_position_ned_is_drawn_at_the_vehicle():
    bare = dataclasses.replace(
        results()[0], attitude=AttitudeAt((1.0, 0.0, 0.0, 0.0), Source.EXACT, 0), pose=None, frame="level"
    )
    assert transform_messages(bare, INFO)[1].translation.x == 0.0
    moved = dataclasses.replace(bare, pose=PoseAt((4.0, 0.0, 0.0), Source.EXACT, 0, 0))
    assert transform_messages(moved, INFO)[1].translation.x == 4.0


# ---- the table of topics ----------------------------------------------------------------------------------------


def test_topics_are_found_by_name_and_schema():
    for key, topic in TOPICS.items():
        camera = "front-2" if "{camera}" in topic.name else ""
        assert find_topic(topic.of(camera), topic.schema) == (key, camera)
    assert find_topic("/camera/front/depth", "sensor_msgs/msg/Image") is None
    assert find_topic("/camera/a/b/depth", "foxglove.RawImage") is None
    assert find_topic("/somewhere", "foxglove.RawImage") is None


@pytest.mark.parametrize(
    ("name", "fits"), [("front", True), ("cam_2.left-a", True), ("a/b", False), ("", False), ("ä", False)]
)
def test_camera_names_must_fit_a_topic(name, fits):
    assert camera_name_fits(name) is fits
