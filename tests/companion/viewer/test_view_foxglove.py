"""The WebSocket server for Foxglove, tested with a client of its protocol."""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from companion.viewer.foxglove_server import FoxgloveServer
from companion.viewer.subscriber import LiveSubscriber
from drivers.base import DeviceNotFound
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import until

from ..scripted_service import ScriptedService

pytestmark = pytest.mark.process

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed (extra foxglove)")


class Viewer:
    """A WebSocket client of Foxglove's protocol: heard has topic -> payloads."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=60.0)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            (
                f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
            ).encode()
        )
        self._rest = b""
        while b"\r\n\r\n" not in self._rest:
            self._more()
        head, self._rest = self._rest.split(b"\r\n\r\n", 1)
        assert b" 101 " in head.split(b"\r\n")[0]
        self._topics: dict[int, str] = {}
        self._subscribed_s = 0.0
        self.schemas: dict[str, str] = {}
        self.received: dict[str, list[bytes]] = {}

    def close(self) -> None:
        self._socket.close()

    def listen(self) -> None:
        """Takes what is there, and subscribes to each new topic; again to those without a message after a second, since the
        library advertises a channel a moment before it accepts subscriptions to it."""
        if time.monotonic() - self._subscribed_s > 1.0:
            self._subscribe([n for n, topic in self._topics.items() if topic not in self.received])
        while (frame := self._frame()) is not None:
            kind, body = frame
            if kind == 1:
                self._words(json.loads(body))
            elif kind == 2 and body[0] == 1:
                number, _ = struct.unpack_from("<IQ", body, 1)
                self.received.setdefault(self._topics[number], []).append(body[13:])

    def newest(self, topic: str, kind: type[Any]) -> Any:
        """Its newest message, None without."""
        message = self.received.get(topic)
        return kind.FromString(message[-1]) if message else None

    def _words(self, scripted: dict[str, Any]) -> None:
        if scripted["op"] != "advertise":
            return
        for channel in scripted["channels"]:
            self._topics[channel["id"]] = channel["topic"]
            self.schemas[channel["topic"]] = channel["schemaName"]
        self._subscribe([c["id"] for c in scripted["channels"]])

    def _subscribe(self, channels: list[int]) -> None:
        if not channels:
            return
        self._subscribed_s = time.monotonic()
        wanted = [{"id": n, "channelId": n} for n in channels]
        text = json.dumps({"op": "subscribe", "subscriptions": wanted}).encode()
        size = bytes([0x80 | len(text)]) if len(text) < 126 else b"\xfe" + struct.pack(">H", len(text))
        self._socket.sendall(b"\x81" + size + b"\0\0\0\0" + text)

    def _frame(self) -> tuple[int, bytes] | None:
        """(opcode, body) of one frame; None: nothing comes."""
        self._socket.settimeout(0.02)
        try:
            while True:
                if len(self._rest) >= 2:
                    size, at = self._rest[1] & 0x7F, 2
                    if size == 126 and len(self._rest) >= 4:
                        size, at = struct.unpack_from(">H", self._rest, 2)[0], 4
                    elif size == 127 and len(self._rest) >= 10:
                        size, at = struct.unpack_from(">Q", self._rest, 2)[0], 10
                    if (size < 126 or at > 2) and len(self._rest) >= at + size:
                        kind, body = self._rest[0] & 0x0F, self._rest[at : at + size]
                        self._rest = self._rest[at + size :]
                        return kind, body
                self._more()
        except TimeoutError:
            return None

    def _more(self) -> None:
        data = self._socket.recv(1 << 16)
        assert data, "the server has closed the connection"
        self._rest += data


@pytest.fixture
def server(scripted: ScriptedService) -> Iterator[FoxgloveServer]:
    subscriber = LiveSubscriber(scripted.streams)
    subscriber.open()
    server = FoxgloveServer(subscriber, "127.0.0.1", 0)
    server.open()
    yield server
    server.close()
    subscriber.close()


def test_a_viewer_receives_the_content_of_a_log_and_blindness(
    scripted: ScriptedService, server: FoxgloveServer
) -> None:
    viewer = Viewer(server.port)
    wanted = {
        "/health": pb.Health,
        "/camera/front/prisms": pb.PrismsFrame,
        "/camera/front/scene": SceneUpdate,
        "/tf": FrameTransform,
        "/camera/front/depth": RawImage,
        "/status": Log,
    }

    def all_received() -> bool:
        scripted.health()
        scripted.frame(depth=True)
        server.tick()
        viewer.listen()
        message = viewer.newest("/status", Log)
        return all(viewer.newest(t, k) is not None for t, k in wanted.items()) and message.message == "front: not blind"

    assert until(all_received)
    assert viewer.schemas == {topic: kind.DESCRIPTOR.full_name for topic, kind in wanted.items()}
    scene = viewer.newest("/camera/front/scene", SceneUpdate)
    assert len(scene.entities[0].triangles[0].points) == 4
    assert len(scene.entities[0].triangles[0].indices) == 6
    assert scene.entities[0].lifetime.seconds == 1
    depth = viewer.newest("/camera/front/depth", RawImage)
    assert (depth.width, depth.height, depth.encoding) == (320, 240, "16UC1")
    assert depth.data[:2] == (4000).to_bytes(2, "little")

    def blind() -> bool:
        scripted.blind("lost: its process has ended")
        server.tick()
        viewer.listen()
        message = viewer.newest("/status", Log)
        return bool(message.level == Log.FATAL and "front is BLIND: lost: its process has ended" in message.message)

    assert until(blind)

    def inconsistent() -> bool:
        broken = scripted.message()
        broken.planes.corners_m.append(1.0)
        scripted.publish(broken)
        server.tick()
        viewer.listen()
        return "front is BLIND: its message is inconsistent" in viewer.newest("/status", Log).message

    assert until(inconsistent)
    assert until(lambda: (viewer.listen(), viewer.newest("/camera/front/scene", SceneUpdate).deletions)[1])

    def silent() -> bool:
        server.tick()
        viewer.listen()
        return "no message from the service" in viewer.newest("/status", Log).message

    assert until(silent)
    viewer.close()


def test_a_slow_viewer_receives_the_newest_images(scripted: ScriptedService, server: FoxgloveServer) -> None:
    """It must not see what was a minute ago, and the images must not fill the memory of this process."""
    viewer, topic, sent = Viewer(server.port), "/camera/front/depth", 300
    image = np.full((480, 640), 4000, "<u2").tobytes()

    def show(number: int) -> None:
        t_ns = number * 1_000_000_000
        preview = pb.DepthPreview(camera="front", t_exposure_ns=t_ns, width_px=640, height_px=480, depth_mm=image)
        server.on_message(preview, None)

    def subscribed() -> bool:
        show(0)
        viewer.listen()
        return topic in viewer.received

    assert until(subscribed)
    viewer.received.clear()
    for number in range(1, sent + 1):  # meanwhile it reads nothing
        show(number)

    def newest() -> int:
        viewer.listen()
        return int(viewer.newest(topic, RawImage).timestamp.seconds) if topic in viewer.received else 0

    assert until(lambda: newest() == sent)
    assert (
        len(viewer.received[topic]) < sent // 2
    )  # those that were waiting, and a few in the buffers of the connection
    viewer.close()


def test_a_port_that_is_taken_is_named(scripted: ScriptedService, server: FoxgloveServer) -> None:
    with pytest.raises(DeviceNotFound, match=f"port {server.port} on 127.0.0.1 cannot be bound"):
        FoxgloveServer(LiveSubscriber(scripted.streams), "127.0.0.1", server.port).open()


def test_without_the_extra_the_remedy_is_reported(scripted: ScriptedService, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(DeviceNotFound, match=r"pip install 'foxglove-sdk>="):
        FoxgloveServer(LiveSubscriber(scripted.streams), "127.0.0.1", 0).open()
