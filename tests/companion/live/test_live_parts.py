"""The small parts of the live service: inbox, latencies, blindness, words to systemd."""

from __future__ import annotations

import dataclasses
import resource
import socket
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.message import Message

from companion.cameras.status import CameraCondition, CameraStatus
from companion.config.loader import Config
from companion.live.event_queue import WAKE_ITEMS, EventQueue
from companion.live.health import CameraView
from companion.live.process_usage import ProcessUsage
from companion.live.sd_notify import Notifier
from companion.live.staleness import StalenessMonitor
from companion.live.stream_output import StreamOutput
from companion.pipeline.events import RawMavlink, SupersededFrame
from companion.pipeline.latency import Latencies, LatencyStage
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import DropCause
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher
from core.params import Params
from core.stages.model import blind_model
from core.types import AttitudeSample, DepthFrame, InvalidCause
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import INFO, EasyExtractor, frame

MS = 1_000_000


def attitude(t_ns: int) -> AttitudeSample:
    return AttitudeSample(t_ns, t_ns, (1.0, 0.0, 0.0, 0.0))


def image(camera: str, sequence: int) -> DepthFrame:
    depth = np.full((16, 16), 1000, np.uint16)
    return DepthFrame(
        camera=camera, sequence=sequence, t_exposure_ns=sequence, t_arrival_ns=sequence + 1, depth_mm=depth
    )


# ---- inbox ------------------------------------------------------------------------------------------------------------


def test_the_order_of_arrival_is_kept_and_a_frame_ends_a_turn() -> None:
    event_queue = EventQueue()
    event_queue.put([attitude(1), RawMavlink(b"x", 2)])
    event_queue.put_frame(image("front", 3))
    event_queue.put([attitude(4)])
    first = event_queue.take(0.0)
    assert [type(i).__name__ for i in first] == ["AttitudeSample", "RawMavlink", "DepthFrame"]
    assert event_queue.take(0.0) == [attitude(4)]
    assert event_queue.take(0.0) == []


def test_a_superseded_frame_stays_in_its_place_as_a_notice() -> None:
    event_queue = EventQueue()
    event_queue.put_frame(image("front", 1))
    event_queue.put([attitude(2)])
    event_queue.put_frame(image("right", 3))
    event_queue.put_frame(image("front", 4))
    taken = event_queue.take(0.0)
    assert taken[0] == SupersededFrame("front", 1, 1, 2)
    assert frames_in(taken) == [("front", 4)], "after the attitude that arrived before it"
    assert taken[1] == attitude(2)
    assert frames_in(event_queue.take(0.0)) == [("right", 3)]


def frames_in(taken: Sequence[object]) -> list[tuple[str, int]]:
    return [(item.camera, item.sequence) for item in taken if isinstance(item, DepthFrame)]


def test_each_camera_has_its_turn_while_frames_take_longer_than_their_period() -> None:
    """Cameras that are exposed together: the newest frame of the last one always arrives last."""
    event_queue, cameras = EventQueue(), ["front", "right", "left"]
    served = []
    for k in range(12):
        for camera in cameras:
            event_queue.put_frame(image(camera, k))
        served += frames_in(event_queue.take(0.0))
    assert [camera for camera, _ in served] == 4 * cameras
    assert [k for _, k in served] == list(range(12)), "the newest frame each"


def test_a_frame_keeps_its_place_before_a_new_description_of_a_camera() -> None:
    event_queue = EventQueue()
    event_queue.put_frame(image("right", 1))
    event_queue.put_frame(image("front", 2))
    event_queue.put([dataclasses.replace(INFO, camera="front")])
    event_queue.put_frame(image("right", 3))
    assert frames_in(event_queue.take(0.0)) == [("front", 2)], "of the camera as it was described before"
    assert frames_in(event_queue.take(0.0)) == [("right", 3)]


def test_a_frame_and_several_samples_end_the_wait() -> None:
    """A single sample matters to the next frame only."""
    event_queue = EventQueue()
    with ThreadPoolExecutor(1) as pool:
        for wake, count in (
            (lambda: event_queue.put_frame(image("front", 2)), 2),
            (put_many(event_queue), 1 + WAKE_ITEMS),
        ):
            event_queue.put([attitude(1)])
            waiting = pool.submit(event_queue.take, 30.0)
            assert not wait([waiting], 0.05).done
            wake()
            assert len(waiting.result(60.0)) == count
    event_queue.put([attitude(1)])
    assert event_queue.take(0.01) == [attitude(1)]


def put_many(event_queue: EventQueue) -> Callable[[], None]:
    return lambda: event_queue.put([attitude(k) for k in range(WAKE_ITEMS)])


def test_the_inbox_is_bounded_and_counts_what_gave_way() -> None:
    event_queue = EventQueue(max_items=10)
    event_queue.put([attitude(k) for k in range(25)])
    assert event_queue.lost == 15
    assert event_queue.take(0.0) == [attitude(k) for k in range(15, 25)]


def test_the_inbox_is_bounded_without_an_autopilot() -> None:
    """As while kernels are compiled: all frames but the newest are superseded, and nothing is taken."""
    event_queue = EventQueue(max_items=10)
    for k in range(25):
        event_queue.put_frame(image("front", k))
    taken = event_queue.take(0.0)
    assert [type(i).__name__ for i in taken] == ["SupersededFrame"] * 9 + ["DepthFrame"]
    assert [i.sequence for i in taken if isinstance(i, SupersededFrame | DepthFrame)] == list(range(15, 25))
    assert event_queue.lost == 0, "no attitude or position"


def test_the_description_of_a_camera_is_never_dropped() -> None:
    """As at a first start, when kernels are compiled for a minute and nothing is taken from the queue."""
    event_queue = EventQueue(max_items=10)
    other = dataclasses.replace(INFO, camera="right")
    event_queue.put([attitude(0), INFO, attitude(1), other])
    for k in range(2, 40):
        event_queue.put([attitude(k)])
    taken = event_queue.take(0.0)
    assert taken[:2] == [INFO, other]
    assert taken[2:] == [attitude(k) for k in range(30, 40)]
    assert event_queue.lost == 30


# ---- latencies ----------------------------------------------------------------------------------------------------------


def test_percentiles_are_those_of_the_newest_frames() -> None:
    latencies = Latencies()
    assert latencies.percentiles() == []
    for k in range(10_000):
        latencies.add(LatencyStage.EXTRACT, (k % 100 + 1) * MS)
    ((stage, p50, p95, p99),) = latencies.percentiles()
    assert stage == LatencyStage.EXTRACT
    assert (p50, p95, p99) == (pytest.approx(50.0, abs=3), pytest.approx(95.0, abs=3), pytest.approx(99.0, abs=2))


# ---- blindness ------------------------------------------------------------------------------------------------------------


def result(t_ns: int, valid: bool = True, drop: DropCause = DropCause.NONE) -> PrismsResult:
    model = None
    if drop is DropCause.NONE:
        blind = blind_model(INFO, InvalidCause.NO_MEASUREMENT, Params())
        model = EasyExtractor(INFO).extract(frame(0, 10**9).depth_mm, INFO, np.eye(3))[0] if valid else blind
    return PrismsResult(
        camera="front", sequence=7, t_exposure_ns=t_ns, t_arrival_ns=t_ns, frame="level", drop=drop, model=model
    )


def status(condition: CameraCondition, cause: str) -> CameraStatus:
    return CameraStatus(camera="front", condition=condition, cause=cause, since_ns=0)


def test_a_camera_is_blind_until_a_valid_frame_came_and_again_when_it_is_old() -> None:
    staleness = StalenessMonitor(("front",), timeout_s=0.3)
    assert staleness.cause("front", 0) == "no frame yet"
    staleness.result(result(1000 * MS))
    assert staleness.cause("front", 1300 * MS) == ""
    assert staleness.age_ns("front", 1300 * MS) == 300 * MS
    assert staleness.cause("front", 1301 * MS) == "the newest valid exposure is 0.3 s old"
    assert staleness.sequence("front") == 7


@pytest.mark.parametrize("ahead_ms", [0, 40, 5000])
def test_an_exposure_in_the_future_does_not_keep_a_camera_from_being_blind(ahead_ms: int) -> None:
    seen = result(1000 * MS)
    staleness = StalenessMonitor(("front",), timeout_s=0.3)
    staleness.result(replace(seen, t_exposure_ns=seen.t_arrival_ns + ahead_ms * MS))
    assert staleness.cause("front", seen.t_arrival_ns + 300 * MS) == ""
    assert staleness.cause("front", seen.t_arrival_ns + 301 * MS)


@pytest.mark.parametrize(
    ("frame_result", "cause_text"),
    [
        (result(1000 * MS, valid=False), "too few pixels hold a measurement"),
        (result(1000 * MS, drop=DropCause.NO_ATTITUDE), "no attitude had arrived"),
    ],
)
def test_an_invalid_frame_blinds_at_once(frame_result: PrismsResult, cause_text: str) -> None:
    staleness = StalenessMonitor(("front",), timeout_s=0.3)
    staleness.result(result(990 * MS))
    staleness.result(frame_result)
    assert staleness.cause("front", 1000 * MS) == cause_text
    staleness.result(result(1030 * MS))
    assert staleness.cause("front", 1031 * MS) == ""


def test_the_fault_of_a_camera_is_reported_first_once_its_frames_are_old() -> None:
    staleness = StalenessMonitor(("front",), timeout_s=0.3)
    staleness.result(result(1000 * MS))
    ill = status(CameraCondition.SILENT, "no frame for 0.6 s")
    assert staleness.cause("front", 1100 * MS, ill) == ""
    assert staleness.cause("front", 1600 * MS, ill) == "no frame for 0.6 s"


def test_the_newest_frame_is_the_one_with_the_newest_exposure_valid_or_not() -> None:
    staleness = StalenessMonitor(("front",), timeout_s=0.3)
    assert staleness.newest_ns("front") is None
    staleness.result(result(1000 * MS))
    staleness.result(replace(result(6000 * MS, drop=DropCause.NO_ATTITUDE), sequence=9))
    staleness.result(replace(result(5000 * MS, drop=DropCause.LATE_FRAME), sequence=8))
    assert staleness.newest_ns("front") == 6000 * MS
    assert staleness.sequence("front") == 9
    assert staleness.age_ns("front", 6100 * MS) == 5100 * MS  # of the newest valid exposure
    staleness.result(replace(result(3000 * MS), sequence=10))  # the exposures began again
    assert (staleness.newest_ns("front"), staleness.sequence("front")) == (3000 * MS, 10)


def test_blind_frames_carry_the_exposure_of_the_newest_frame() -> None:
    staleness = StalenessMonitor(("front",), timeout_s=0.3)
    output = StreamOutput(Config(), PublicationStamps("boot"), staleness, threading.Lock())
    sent = _Publisher()
    output.publishers["prisms"] = sent
    view = CameraView(status=status(CameraCondition.RUNNING, ""), required=True, blind="blind", age_ns=None, hz=0.0)
    output.publish_blind(view, 500 * MS)
    staleness.result(result(1000 * MS))
    staleness.result(replace(result(6000 * MS, drop=DropCause.NO_ATTITUDE), sequence=9))
    output.publish_blind(replace(view, age_ns=5100 * MS), 6100 * MS)
    frames = [pb.PrismsFrame.FromString(data) for data in sent.sent]
    assert [(f.sequence, f.t_exposure_ns, f.valid) for f in frames] == [(0, 500 * MS, False), (9, 6000 * MS, False)]


class _Publisher(Publisher):
    """Collects the messages instead of sending them; it has no socket."""

    def __init__(self) -> None:
        self.published, self.sent = 0, list[bytes]()

    def publish(self, message: Message | bytes) -> None:
        assert isinstance(message, bytes)
        self.sent.append(message)


def test_a_report_is_made_where_no_file_can_be_opened() -> None:
    """The main loop, which publishes blind frames, must not end because a figure of the report cannot be read."""
    usage, report = ProcessUsage(), pb.Health()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
    try:
        usage.fill(report)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert report.uptime_ns > 0
    assert (report.memory_bytes, list(report.temperatures)) == (0, [])


# ---- systemd --------------------------------------------------------------------------------------------------------------


STOPPING = "STOPPING=1\nWATCHDOG_USEC=15000000"


def test_notifications_to_systemd(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(1.0)
        notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "2000000"})
        assert notifier.watchdog_s == 2.0
        notifier.ready()
        notifier.status("two\nlines", "", 0.0)
        notifier.status("two\nlines", "", 100.0)
        notifier.feed_watchdog()
        notifier.extend_timeout(1.5)
        notifier.stopping()
        received = [systemd.recv(100).decode() for _ in range(5)]
    assert received == ["READY=1", "STATUS=two lines", "WATCHDOG=1", "EXTEND_TIMEOUT_USEC=1500000", STOPPING]


def test_a_systemd_that_reads_nothing_does_not_stop_the_service(tmp_path: Path) -> None:
    """It reads nothing while it reloads its units or waits for a disk: READY and the newest status are sent later."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(1.0)
        notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "2000000"})
        texts = [f"text {i}" for i in range(3000)]  # more than any queue holds

        def report() -> None:
            for k, text in enumerate(texts):
                notifier.status(text, text, float(k))
            notifier.ready()
            notifier.stopping()

        reporting = threading.Thread(target=report, daemon=True)
        reporting.start()
        reporting.join(60.0)
        assert not reporting.is_alive()
        systemd.setblocking(False)
        received: list[str] = []
        with suppress(BlockingIOError):
            while True:
                received.append(systemd.recv(100).decode())
        assert received == [f"STATUS={text}" for text in texts[: len(received)]]
        notifier.status(texts[-1], texts[-1], 3000.0)
        notifier.feed_watchdog()
        assert [systemd.recv(100).decode() for _ in range(3)] == [f"STATUS={texts[-1]}", "READY=1", "WATCHDOG=1"]
        notifier.feed_watchdog()
        notifier.status(texts[-1], texts[-1], 4000.0)
        assert systemd.recv(100) == b"WATCHDOG=1"
        with pytest.raises(BlockingIOError):
            systemd.recv(100)


def test_without_systemd_nothing_is_reported(tmp_path: Path) -> None:
    for environment in ({}, {"NOTIFY_SOCKET": str(tmp_path / "gone"), "WATCHDOG_USEC": "5", "WATCHDOG_PID": "1"}):
        notifier = Notifier(environment)
        notifier.ready()
        assert notifier.watchdog_s is None
