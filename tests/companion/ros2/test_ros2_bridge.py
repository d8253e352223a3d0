"""The bridge to ROS 2 with a real Zenoh router and a second session in place of a ROS node.

No ROS installation takes part: names, hashes and layouts are compared with the published ones in test_ros2_messages.py."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from companion.cli import main
from companion.ros2.bridge import BridgeOptions, Ros2Bridge
from companion.ros2.diagnostics import DIAGNOSTIC_ARRAY
from companion.ros2.drawing import MARKER_ARRAY, POINT_CLOUD, TRANSFORMS
from companion.ros2.message_types import RosMessages
from companion.ros2.session import RosNode
from companion.ros2.wire import gid
from companion.viewer.live_camera import Camera
from companion.viewer.subscriber import LiveSubscriber
from osape_client.clock import clock_ns
from tests.ports import free_port
from tests.waiting import until

from ..scripted_service import ScriptedService
from ..view_scenes import INFO

pytestmark = pytest.mark.process

zenoh = pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed (extra ros2)")
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed (extra ros2)")

MESSAGES = RosMessages()
STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


def session(**settings: Any) -> Any:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    for key, value in settings.items():
        config.insert_json5(key.replace("__", "/"), json.dumps(value))
    return zenoh.open(config)


def router(port: int) -> Any:
    return session(mode="router", listen__endpoints=[f"tcp/127.0.0.1:{port}"])


class Reader:
    """A subscriber to everything in domain 3, and to the graph."""

    def __init__(self, port: int) -> None:
        self._session = session(mode="client", connect__endpoints=[f"tcp/127.0.0.1:{port}"])
        self.samples: list[tuple[str, bytes, bytes]] = []
        self.graph: dict[str, bool] = {}
        self._data = self._session.declare_subscriber("3/**", self._take)
        self._tokens = self._session.liveliness().declare_subscriber("@ros2_lv/3/**", self._token, history=True)

    def _take(self, sample: Any) -> None:
        self.samples.append((str(sample.key_expr), sample.payload.to_bytes(), sample.attachment.to_bytes()))

    def _token(self, sample: Any) -> None:
        self.graph[str(sample.key_expr)] = sample.kind == zenoh.SampleKind.PUT

    def newest(self, topic: str, name: str) -> Any:
        """The newest message of a topic, decoded; None without."""
        kind = MESSAGES.topic_type(name)
        key = f"3{topic}/{kind.dds_name}/{kind.type_hash}"
        found = [data for k, data, _ in list(self.samples) if k == key]
        return STORE.deserialize_cdr(found[-1], name) if found else None

    def close(self) -> None:
        self._session.close()


class Setup:
    """A router, a reader, and the bridge to a simulated service."""

    def __init__(self, scripted: ScriptedService) -> None:
        self.port = free_port()
        self.router = router(self.port)
        self.reader = Reader(self.port)
        self.scripted = scripted
        self.node = RosNode(MESSAGES, f"tcp/127.0.0.1:{self.port}", 3, "/osape", "companion")
        self.subscriber = LiveSubscriber(replace(scripted.streams, depth=""))
        self.bridge = Ros2Bridge(self.subscriber, self.node, MESSAGES, BridgeOptions())
        self.subscriber.on_message = self.bridge.on_message
        assert self.node.connect() == ""
        self.subscriber.open()

    def until_received(self, topic: str, name: str) -> Any:
        """Publishes frames until the reader has a message of the topic."""

        def received() -> bool:
            self.scripted.health()
            self.scripted.frame()
            self.bridge.tick(clock_ns())
            return self.reader.newest(topic, name) is not None

        assert until(received)
        return self.reader.newest(topic, name)

    def close(self) -> None:
        self.subscriber.on_message = None
        self.node.close()
        self.subscriber.close()
        self.reader.close()
        self.router.close()


@pytest.fixture
def setup(scripted: ScriptedService) -> Iterator[Setup]:
    setup = Setup(scripted)
    yield setup
    setup.close()


def test_a_ros_node_receives_planes_points_and_transforms(setup: Setup) -> None:
    markers = setup.until_received("/osape/markers", MARKER_ARRAY)
    assert {m.ns for m in markers.markers} >= {"front/prisms", "front/planes"}
    cloud = setup.until_received("/osape/front/points", POINT_CLOUD)
    assert cloud.width > 4
    age_ns = time.time_ns() - (cloud.header.stamp.sec * 1_000_000_000 + cloud.header.stamp.nanosec)
    assert 60_000_000 <= age_ns < 60_000_000_000  # that of the exposure, which was 0.06 s old when it was published
    setup.until_received("/tf", TRANSFORMS)
    tf = MESSAGES.topic_type(TRANSFORMS)

    def children() -> set[str]:
        messages = [
            STORE.deserialize_cdr(data, tf.name) for key, data, _ in setup.reader.samples if key.startswith("3/tf/")
        ]
        return {t.child_frame_id for message in messages for t in message.transforms}

    def both() -> bool:
        setup.scripted.health()
        setup.scripted.frame()
        return children() == {"base_link", "front_optical_frame"}

    assert until(both)
    diagnostics = setup.until_received("/diagnostics", DIAGNOSTIC_ARRAY)
    assert diagnostics.status[0].name == "osape: service"


def test_messages_carry_what_rmw_zenoh_requires(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)
    attachments = [a for key, _, a in setup.reader.samples if key.startswith("3/osape/front/points/")]
    setup.until_received("/osape/front/points", POINT_CLOUD)
    number, stamp_ns = struct.unpack_from("<qq", attachments[0])
    assert [len(a) for a in attachments] == [33] * len(attachments)
    assert (number, attachments[0][16]) == (1, 16)
    assert abs(stamp_ns - time.time_ns()) < 60e9
    zid = str(setup.node._session.zid())
    kind = MESSAGES.topic_type(POINT_CLOUD)
    tokens = [t for t in setup.reader.graph if "%front%points" in t]
    assert len(tokens) == 1
    assert tokens[0].startswith(f"@ros2_lv/3/{zid}/0/")
    assert tokens[0].endswith(
        f"/MP/%/%osape/companion/%osape%front%points/{kind.dds_name}/{kind.type_hash}/::,10:,:,:,,"
    )
    assert attachments[0][17:] == gid(tokens[0])
    assert f"@ros2_lv/3/{zid}/0/0/NN/%/%osape/companion" in setup.reader.graph


def test_a_closed_bridge_leaves_the_graph(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)
    setup.node.close()
    assert until(lambda: not any(setup.reader.graph.values()))


class Recorder:
    """In place of the node: what is published."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []

    def publish(self, topic: str, name: str, message: Any) -> bool:
        self.published.append((topic, message))
        return True


def test_transforms_go_on_after_the_clock_of_the_service_began_again(scripted: ScriptedService) -> None:
    """A computer that was started again counts its monotonic clock from 0."""
    node = Recorder()
    subscriber = LiveSubscriber(replace(scripted.streams, depth=""))
    bridge = Ros2Bridge(subscriber, node, MESSAGES, BridgeOptions(hz=1e9))  # type: ignore[arg-type]
    subscriber.cameras["front"] = Camera()
    seconds = [1000.0, 1000.1, 1000.1, 5.0, 5.1, 5.05]  # the third is a repetition, the last came late
    counts = []
    for second in seconds:
        message = scripted.message()
        message.t_exposure_ns = round(second * 1e9)
        subscriber.cameras["front"].exposed_ns = clock_ns()
        bridge.on_message(message, INFO)
        counts.append(sum(topic == "/tf" for topic, _ in node.published))
    assert counts == [1, 2, 2, 3, 4, 4]
    subscriber.close()


def test_an_old_frame_is_not_published(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)

    def counted(frames: int) -> bool:
        setup.scripted.frame(age_ns=2_000_000_000)
        return setup.bridge.counts.stale >= frames

    assert until(lambda: counted(1))  # all frames published before have arrived
    before = setup.bridge.counts.published
    assert until(lambda: counted(4))
    assert setup.bridge.counts.published == before


def test_a_blind_camera_is_published_as_such(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)

    def reported() -> bool:
        setup.scripted.health()
        setup.scripted.blind("unplugged")
        setup.bridge.tick(clock_ns())
        newest = setup.reader.newest("/osape/markers", MARKER_ARRAY)
        return newest is not None and any(m.text == "front: NO DATA: unplugged" for m in newest.markers)

    assert until(reported)  # all frames published before have arrived
    clouds = setup.bridge.counts.published
    assert until(lambda: reported() and _level(setup, "osape: front") == 2)
    assert setup.bridge.counts.published == clouds


def _level(setup: Setup, name: str) -> int:
    """The newest level of a status, after a new report."""
    setup.bridge._reported_ns = 0
    setup.bridge.tick(clock_ns())
    newest = setup.reader.newest("/diagnostics", DIAGNOSTIC_ARRAY)
    return next((int(s.level) for s in newest.status if s.name == name), -1) if newest else -1


def test_a_service_that_has_ended_is_stale(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)

    def runs() -> bool:
        setup.scripted.health()
        return _level(setup, "osape: service") == 0

    assert until(runs)  # the reports from before the first message have arrived
    assert until(lambda: _level(setup, "osape: service") == 3)  # no message comes any more
    assert until(lambda: "companion status" in setup.bridge.tick(clock_ns()))


def test_a_message_with_impossible_planes_is_reported(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)

    def reported() -> bool:
        message = setup.scripted.message()
        message.planes.corners_m[0] = float("nan")
        setup.scripted.publish(message)
        return setup.bridge.counts.undecodable > 0

    assert until(reported)
    assert setup.subscriber.running


def test_a_valid_frame_without_its_model_is_reported(setup: Setup) -> None:
    setup.until_received("/osape/front/points", POINT_CLOUD)

    def reported() -> bool:
        message = setup.scripted.message()
        message.ClearField("stats")
        setup.scripted.publish(message)
        return setup.bridge.counts.undecodable > 0 or not setup.subscriber.running

    assert until(reported)
    assert setup.subscriber.running


def test_a_frame_without_its_publication_is_not_used(setup: Setup) -> None:
    """Its age is not known: content of before would count as present, for the page too."""
    setup.until_received("/osape/front/points", POINT_CLOUD)

    def refused() -> bool:
        message = setup.scripted.message(age_ns=60_000_000_000)
        message.camera = "left"
        message.ClearField("publication")
        setup.scripted.publish(message)
        return "cut short" in setup.subscriber.undecodable

    assert until(refused)
    assert "left" not in setup.subscriber.cameras


def test_without_a_router_it_is_named_and_a_later_one_is_found(setup: Setup) -> None:
    setup.router.close()
    assert until(lambda: "rmw_zenohd" in setup.node.connect())
    late = RosNode(MESSAGES, f"tcp/127.0.0.1:{setup.port}", 3, "/late", "companion")
    assert f"no Zenoh router at tcp/127.0.0.1:{setup.port}" in late.connect()
    assert not late.publish("/tf", TRANSFORMS, MESSAGES.make(TRANSFORMS, transforms=[]))
    setup.router = router(setup.port)
    assert until(lambda: late.connect() == "" and setup.node.connect() == "")
    late.close()
    second = Reader(setup.port)
    first, setup.reader = setup.reader, second
    setup.until_received("/osape/front/points", POINT_CLOUD)
    first.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--namespace", "a b"], "namespace 'a b'"),
        (["--router", "localhost:7447"], "--router localhost:7447: expected PROTOCOL/ADDRESS"),
        (["--hz", "0"], "expected 0.1..60"),
        (["--spacing", "nan"], "expected 0.02..5"),
        (["--domain", "300"], "expected 0..232"),
    ],
)
def test_wrong_options_are_named(options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ros2", *options]) == 2
    assert message in capsys.readouterr().err


def test_the_domain_is_that_of_the_environment(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "x")
    assert main(["ros2"]) == 2
    assert "ROS_DOMAIN_ID=x" in capsys.readouterr().err
