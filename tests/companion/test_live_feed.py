"""The responses to the page of `companion view --live`, over real sockets and HTTP; the browser is tested in another
file."""

from __future__ import annotations

import http.client
import json
import time
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import zmq
from google.protobuf.message import Message

from companion.cli import main
from companion.live.depth_preview import DepthPreviews
from companion.pipeline.encode import blind_message, prisms_message
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import AttitudeAt, DropCause, Source
from companion.pipeline.transform import LevelTransform, transform_model
from companion.streams.publisher import Publisher, Stream
from companion.viewer.live_page import LivePage
from companion.viewer.live_server import LiveServer
from companion.viewer.subscriber import LiveSubscriber, Streams
from core.frames import level_from_level_cam, quaternion_from_euler, rotation_from_quaternion
from core.types import CameraInfo, DepthFrame
from drivers.base import DeviceNotFound
from drivers.logs.codec import camera_message
from osape_client.boot import boot_id
from osape_client.proto import osape_v1_pb2 as pb

from .live import until
from .view_scenes import INFO, model

pytestmark = pytest.mark.process

WALL = [4.0, -1.0, 4.0, 1.0, -0.6, 0.8]
YAW_RAD = 0.7


class Told:
    """A service that publishes given messages."""

    def __init__(self, folder: Path) -> None:
        self.streams = Streams(
            prisms=f"ipc://{folder}/prisms", health=f"ipc://{folder}/health", depth=f"ipc://{folder}/depth"
        )
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._prisms, self._health = (
            Publisher(Stream(name, getattr(self.streams, name)), self._context) for name in ("prisms", "health")
        )
        self.previews = DepthPreviews(15.0, boot_id())
        self.previews.open(self.streams.depth, self._context)
        self.sequence = 0

    def health(self) -> None:
        report = pb.Health(schema_version=1, state=pb.Health.STATE_ACTIVE, number=self.sequence)
        report.cameras.add(camera="front", condition="running", required=True, hz=30.0, info=camera_message(INFO))
        self.publish_health(report)

    def publish_health(self, report: pb.Health) -> None:
        self._health.publish(report)

    def message(self, age_ns: int = 60_000_000) -> pb.PrismsFrame:
        """A wall 4 m ahead, seen with the nose to 0.7 rad."""
        self.sequence += 1
        t_ns = time.monotonic_ns() - age_ns
        q = quaternion_from_euler(0.0, 0.0, YAW_RAD)
        yaw, at = level_from_level_cam(rotation_from_quaternion(q), INFO.mount)
        step = LevelTransform(yaw, (float(at[0]), float(at[1]), float(at[2])))
        result = PrismsResult(
            camera="front", sequence=self.sequence, t_exposure_ns=t_ns, t_arrival_ns=t_ns, frame="level",
            model=transform_model(model([WALL]), step), attitude=AttitudeAt(q, Source.EXACT, 0), transform=step, drop=DropCause.NONE,
        )  # fmt: skip
        message = prisms_message(result)
        message.publication.boot_id, message.publication.age_ns = boot_id(), age_ns
        return message

    def publish(self, message: pb.PrismsFrame) -> None:
        self._prisms.publish(message)

    def frame(self, depth: bool = False, age_ns: int = 60_000_000) -> None:
        """Says what it sees; depth: its image too, where somebody wants it."""
        message = self.message(age_ns)
        self.publish(message)
        t_ns = message.t_exposure_ns
        if depth:
            depth_mm = np.full((240, 320), 4000, np.uint16)
            self.previews.show(
                DepthFrame(
                    camera="front", sequence=self.sequence, t_exposure_ns=t_ns, t_arrival_ns=t_ns, depth_mm=depth_mm
                )
            )

    def blind(self, cause: str, camera: str = "front") -> None:
        self._prisms.publish(blind_message(camera, self.sequence, time.monotonic_ns(), cause))

    def nonsense(self) -> None:
        self._prisms.publish(b"\xff\xff\xff\xff")

    def close(self) -> None:
        self.previews.close()
        self._prisms.close()
        self._health.close()
        self._context.destroy(linger=0)


@pytest.fixture
def told(tmp_path: Path) -> Iterator[Told]:
    told = Told(tmp_path)
    yield told
    told.close()


@pytest.fixture
def page(told: Told) -> Iterator[LivePage]:
    subscriber = LiveSubscriber(told.streams)
    subscriber.open()
    yield LivePage(subscriber, "test")
    subscriber.close()


def news(page: LivePage, name: str = "", after: int = 0) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(page.answer(name, after))
    return answer


def shown(told: Told, page: LivePage, depth: bool = False) -> dict[str, Any]:
    """Speaks until a frame arrives (joining takes a moment); the answer that holds it."""
    got: list[dict[str, Any]] = []

    def look() -> bool:
        told.health()
        told.frame(depth)
        answer = news(page)
        if answer["frames"] and bool(answer["frames"][0]["depth"]) is depth and not answer["cameras"][0]["blind"]:
            got.append(answer)
        return bool(got)

    assert until(look)
    return got[0]


def quiet(told: Told, page: LivePage, answer: dict[str, Any]) -> dict[str, Any]:
    """An answer after all that was said has been shown; nobody speaks any more."""

    def settled() -> bool:
        with page.subscriber.changed:
            camera = page.subscriber.cameras["front"]
            s, m = camera.shown, camera.newest
            return s is not None and m is not None and (s.message.sequence == told.sequence or not m.valid)

    assert until(settled)
    return news(page, answer["name"], page.subscriber.number)


def test_without_a_service_it_is_said_what_is_missing(tmp_path: Path) -> None:
    streams = Streams(prisms=f"ipc://{tmp_path}/prisms", health=f"ipc://{tmp_path}/health", depth="")
    subscriber = LiveSubscriber(streams)
    subscriber.open()
    answer = news(LivePage(subscriber, ""))
    subscriber.close()
    assert not answer["cameras"]
    assert not answer["frames"]
    assert answer["service"]["missing"] == [
        f"no health report on {streams.health}: check that the service runs",
        "no depth images: [publish] depth is empty",
    ]


def test_a_frame_is_drawn_where_it_stands_and_its_age_is_reported(told: Told, page: LivePage) -> None:
    answer = shown(told, page)
    (frame,), (camera,) = answer["frames"], answer["cameras"]
    assert frame["standing"] == "VALID"
    assert np.allclose(np.array(frame["planes"]) / 100.0, WALL, atol=0.011)
    assert frame["heading"] == pytest.approx(YAW_RAD, abs=1e-4)
    assert (camera["blind"], camera["code"]) == ("", "")
    assert camera["info"]["name"] == "front"
    assert 0.06 <= camera["age_s"] <= camera["shown_s"] + 1e-6
    assert answer["service"]["state"] == "active"
    assert "camera front: running, 30.0 Hz" in "\n".join(answer["service"]["lines"])


def test_depth_is_paired_with_its_own_frame(told: Told, page: LivePage) -> None:
    frame = shown(told, page, depth=True)["frames"][0]
    png = cv2.imdecode(np.frombuffer(b64decode(frame["depth"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png.shape == (240, 320)
    assert 1 <= int(png[0, 0]) <= 254
    assert np.all(png == png[0, 0])
    told.frame()  # newer, without an image
    assert until(lambda: page.subscriber.cameras["front"].newest.sequence == told.sequence)
    paired = news(page)["frames"][0]
    assert paired["sequence"] < told.sequence
    assert paired["depth"]


def test_depth_is_asked_for_only_while_a_page_asks(told: Told, page: LivePage) -> None:
    shown(told, page, depth=True)
    page.subscriber.watch(0.0)

    def quiet() -> bool:
        before = told.previews.sent
        time.sleep(0.08)  # longer than from one image to the next
        told.frame(depth=True)
        return told.previews.sent == before

    assert until(quiet)


def test_a_blind_camera_is_shown_at_once_and_only_once(told: Told, page: LivePage) -> None:
    before = shown(told, page)
    told.blind("lost: its process has ended")
    began_s = time.monotonic()
    answer = news(page, before["name"], before["number"])
    while not answer["frames"] or answer["frames"][0]["standing"] != "BLIND":
        assert time.monotonic() - began_s < 2.0
        answer = news(page, answer["name"], answer["number"])
    (frame,) = answer["frames"]
    assert "lost: its process has ended" in frame["cause"]
    assert frame["planes"] == []
    assert frame["depth"] is None
    assert answer["cameras"][0]["blind"] == "lost: its process has ended"
    assert answer["cameras"][0]["code"] == "camera"
    told.blind("lost: its process has ended")
    assert quiet(told, page, answer)["number"] == answer["number"]


def test_silence_of_all_is_the_service_s_and_no_camera_is_clear(told: Told, page: LivePage) -> None:
    shown(told, page)
    assert until(lambda: news(page)["cameras"][0]["blind"], 5.0)
    words = "no message from the service for "
    assert until(lambda: news(page)["cameras"][0]["blind"].startswith(words), 5.0)
    assert news(page)["cameras"][0]["code"] == "no_current_message"


def test_of_two_cameras_each_is_reported_for_itself(told: Told, page: LivePage) -> None:
    def both() -> bool:
        report = pb.Health(schema_version=1, state=pb.Health.STATE_BLIND)
        for camera in ("front", "rear"):
            info = camera_message(replace(INFO, camera=camera))
            report.cameras.add(camera=camera, condition="running", required=True, info=info)
        told.publish_health(report)
        told.frame()
        told.blind("silent: no notification of its process", "rear")
        now = news(page)
        return len(now["frames"]) == 2 and sum(not camera["blind"] for camera in now["cameras"]) == 1

    assert until(both)
    answer = news(page)
    words = {camera["name"]: camera["blind"] for camera in answer["cameras"]}
    assert words == {"front": "", "rear": "silent: no notification of its process"}
    names = list(words)
    status = {names[frame["c"]]: frame["standing"] for frame in answer["frames"]}
    assert status == {"front": "VALID", "rear": "BLIND"}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_feed_that_has_ended_is_no_clear_view(told: Told, page: LivePage) -> None:
    shown(told, page)

    def broken(message: Message, info: CameraInfo | None) -> None:
        raise RuntimeError("a defect")

    page.subscriber.on_message = broken
    told.frame()
    assert until(lambda: not page.subscriber.running)
    assert until(lambda: news(page)["cameras"][0]["blind"] == "companion view does not receive any more: restart it")


def test_an_old_exposure_is_blind_however_fresh_the_message(told: Told, page: LivePage) -> None:
    shown(told, page)

    def old() -> bool:
        told.health()
        told.frame(age_ns=900_000_000)
        return "the newest frame is 0.9 s old" in news(page)["cameras"][0]["blind"]

    assert until(old)


def test_numbers_that_do_not_fit_are_blind(told: Told, page: LivePage) -> None:
    shown(told, page)
    broken = told.message()
    broken.planes.corners_m.append(1.0)

    def told_blind() -> bool:
        told.publish(broken)
        answer = news(page)
        return bool(answer["frames"]) and "is inconsistent" in answer["frames"][0]["cause"]

    assert until(told_blind)
    answer = news(page)
    assert answer["frames"][0]["standing"] == "BLIND"
    assert answer["frames"][0]["planes"] == []
    assert answer["cameras"][0]["blind"]


def test_foreign_bytes_are_named_and_have_no_effect(told: Told, page: LivePage) -> None:
    shown(told, page)
    told.nonsense()
    assert until(lambda: any("cannot be decoded as PrismsFrame" in line for line in news(page)["service"]["missing"]))
    assert shown(told, page)["frames"]


def test_a_page_of_another_server_gets_all_again(told: Told, page: LivePage) -> None:
    answer = quiet(told, page, shown(told, page))
    assert news(page, "another", answer["number"])["frames"]
    assert news(page, answer["name"], answer["number"])["frames"] == []


@pytest.fixture
def server(page: LivePage) -> Iterator[LiveServer]:
    server = LiveServer(page, "127.0.0.1", 0)
    server.open()
    yield server
    server.close()


def get(server: LiveServer, path: str, host: str | None = None) -> tuple[int, str, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
    try:
        connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{server.port}"})
        reply = connection.getresponse()
        return reply.status, reply.getheader("Content-Type", ""), reply.read()
    finally:
        connection.close()


def test_http_gives_page_and_news_and_nothing_else(server: LiveServer) -> None:
    status, kind, page = get(server, "/")
    assert (status, kind) == (200, "text/html; charset=utf-8")
    assert b"connect-src 'self'" in page
    status, kind, body = get(server, "/news?name=&after=0")
    assert (status, kind) == (200, "application/json")
    assert json.loads(body)["frames"] == []
    assert get(server, "/../etc/passwd")[0] == 404
    for after in ("x", "-1", "9" * 40, "٣"):
        assert get(server, "/news?after=" + "".join(f"%{b:02x}" for b in after.encode()))[0] == 400
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
    connection.request("POST", "/news", body=b"x")
    assert connection.getresponse().status == 501
    connection.close()


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8760", "127.0.0.1.evil.example:8760"])
def test_a_foreign_name_that_leads_here_is_refused(server: LiveServer, host: str) -> None:
    assert get(server, "/news?after=0", host)[0] == 403


def test_a_port_that_is_taken_is_named(page: LivePage, server: LiveServer) -> None:
    with pytest.raises(DeviceNotFound, match=f"port {server.port} on 127.0.0.1 .*--port"):
        LiveServer(page, "127.0.0.1", server.port).open()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--live", "flight.mcap"], "leave FILE.mcap"),
        (["--live", "-o", "x"], "leave FILE.mcap"),
        ([], "or --live"),
        (["--live", "--port", "70000"], "expected 0..65535"),
        (["--live", "--foxglove", "-1"], "expected 0..65535"),
    ],
)
def test_wrong_use_is_reported(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", *words]) == 2
    assert told in capsys.readouterr().err
