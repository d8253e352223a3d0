"""Names and messages on the wire of rmw_zenoh, read back with another decoder (mcap-ros2-support).

The expected names are those of the examples in the design page (design.md) of ros2/rmw_zenoh, the type hashes those of ROS 2 Jazzy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import DropCause
from companion.pipeline.transform import LevelTransform
from companion.ros2.diagnostics import DIAGNOSTIC_ARRAY, camera_part, diagnostic_array, service_part
from companion.ros2.drawing import MARKER_ARRAY, POINT_CLOUD, TRANSFORMS, Drawing
from companion.ros2.frames import FrameTransform
from companion.ros2.message_types import RosMessages
from companion.ros2.occupied import MAX_POINTS, surface_points
from companion.ros2.wire import NodeName, TopicType, absolute_name, gid, name_part, topic_key
from osape_client.proto import osape_v1_pb2 as pb

from ..view_scenes import model

typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed (extra ros2)")

STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
STRING = TopicType("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18")
WALL = [4.0, -1.0, 4.0, 1.0, -0.6, 0.8]
STAMP_NS = 1_700_000_000_123_456_789


@pytest.fixture(scope="module")
def ros() -> RosMessages:
    return RosMessages()


def result(planes: list[list[float]] | None = None) -> PrismsResult:
    return PrismsResult(
        camera="front",
        sequence=1,
        t_exposure_ns=1,
        t_arrival_ns=1,
        frame="level",
        drop=DropCause.NONE,
        model=model([WALL] if planes is None else planes),
        transform=LevelTransform(0.0, (0.0, 0.0, 0.0)),
    )


def read(ros: RosMessages, message: Any, name: str) -> Any:
    data = ros.serialise(message, name)
    assert data[:4] == b"\x00\x01\x00\x00"  # CDR, little-endian
    definition, _ = STORE.generate_msgdef(name, ros_version=2)
    schema = Schema(id=1, name=name, encoding="ros2msg", data=definition.encode())
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode(data)


def test_a_topic_has_the_published_key() -> None:
    assert topic_key(0, "/chatter", STRING) == (
        "0/chatter/std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )
    assert topic_key(7, "/osape/front/points", STRING).startswith("7/osape/front/points/std_msgs")


def test_a_node_has_the_published_token() -> None:
    node = NodeName(0, "aac3178e146ba6f1fc6e6a4085e77f21", "/", "listener")
    assert node.token() == "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"


def test_a_publisher_has_the_published_token() -> None:
    node = NodeName(0, "8b20917502ee955ac4476e0266340d5c", "/", "talker")
    assert node.publisher_token(10, "/chatter", STRING) == (
        "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,10:,:,:,,"
    )


def test_a_publisher_has_an_identifier_of_its_own() -> None:
    assert len(gid("a")) == 16
    assert gid("a") == gid("a") != gid("b")


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("std_msgs/msg/String", STRING.type_hash),
        (POINT_CLOUD, "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"),
        (TRANSFORMS, "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
        (MARKER_ARRAY, "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"),
        (DIAGNOSTIC_ARRAY, "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
    ],
)
def test_types_have_the_published_hashes(ros: RosMessages, name: str, published: str) -> None:
    assert ros.topic_type(name).type_hash == published


@pytest.mark.parametrize(("text", "name"), [("osape", "/osape"), ("/drone1/osape", "/drone1/osape")])
def test_a_namespace_is_absolute(text: str, name: str) -> None:
    assert absolute_name(text) == name


@pytest.mark.parametrize("text", ["", "/", "1x", "a//b", "a/*", "a-b", "a/", "@x"])
def test_a_namespace_that_ros_does_not_allow_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="namespace"):
        absolute_name(text)


@pytest.mark.parametrize(
    ("camera", "part"), [("front", "front"), ("oak-d.left", "oak_d_left"), ("0", "camera_0"), ("-", "_")]
)
def test_the_name_of_a_camera_becomes_a_name_of_ros(camera: str, part: str) -> None:
    assert name_part(camera) == part


def test_prisms_are_triangles_and_planes_outlines(ros: RosMessages) -> None:
    back = read(ros, Drawing(ros).markers(result(), STAMP_NS), MARKER_ARRAY)
    prisms, planes = back.markers
    assert (prisms.ns, prisms.type, prisms.action, len(prisms.points), len(prisms.colors)) == (
        "front/prisms",
        11,
        0,
        6,
        6,
    )
    assert (planes.ns, planes.type, planes.action, len(planes.points)) == ("front/planes", 5, 0, 8)
    assert prisms.header.frame_id == "base_stabilized"
    assert (prisms.header.stamp.sec, prisms.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert (prisms.lifetime.sec, prisms.lifetime.nanosec) == (0, 500_000_000)
    corners = {(p.x, round(p.y, 6), round(p.z, 6)) for p in prisms.points}
    assert corners == {(4.0, 1.0, 0.6), (4.0, -1.0, 0.6), (4.0, -1.0, -0.8), (4.0, 1.0, -0.8)}  # left, up
    assert {(p.x, round(p.y, 6), round(p.z, 6)) for p in planes.points} == corners


def test_a_long_wall_beside_the_camera_has_the_colour_of_its_near_end(ros: RosMessages) -> None:
    """From 2 m to 30 m ahead: its middle is far away, its end is not."""
    message = read(ros, Drawing(ros).markers(result([[2.0, 0.0, 30.0, 0.0, -0.6, 0.8]]), STAMP_NS), MARKER_ARRAY)
    prisms = next(m for m in message.markers if m.ns == "front/prisms")
    assert {(c.r, c.g, c.b) for c in prisms.colors} == {(1.0, 0.0, 0.0)}  # red: 2 m and nearer


def test_a_frame_without_obstacles_deletes_the_drawing_before(ros: RosMessages) -> None:
    back = read(ros, Drawing(ros).markers(result([]), STAMP_NS), MARKER_ARRAY)
    assert [(m.ns, m.action) for m in back.markers] == [("front/prisms", 2), ("front/planes", 2)]


def test_a_frame_in_ned_is_drawn_in_map(ros: RosMessages) -> None:
    back = read(ros, Drawing(ros).markers(replace(result(), frame="ned"), STAMP_NS), MARKER_ARRAY)
    assert back.markers[0].header.frame_id == "map"
    assert {(round(p.x, 6), p.y) for p in back.markers[0].points} == {(-1.0, 4.0), (1.0, 4.0)}  # east, north


def test_an_unavailable_camera_is_a_text_and_not_an_empty_scene(ros: RosMessages) -> None:
    back = read(ros, Drawing(ros).unavailable("front", "camera unplugged", 0), MARKER_ARRAY)
    assert [(m.ns, m.action) for m in back.markers] == [("front/prisms", 2), ("front/planes", 2), ("front/state", 0)]
    assert back.markers[2].text == "front: NO DATA: camera unplugged"


def test_a_cloud_holds_the_points(ros: RosMessages) -> None:
    points = np.array([[4.0, -1.0, -0.6], [4.0, 1.0, 0.8]])
    back = read(ros, Drawing(ros).cloud(points, "level", STAMP_NS), POINT_CLOUD)
    assert (back.width, back.height, back.point_step, back.row_step, back.is_bigendian) == (2, 1, 12, 24, False)
    assert [(f.name, f.offset, f.datatype, f.count) for f in back.fields] == [
        ("x", 0, 7, 1),
        ("y", 4, 7, 1),
        ("z", 8, 7, 1),
    ]
    xyz = np.frombuffer(bytes(back.data), "<f4").reshape(-1, 3)
    assert np.allclose(xyz, [[4.0, 1.0, 0.6], [4.0, -1.0, -0.8]])


def test_an_empty_cloud_is_a_message(ros: RosMessages) -> None:
    back = read(ros, Drawing(ros).cloud(np.zeros((0, 3)), "ned", STAMP_NS), POINT_CLOUD)
    assert (back.width, len(back.data), back.header.frame_id) == (0, 0, "map")


def test_transforms_are_read_back(ros: RosMessages) -> None:
    tree = [FrameTransform("map", "base_stabilized", (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))]
    (back,) = read(ros, Drawing(ros).transforms(tree, STAMP_NS), TRANSFORMS).transforms
    assert (back.header.frame_id, back.child_frame_id) == ("map", "base_stabilized")
    assert (back.transform.translation.z, back.transform.rotation.w) == (3.0, 1.0)


def test_diagnostics_name_state_and_cause(ros: RosMessages) -> None:
    health = pb.Health(state=pb.Health.STATE_BLIND)
    health.diagnostics.add(text="front: unplugged")
    parts = [
        service_part(health, ""),
        camera_part("front", "unplugged", "camera", 1.5),
        camera_part("rear", "", "", 0.1),
    ]
    back = read(ros, diagnostic_array(ros, "osape", parts, STAMP_NS), DIAGNOSTIC_ARRAY)
    assert [(s.name, int(s.level), s.message) for s in back.status] == [
        ("osape: service", 2, "blind: front: unplugged"),
        ("osape: front", 2, "unplugged"),
        ("osape: rear", 0, "current"),
    ]
    assert {v.key: v.value for v in back.status[1].values} == {"code": "camera", "age_s": "1.50"}


def test_a_silent_service_is_stale(ros: RosMessages) -> None:
    assert service_part(pb.Health(state=pb.Health.STATE_ACTIVE), "nothing received").level == "STALE"
    assert service_part(None, "").level == "STALE"


def test_the_points_of_a_plane_are_as_dense_as_requested() -> None:
    points = surface_points(np.array([WALL], np.float32), 0.2)
    assert {tuple(np.round(p, 5)) for p in points} >= {(4, -1, -0.6), (4, 1, -0.6), (4, -1, 0.8), (4, 1, 0.8)}
    y, z = np.unique(points[:, 1].round(6)), np.unique(points[:, 2].round(6))
    assert np.diff(y).max() <= 0.2 + 1e-6
    assert np.diff(z).max() <= 0.2 + 1e-6
    assert len(points) == len(y) * len(z)


def test_a_plane_smaller_than_the_spacing_keeps_its_corners() -> None:
    points = surface_points(np.array([[4.0, 0.0, 4.0, 0.05, 0.0, 0.05]], np.float32), 0.2)
    assert len(points) == 4


def test_a_huge_model_is_sampled_coarsely_and_completely() -> None:
    planes = np.tile(np.array([[0.0, 0.0, 500.0, 0.0, -500.0, 0.0]], np.float32), (3, 1))
    planes[:, [1, 3]] = np.arange(3)[:, None]
    points = surface_points(planes, 0.1)
    assert 100 < len(points) <= MAX_POINTS
    assert set(points[:, 1]) == {0.0, 1.0, 2.0}


def test_planes_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        surface_points(np.array([[np.nan, 0, 0, 0, 0, 1]], np.float32), 0.2)
