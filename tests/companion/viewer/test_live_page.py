"""The responses to the page of `companion view --live`, over real sockets and HTTP; the browser is tested in another
file."""

from __future__ import annotations

import json
import time
from base64 import b64decode
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest
from google.protobuf.message import Message

from companion.viewer.live_camera import NS, Camera
from companion.viewer.live_page import LivePage
from companion.viewer.subscriber import LiveSubscriber, Streams
from core.types import CameraInfo
from drivers.logs.codec import camera_message
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.sources import Sources
from tests.waiting import PATIENCE_S, until

from ..scripted_service import WALL, YAW_RAD, ScriptedService
from ..view_scenes import INFO

pytestmark = pytest.mark.process


def update(page: LivePage, name: str = "", after: int = 0) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(page.answer(name, after))
    return answer


def shown(scripted: ScriptedService, page: LivePage, depth: bool = False) -> dict[str, Any]:
    """Speaks until a frame arrives (joining takes a moment); the answer that holds it."""
    got: list[dict[str, Any]] = []

    def look() -> bool:
        scripted.health()
        scripted.frame(depth)
        answer = update(page)
        if answer["frames"] and bool(answer["frames"][0]["depth"]) is depth and not answer["cameras"][0]["blind"]:
            got.append(answer)
        return bool(got)

    assert until(look)
    return got[0]


def quiet(scripted: ScriptedService, page: LivePage, answer: dict[str, Any]) -> dict[str, Any]:
    """An answer after all that was said has been shown; nobody speaks any more."""

    def settled() -> bool:
        with page.subscriber.changed:
            camera = page.subscriber.cameras["front"]
            s, m = camera.shown, camera.newest
            return s is not None and m is not None and (s.message.sequence == scripted.sequence or not m.valid)

    assert until(settled)
    return update(page, answer["name"], page.subscriber.number)


def test_without_a_service_the_missing_part_is_reported(tmp_path: Path) -> None:
    streams = Streams(prisms=f"ipc://{tmp_path}/prisms", health=f"ipc://{tmp_path}/health", depth="")
    subscriber = LiveSubscriber(streams)
    subscriber.open()
    answer = update(LivePage(subscriber, ""))
    subscriber.close()
    assert not answer["cameras"]
    assert not answer["frames"]
    assert answer["service"]["missing"] == [
        f"no health report on {streams.health}: check that the service runs",
        "no depth images: [publish] depth is empty",
    ]


def test_a_frame_is_drawn_where_it_stands_and_its_age_is_reported(scripted: ScriptedService, page: LivePage) -> None:
    answer = shown(scripted, page)
    (frame,), (camera,) = answer["frames"], answer["cameras"]
    assert frame["status"] == "VALID"
    assert np.allclose(np.array(frame["planes"]) / 100.0, WALL, atol=0.011)
    assert frame["heading"] == pytest.approx(YAW_RAD, abs=1e-4)
    assert (camera["blind"], camera["code"]) == ("", "")
    assert camera["info"]["name"] == "front"
    assert 0.06 <= camera["age_s"] <= camera["shown_s"] + 1e-6
    assert answer["service"]["state"] == "active"
    assert "camera front: running, 30.0 Hz" in "\n".join(answer["service"]["lines"])


@pytest.mark.parametrize("ahead_ns", [0, 10**15, -(10**15)])
def test_ages_of_the_autopilot_are_those_on_its_own_computer(
    scripted: ScriptedService, page: LivePage, ahead_ns: int
) -> None:
    """The monotonic clocks of two computers have nothing in common."""
    t_ns = 2 * 10**15 + ahead_ns
    report = pb.Health(schema_version=1, state=pb.Health.STATE_ACTIVE, t_ns=t_ns)
    report.autopilot.autopilot, report.autopilot.heartbeat_age_ns = "PX4", 2 * NS
    report.autopilot.obstacles_sent.cm.extend([500] * 72)
    report.autopilot.obstacles_sent.t_ns = t_ns - NS // 4

    def received() -> bool:
        scripted.publish_health(report)
        return page.subscriber.health is not None

    assert until(received)
    pilot = update(page)["service"]["autopilot"]
    assert 1.0 <= pilot["age_s"] < PATIENCE_S
    assert 0.25 <= pilot["sent"]["age_s"] < PATIENCE_S


class Waiting:
    """A socket with one report, which may have arrived a minute ago: this process was stopped since then."""

    def __init__(self) -> None:
        self._messages = [(pb.Health(schema_version=1).SerializeToString(), clock_ns() - 60 * NS)]

    def take(self) -> tuple[bytes, int] | None:
        return self._messages.pop() if self._messages else None


def test_a_report_that_waited_is_not_current(page: LivePage) -> None:
    subscriber = page.subscriber
    with subscriber.changed:
        subscriber._take(cast(Any, Waiting()), pb.Health, Sources(), clock_ns())
    service = update(page)["service"]
    assert service["age_s"] >= 60.0
    assert "no health report" in service["missing"][0]


def test_depth_is_paired_with_its_own_frame(scripted: ScriptedService, page: LivePage) -> None:
    frame = shown(scripted, page, depth=True)["frames"][0]
    png = cv2.imdecode(np.frombuffer(b64decode(frame["depth"]), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png.shape == (240, 320)
    assert 1 <= int(png[0, 0]) <= 254
    assert np.all(png == png[0, 0])
    scripted.frame()  # newer, without an image
    assert until(lambda: page.subscriber.cameras["front"].newest.sequence == scripted.sequence)
    paired = update(page)["frames"][0]
    assert paired["sequence"] < scripted.sequence
    assert paired["depth"]


def test_depth_is_subscribed_only_while_a_page_requests_it(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page, depth=True)
    page.subscriber.watch(0.0)

    def quiet() -> bool:
        before = scripted.previews.sent
        time.sleep(0.08)  # longer than from one image to the next
        scripted.frame(depth=True)
        return scripted.previews.sent == before

    assert until(quiet)


def test_a_blind_camera_is_shown_at_once_and_only_once(scripted: ScriptedService, page: LivePage) -> None:
    before = shown(scripted, page)
    scripted.blind("lost: its process has ended")
    answer = update(page, before["name"], before["number"])

    def blind() -> bool:
        nonlocal answer
        if not answer["frames"] or answer["frames"][0]["status"] != "BLIND":
            answer = update(page, answer["name"], answer["number"])
        return bool(answer["frames"]) and answer["frames"][0]["status"] == "BLIND"

    assert until(blind)
    (frame,) = answer["frames"]
    assert "lost: its process has ended" in frame["cause"]
    assert frame["planes"] == []
    assert frame["depth"] is None
    assert answer["cameras"][0]["blind"] == "lost: its process has ended"
    assert answer["cameras"][0]["code"] == "camera"
    scripted.blind("lost: its process has ended")
    assert quiet(scripted, page, answer)["number"] == answer["number"]


def test_silence_of_all_is_the_service_s_and_no_camera_is_clear(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page)
    assert until(lambda: update(page)["cameras"][0]["blind"])
    text = "no message from the service for "
    assert until(lambda: update(page)["cameras"][0]["blind"].startswith(text))
    assert update(page)["cameras"][0]["code"] == "no_current_message"


def test_of_two_cameras_each_is_reported_for_itself(scripted: ScriptedService, page: LivePage) -> None:
    def both() -> bool:
        report = pb.Health(schema_version=1, state=pb.Health.STATE_BLIND)
        for camera in ("front", "rear"):
            info = camera_message(replace(INFO, camera=camera))
            report.cameras.add(camera=camera, condition="running", required=True, info=info)
        scripted.publish_health(report)
        scripted.frame()
        scripted.blind("camera process silent", "rear")
        now = update(page)
        return len(now["frames"]) == 2 and sum(not camera["blind"] for camera in now["cameras"]) == 1

    assert until(both)
    answer = update(page)
    text = {camera["name"]: camera["blind"] for camera in answer["cameras"]}
    assert text == {"front": "", "rear": "camera process silent"}
    names = list(text)
    status = {names[frame["c"]]: frame["status"] for frame in answer["frames"]}
    assert status == {"front": "VALID", "rear": "BLIND"}


def test_a_camera_that_was_removed_stays_blind_with_the_remedy(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page)
    report = pb.Health(schema_version=1, state=pb.Health.STATE_ACTIVE)
    report.cameras.add(camera="rear", condition="running", required=True)

    def reported() -> bool:
        scripted.publish_health(report)
        camera = next(c for c in update(page)["cameras"] if c["name"] == "front")
        return "no such camera any more: restart this command" in camera["blind"]

    assert until(reported)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_feed_that_has_ended_is_no_clear_view(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page)

    def broken(message: Message, info: CameraInfo | None) -> None:
        raise RuntimeError("a defect")

    page.subscriber.on_message = broken
    scripted.frame()
    assert until(lambda: not page.subscriber.running)
    assert until(lambda: update(page)["cameras"][0]["blind"] == "companion view does not receive any more: restart it")


def test_an_old_exposure_is_blind_however_fresh_the_message(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page)

    def old() -> bool:
        scripted.health()
        scripted.frame(age_ns=900_000_000)
        return "the newest frame is 0.9 s old" in update(page)["cameras"][0]["blind"]

    assert until(old)


def test_numbers_that_do_not_fit_are_blind(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page)
    broken = scripted.message()
    broken.planes.corners_m.append(1.0)

    def reported_blind() -> bool:
        scripted.publish(broken)
        answer = update(page)
        return bool(answer["frames"]) and "is inconsistent" in answer["frames"][0]["cause"]

    assert until(reported_blind)
    answer = update(page)
    assert answer["frames"][0]["status"] == "BLIND"
    assert answer["frames"][0]["planes"] == []
    assert answer["cameras"][0]["blind"]


@pytest.mark.parametrize("part", ["stats", "attitude"])
def test_a_valid_frame_without_a_part_is_blind(scripted: ScriptedService, page: LivePage, part: str) -> None:
    """Without `stats` it has no model: an empty picture would be called valid."""
    shown(scripted, page)
    broken = scripted.message()
    broken.ClearField(part)

    def reported_blind() -> bool:
        scripted.publish(broken)
        answer = update(page)
        return bool(answer["frames"]) and f"a valid frame without {part}" in answer["frames"][0]["cause"]

    assert until(reported_blind)
    assert f"a valid frame without {part}" in update(page)["cameras"][0]["blind"]


def test_a_pose_that_is_not_finite_makes_one_camera_blind(scripted: ScriptedService, page: LivePage) -> None:
    """The answer contains all cameras."""
    shown(scripted, page)
    broken = scripted.message()
    broken.pose.position_ned_m.x = float("nan")

    def reported_blind() -> bool:
        scripted.publish(broken)
        answer = update(page)
        return bool(answer["frames"]) and "is inconsistent" in answer["frames"][0]["cause"]

    assert until(reported_blind)
    assert update(page)["cameras"][0]["blind"]


def test_tracks_of_long_ago_are_not_drawn() -> None:
    message = pb.PrismsFrame(sequence=9, t_exposure_ns=10**9)
    camera = Camera(tracks=OrderedDict({1: pb.Tracks(sequence=1, t_exposure_ns=10**9 - 400_000_000)}))
    assert camera.tracks_of(message) is camera.tracks[1]
    message.t_exposure_ns += 1
    assert camera.tracks_of(message) is None
    camera.tracks[9] = pb.Tracks(sequence=9, t_exposure_ns=5)
    assert camera.tracks_of(message) is None, "of an earlier run"
    assert Camera().tracks_of(message) is None


def test_foreign_bytes_are_named_and_have_no_effect(scripted: ScriptedService, page: LivePage) -> None:
    shown(scripted, page)
    scripted.nonsense()
    assert until(lambda: any("cannot be decoded as PrismsFrame" in line for line in update(page)["service"]["missing"]))
    assert shown(scripted, page)["frames"]


def test_a_page_of_another_server_gets_all_again(scripted: ScriptedService, page: LivePage) -> None:
    answer = quiet(scripted, page, shown(scripted, page))
    assert update(page, "another", answer["number"])["frames"]
    assert update(page, answer["name"], answer["number"])["frames"] == []
