"""A subscriber over real sockets: the newest message, its age, repeated messages, damaged messages, keys."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import zmq
from google.protobuf.message import Message

from companion.pipeline.encode import blind_message, prisms_message
from companion.pipeline.multi_camera import AllCamerasModelBuilder, all_cameras_message
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.streams.curve_auth import AllowList, load_keys, make_keys
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher, Stream
from core.frames import quaternion_from_euler
from osape_client import KeyFileError, LevelMemory, Occupancy, Subscriber
from osape_client.boot import boot_id
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.subscriber import Message as Received
from osape_client.world.mirror import WorldMirror
from tests.companion.pipeline.test_multi_camera import keeper, results, sees
from tests.companion.small_recordings import INFO, MS, START_NS, EasyExtractor, attitude, frame
from tests.ports import free_port
from tests.waiting import until

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[2]


def move_exposures(message: Message, t_ns: int) -> None:
    """Moves the exposures of a message so that the one its age refers to was at t_ns; of no exposure there is nothing to move."""
    if isinstance(message, pb.SurroundFrame):
        for part in message.cameras:
            part.t_exposure_ns += t_ns - message.t_ns
        message.t_ns = t_ns
    else:
        message.t_exposure_ns = t_ns


class Service:
    """A publisher as the service has it."""

    def __init__(self, address: str) -> None:
        self.context: zmq.Context = zmq.Context()
        self.address = address
        self.publisher = Publisher(Stream("prisms", address), self.context)

    def say(self, message: Message, age_ms: float = 20.0, boot: str = "boot", number: int | None = None) -> None:
        copy = type(message).FromString(message.SerializeToString())
        if boot != boot_id():  # a stamp of this computer is the caller's
            move_exposures(copy, time.monotonic_ns() - round(age_ms * MS))
        number = self.publisher.published if number is None else number
        copy.publication.CopyFrom(PublicationStamps(boot).stamp(number, round(age_ms * MS)))
        self.publisher.publish(copy)

    def close(self) -> None:
        self.publisher.close()
        self.context.term()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    service = Service(f"ipc://{tmp_path}/s")
    yield service
    service.close()


def a_frame() -> pb.PrismsFrame:
    pipeline = Pipeline((INFO,), EasyExtractor)
    for t in range(START_NS - 40 * MS, START_NS + 1, 20 * MS):
        pipeline.handle(attitude(t))
    result = pipeline.handle(frame(1, START_NS))[1]
    assert isinstance(result, PrismsResult)
    return prisms_message(result)


def joined(client: Subscriber, service: Service, message: Message | None = None) -> None:
    """A subscriber takes a moment to be known."""
    assert until(lambda: (service.say(message or a_frame()), client.wait(0.05))[1] is not None, 60.0)
    assert until(lambda: client.wait(0.05) is None, 60.0)


def test_a_frame_without_a_position_is_remembered_and_any_other_is_not() -> None:
    memory, message = LevelMemory(), a_frame()
    q = quaternion_from_euler(0.3, -0.2, 2.0)
    at = message.attitude.q_ned_frd
    at.w, at.x, at.y, at.z = q
    assert memory.add_message(message) == pytest.approx(2.0)
    kept = memory.snapshot(2.0, message.t_exposure_ns)
    assert len(kept.planes) == len(message.planes.margin_m) > 0
    spoilt = pb.PrismsFrame.FromString(message.SerializeToString())
    spoilt.t_exposure_ns += MS
    spoilt.planes.corners_m.append(1.0)
    assert memory.add_message(spoilt) is None
    for change in ({"frame": "ned"}, {"valid": False}):
        other = pb.PrismsFrame.FromString(message.SerializeToString())
        for name, value in change.items():
            setattr(other, name, value)
        assert memory.add_message(other) is None
    assert memory.add_message(blind_message("front", 1, START_NS, "unplugged")) is None
    assert memory.add_message(message) is None, "it does not come after the newest one"
    message.t_exposure_ns += MS
    for length in (0.0, 0.9, math.nan):
        at.w, at.x, at.y, at.z = length * np.array(q)
        assert memory.add_message(message) is None, "not an attitude"
    assert len(memory.snapshot(2.0, START_NS).planes) == len(kept.planes)


def test_the_vehicle_is_where_the_pose_of_the_newest_part_is() -> None:
    content = a_frame()
    assert Received(content, 0, 0.4).vehicle_m == (0.0, 0.0, 0.0)
    content.frame = "ned"
    assert Received(content, 0, 0.4).vehicle_m is None
    at = content.pose.position_ned_m
    at.x, at.y, at.z = 50.0, -3.0, -100.0
    assert Received(content, 0, 0.4).vehicle_m == (50.0, -3.0, -100.0)
    older = pb.PrismsFrame.FromString(content.SerializeToString())
    older.t_exposure_ns -= MS
    older.pose.position_ned_m.x = 49.0
    blind = blind_message("left", 1, content.t_exposure_ns + MS, "unplugged")
    together = pb.SurroundFrame(schema_version=1, frame="ned", valid=True, cameras=[older, content, blind])
    assert Received(together, 0, 0.4).vehicle_m == (50.0, -3.0, -100.0)
    assert Received(pb.SurroundFrame(frame="other", cameras=[content]), 0, 0.4).vehicle_m is None


def a_free_place(content: pb.PrismsFrame) -> list[list[float]]:
    """The middle of the longest free range of a frame."""
    free, camera = content.free, content.transform.translation_m
    layers = len(free.layer_edges_m) - 1
    cell = int(np.argmax(np.subtract(free.free_to_m, free.free_from_m)))
    azimuth_rad = np.mean(free.azimuth_edges_rad[cell // layers : cell // layers + 2])
    range_m = 0.5 * (free.free_from_m[cell] + free.free_to_m[cell])
    z_m = np.mean(free.layer_edges_m[cell % layers : cell % layers + 2])
    return [[camera.x + range_m * np.cos(azimuth_rad), camera.y + range_m * np.sin(azimuth_rad), float(z_m)]]


def test_in_a_message_cut_before_the_place_of_the_camera_nothing_is_free() -> None:
    content, now_ns = a_frame(), clock_ns()
    at = a_free_place(content)
    assert Received(content, now_ns, math.inf).space.points(at).tolist() == [Occupancy.FREE]
    content.ClearField("transform")
    assert Received(content, now_ns, math.inf).space.points(at).tolist() == [Occupancy.UNKNOWN]


@pytest.mark.parametrize("together", [False, True])
def test_nothing_in_a_stale_message_is_free_and_its_obstacles_stay(
    monkeypatch: pytest.MonkeyPatch, together: bool
) -> None:
    one = a_frame()
    content = pb.SurroundFrame(schema_version=1, frame=one.frame, valid=True, cameras=[one]) if together else one
    a_x, a_y, b_x, b_y, top, bottom = one.planes.corners_m[:6]
    at = [*a_free_place(one), [(a_x + b_x) / 2, (a_y + b_y) / 2, (top + bottom) / 2]]
    received = Received(content, clock_ns())
    for stale, first in ((False, Occupancy.FREE), (True, Occupancy.UNKNOWN), (False, Occupancy.FREE)):
        monkeypatch.setattr(Received, "stale", stale)
        assert received.space.points(at).tolist() == [first, Occupancy.OCCUPIED]


def test_of_several_cameras_nothing_is_free_by_an_exposure_that_is_too_old(monkeypatch: pytest.MonkeyPatch) -> None:
    """The age of the message is that of its newest exposure: free space of another camera stayed for up to 0.3 s longer."""
    old = a_frame()
    new = pb.PrismsFrame.FromString(old.SerializeToString())
    new.t_exposure_ns = old.t_exposure_ns + 300 * MS
    new.free.free_to_m[:] = [0.0] * len(new.free.free_to_m)
    content = pb.SurroundFrame(
        schema_version=1, t_ns=new.t_exposure_ns, frame=old.frame, valid=True, cameras=[new, old]
    )
    content.publication.CopyFrom(pb.Publication(boot_id="another", age_ns=50 * MS))
    received = Received(content, 0, 0.4)
    for now_ms, expected in ((0, Occupancy.FREE), (100, Occupancy.UNKNOWN), (400, Occupancy.UNKNOWN)):
        monkeypatch.setattr("osape_client.receive_time.clock_ns", lambda now_ms=now_ms: now_ms * MS)
        assert received.age_s == pytest.approx(0.05 + now_ms / 1e3)
        assert received.oldest_age_s == pytest.approx(0.35 + now_ms / 1e3)
        assert received.stale == (now_ms == 400)
        assert received.space.points(a_free_place(old)).tolist() == [expected]
        assert received.space._rectangles.corner.shape[0] == 2 * len(old.planes.margin_m)


def test_the_newest_message_with_its_age(service: Service) -> None:
    with Subscriber(service.address) as client:
        assert client.latest() is None
        joined(client, service)
        for sequence in range(5):
            message = a_frame()
            message.sequence = sequence
            service.say(message, age_ms=20.0)
        assert until(lambda: (n := client.latest()) is not None and n.content.sequence == 4, 60.0)
        received = client.latest()
        assert received is not None
        assert received.valid
        assert received.frame == "level"
        assert 0.02 <= received.age_s < 60.0
        assert received.space.knows
        assert received.cause == ""


def test_news_that_grow_old_are_stale(service: Service) -> None:
    with Subscriber(service.address, timeout_s=0.3) as client:
        joined(client, service)
        service.say(a_frame(), age_ms=1.0)
        received = client.wait(60.0)
        assert received is not None
        assert until(lambda: received.stale, 60.0)
        assert client.wait(0.05) is None
        assert client.latest() is received
        service.say(a_frame(), age_ms=301.0)
        old = client.wait(60.0)
        assert old is not None
        assert old.stale


def waited(seconds: float) -> None:
    """Time that a planner spends on something else."""
    end_s = time.monotonic() + seconds
    assert until(lambda: time.monotonic() >= end_s, 60.0)


def test_what_waited_while_the_planner_was_busy_is_as_old_as_it_may_be(service: Service) -> None:
    """A service that has ended meanwhile must not be taken for a living one."""
    with Subscriber(service.address, timeout_s=0.4) as client:
        joined(client, service)
        service.say(a_frame(), age_ms=1.0)
        waited(0.5)
        received = client.latest()
        assert received is not None
        assert received.age_s > 0.4
        assert received.stale
        begun_ns = clock_ns()
        waiting = threading.Timer(0.3, lambda: service.say(a_frame(), age_ms=1.0))
        waiting.start()
        received = client.wait(60.0)  # it comes while we wait
        waiting.join()
        assert received is not None
        assert received.received_ns > begun_ns


@pytest.mark.parametrize(
    ("ahead_s", "published_ms", "boot"), [(60.0, 10, True), (0.0, -60_000, False), (-0.05, -4_950, True)]
)
def test_a_stamp_of_the_future_and_a_negative_age_do_not_make_a_message_new(
    ahead_s: float, published_ms: int, boot: bool
) -> None:
    content = a_frame()
    content.t_exposure_ns = time.monotonic_ns() + round(ahead_s * 1e9)
    stamps = PublicationStamps(boot_id() if boot else "another")
    content.publication.CopyFrom(stamps.stamp(0, published_ms * MS))
    received = Received(content, clock_ns() - 5_000 * MS, 0.4)
    assert received.age_s >= 5.0
    assert received.stale


def test_on_the_same_computer_the_stamp_gives_the_age(service: Service) -> None:
    with Subscriber(service.address, timeout_s=30.0) as client:
        joined(client, service)
        waited(0.5)
        for sequence, age_s in enumerate((0.1, 60.0), start=7):
            message = a_frame()
            message.sequence = sequence
            message.t_exposure_ns = time.monotonic_ns() - round(age_s * 1e9)
            service.say(message, age_ms=1.0, boot=boot_id())
            assert until(lambda k=sequence: (n := client.latest()) is not None and n.content.sequence == k, 60.0)
            received = client.latest()
            assert received is not None
            assert age_s <= received.age_s < age_s + 20.0
            assert received.stale == (age_s > 30.0)


def test_blind_is_reported_and_leaves_nothing_free(service: Service) -> None:
    with Subscriber(service.address) as client:
        joined(client, service)
        service.say(blind_message("front", 7, 1, "silent: unplugged"))
        received = client.wait(60.0)
        assert received is not None
        assert not received.valid
        assert received.cause == "silent: unplugged"
        assert not received.space.knows
        assert received.space.points([[2, 0, 0]]).tolist() == [Occupancy.UNKNOWN]


def test_after_the_end_of_a_blind_service_its_last_cause_is_not_repeated(service: Service) -> None:
    """It was, with a growing age, as while the service was blind."""
    with Subscriber(service.address) as client:
        joined(client, service)
        service.say(blind_message("front", 7, 1, "no frame for 0.6 s"))
        received = client.wait(60.0)
        assert received is not None
        assert received.cause == "no frame for 0.6 s"
        ended = dataclasses.replace(received, received_ns=received.received_ns - 3_000_000_000)
        assert ended.cause.startswith("no message for 3.")


def test_after_close_nothing_is_received_and_the_error_says_why(service: Service) -> None:
    """It was "ZMQError: Operation not supported"."""
    client = Subscriber(service.address)
    client.close()
    client.close()
    for call in (client.latest, lambda: client.wait(0.1), lambda: next(client.messages())):
        with pytest.raises(RuntimeError, match=r"subscription to ipc://.*/s is closed; create a new one"):
            call()
    mirror = WorldMirror(service.address, service.address)
    mirror.close()
    with pytest.raises(RuntimeError, match="is closed; create a new one"):
        mirror.update()


def test_several_cameras_as_one(service: Service) -> None:
    found = results({"front": None, "right": None})
    both = all_cameras_message(keeper(found).model(sees), frozenset())
    only = AllCamerasModelBuilder(("front", "right"))
    only.result(found["front"])
    with Subscriber(service.address, all_cameras=True) as client:
        joined(client, service, both)
        service.say(both)
        received = client.wait(60.0)
        assert received is not None
        assert received.cause == ""
        many = received.space._rectangles.corner.shape[0]
        service.say(all_cameras_message(only.model(sees), frozenset({"right"})))
        received = client.wait(60.0)
        assert received is not None
        assert not received.valid
        assert received.cause == "right: no frame yet"
        assert received.space._rectangles.corner.shape[0] == many // 2


def test_foreign_late_and_doubled_messages_are_counted_and_passed_over(service: Service) -> None:
    with Subscriber(service.address, timeout_s=60.0) as client:
        joined(client, service)
        service.say(a_frame(), number=1000)
        assert client.wait(60.0) is not None
        for k, number in enumerate((1000, 999), start=1):  # one at a time: the newest one replaces any before
            service.say(a_frame(), number=number)
            assert until(lambda k=k: client.wait(0.05) is None and client.stats.out_of_order == k, 60.0)
        for k, data in enumerate((b"\xff\xfe nonsense", pb.PrismsFrame(schema_version=9).SerializeToString()), start=1):
            service.publisher._socket.send(data)
            assert until(lambda k=k: client.wait(0.05) is None and client.stats.undecodable == k, 60.0)
        assert "schema version 9" in client.stats.last_error
        service.say(a_frame(), boot="another boot", number=3)
        assert client.wait(60.0) is not None


def test_a_message_without_its_end_is_not_used(service: Service) -> None:
    """Without the publication, which is written last, its age was taken for 0: an old message was not stale. One of all cameras
    lacked the obstacles of the last of them."""
    data = a_frame().SerializeToString()
    with Subscriber(service.address) as client:
        joined(client, service)
        service.publisher._socket.send(data)
        assert until(lambda: client.wait(0.05) is None and client.stats.undecodable == 1, 60.0)
        assert client.stats.last_error.endswith("cut short: the part that is written last is missing")


def test_numbers_that_do_not_fit_together_leave_all_unknown(service: Service) -> None:
    broken = a_frame()
    del broken.planes.corners_m[-1]
    with Subscriber(service.address) as client:
        joined(client, service)
        service.say(broken)
        received = client.wait(60.0)
        assert received is not None
        assert not received.space.knows


def test_a_service_that_starts_again_is_received_again(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/s"
    first = Service(address)
    with Subscriber(address, timeout_s=0.2) as client:
        joined(client, first)
        for _ in range(20):
            first.say(a_frame(), age_ms=0.0)
        assert until(lambda: client.latest() is not None, 60.0)
        first.close()
        received = client.latest()
        assert received is not None
        assert until(lambda: received.stale, 60.0)
        second = Service(address)
        try:
            joined(client, second)  # its numbers begin at 0 again
        finally:
            second.close()


def answer_as_another_program(server: socket.socket) -> None:
    """Answers one connection until ZeroMQ gives it up."""
    connection, _ = server.accept()
    with connection, suppress(OSError):
        connection.settimeout(10.0)
        connection.sendall(b"\xff" * 200)
        while connection.recv(4096):
            pass


def test_a_connection_that_failed_for_good_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """ZeroMQ does not connect again after bytes that no service sends, nor after a service that refused the keys: the client
    received nothing until it was started again."""
    monkeypatch.setattr("osape_client.receive_time.SILENCE_NS", 200 * MS)
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with Subscriber(address) as client, WorldMirror(address, "ipc:///nowhere/r") as mirror:
            mirror.update()
            for _ in range(2):
                answer_as_another_program(other)
            other.close()
            service = Service(address)
            try:
                joined(client, service)
                assert until(lambda: (service.say(a_frame()), mirror.update(), mirror.stats.undecodable)[2], 60.0)
            finally:
                service.close()


def test_silence_is_reported_with_the_last_news_and_a_planner_can_end(service: Service) -> None:
    with Subscriber(service.address, timeout_s=0.1) as client:
        joined(client, service)
        seen: list[bool] = []
        client.subscribe(lambda received: seen.append(received.stale) or len(seen) < 3, silence_s=0.15)
        assert seen[1:] == [True, True]


def test_with_keys_over_tcp_and_without_them_nothing(tmp_path: Path) -> None:
    make_keys(tmp_path / "keys", "planner")
    mine = tmp_path / "mine"
    with pytest.raises(KeyFileError, match="mine: No such file or directory"):  # it was said to contain 0 secrets
        Subscriber("tcp://127.0.0.1:1", keys=mine)
    mine.mkdir()
    with pytest.raises(KeyFileError, match="0 client secrets"):
        Subscriber("tcp://127.0.0.1:1", keys=mine)
    (mine / "planner.secret").write_bytes((tmp_path / "keys" / "planner.secret").read_bytes())
    with pytest.raises(KeyFileError, match=r"server\.public"):
        Subscriber("tcp://127.0.0.1:1", keys=mine)
    (mine / "server.public").write_bytes((tmp_path / "keys" / "server.public").read_bytes())
    keys, context = load_keys(tmp_path / "keys"), zmq.Context()
    allow = AllowList(context, keys)
    address = f"tcp://127.0.0.1:{free_port()}"
    publisher = Publisher(Stream("prisms", address), context, keys)
    message = a_frame()
    message.publication.boot_id = "boot"
    try:
        with Subscriber(address, keys=mine) as known, Subscriber(address) as unknown:
            assert until(lambda: (publisher.publish(message), known.wait(0.05))[1] is not None, 60.0)
            assert unknown.wait(0.3) is None
    finally:
        publisher.close()
        allow.close()
        context.destroy(linger=0)


def test_nothing_heavy_is_imported() -> None:
    heavy = "numba scipy cv2 mcap depthai pydantic pymavlink"
    code = f"import sys, osape_client; print([m for m in '{heavy}'.split() if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True, env=environment()
    )
    assert done.stdout.strip() == "[]"


def test_the_example_reports_when_nothing_is_free(service: Service) -> None:
    example = ROOT / "examples" / "subscriber.py"
    stop = threading.Event()

    def send() -> None:
        for k in itertools.count():
            if stop.wait(0.05):
                return
            service.say(a_frame() if k // 10 % 2 else blind_message("front", 1, 1, "unplugged"))

    speaker = threading.Thread(target=send)
    with subprocess.Popen(
        [sys.executable, str(example), service.address], stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment()
    ) as run:
        speaker.start()
        try:
            assert run.stdout is not None
            lines = [run.stdout.readline() for _ in range(25)]
            assert any(line.startswith("level, ") and "nearest" in line for line in lines), lines
            assert any("nothing may be taken as free: unplugged" in line for line in lines), lines
        finally:
            stop.set()
            speaker.join()
            run.kill()


def test_the_example_explains_why_a_stream_cannot_be_read(service: Service) -> None:
    """It asked whether the service runs, while messages of another schema version came."""
    command = [sys.executable, str(ROOT / "examples" / "subscriber.py"), service.address]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment()) as run:
        stop = threading.Event()
        speaker = threading.Thread(target=lambda: _repeat(service, pb.PrismsFrame(schema_version=2), stop))
        speaker.start()
        try:
            assert run.stdout is not None
            lines = [run.stdout.readline() for _ in range(3)]
            assert "nothing may be taken as free" in lines[2]
            assert "schema version 2; this client reads 1: update osape-client" in lines[2]
        finally:
            stop.set()
            speaker.join()
            run.kill()


def _repeat(service: Service, message: pb.PrismsFrame, stop: threading.Event) -> None:
    while not stop.wait(0.05):
        service.say(message)


def test_the_example_names_an_address_that_cannot_be_used() -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "subscriber.py"), "nowhere"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env=environment(),
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "use ipc://PATH or tcp://HOST:PORT" in line


def test_the_example_refuses_a_second_argument() -> None:
    command = [sys.executable, str(ROOT / "examples" / "subscriber.py"), "ipc:///tmp/none", "more"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment())
    assert done.returncode == 2
    assert done.stderr.startswith("usage:")


def test_the_example_explains_itself() -> None:
    """`--help` was an address that cannot be used."""
    command = [sys.executable, str(ROOT / "examples" / "subscriber.py"), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment())
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage:")


def environment() -> dict[str, str]:
    """With the modules of this checkout."""
    return os.environ | {"PYTHONPATH": str(ROOT)}


@pytest.mark.parametrize("address", ["tcp://", "nowhere", "tcp://host"])
def test_an_address_that_cannot_be_used_names_the_forms(address: str) -> None:
    with pytest.raises(ValueError, match=r"use ipc://PATH or tcp://HOST:PORT"):
        Subscriber(address)
