"""The age of a message contains the time for which the computer was suspended: CLOCK_MONOTONIC stands still meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from companion.streams.publication import PublicationStamps
from companion.streams.world_messages import snapshot_message
from companion.viewer.live_status import camera_status
from companion.viewer.subscriber import LiveSubscriber, Streams
from core.world.params import WorldParams
from core.world.world import World
from osape_client import NeighboursSubscriber, TracksSubscriber
from osape_client.boot import boot_id
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.subscriber import Message
from osape_client.world.mirror import WorldMirror
from tests.companion.small_recordings import INFO
from tests.waiting import until

pytestmark = pytest.mark.process

NS = 1_000_000_000
Suspend = Callable[[float], None]


@pytest.fixture
def suspend(monkeypatch: pytest.MonkeyPatch) -> Suspend:
    """Suspends the computer for some seconds."""
    clock, suspended_ns = time.clock_gettime_ns, [0]

    def gettime_ns(which: int) -> int:
        return clock(which) + (suspended_ns[0] if which == time.CLOCK_BOOTTIME else 0)

    def more(seconds: float) -> None:
        suspended_ns[0] += round(seconds * NS)

    monkeypatch.setattr(time, "clock_gettime_ns", gettime_ns)
    return more


@pytest.fixture
def socket(tmp_path: Path) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.setsockopt(zmq.XPUB_VERBOSE, 1)
        socket.bind(f"ipc://{tmp_path}/s")
        yield socket


def address(socket: zmq.Socket[bytes]) -> str:
    assert socket.poll(0) == 0
    return socket.getsockopt_string(zmq.LAST_ENDPOINT)


def send(socket: zmq.Socket[bytes], message: bytes) -> None:
    assert socket.poll(60_000), "nothing subscribes"
    socket.recv()
    socket.send(message)


def a_frame(stamps: PublicationStamps, age_s: float = 0.0) -> pb.PrismsFrame:
    """A frame that is published now."""
    age_ns = round(age_s * NS)
    content = pb.PrismsFrame(schema_version=1, camera="front", valid=True, t_exposure_ns=time.monotonic_ns() - age_ns)
    content.publication.CopyFrom(stamps.stamp(0, age_ns))
    return content


@pytest.mark.parametrize("boot", [boot_id(), "another computer"], ids=["here", "elsewhere"])
def test_a_message_from_before_a_suspension_is_stale_after_it(suspend: Suspend, boot: str) -> None:
    received = Message(a_frame(PublicationStamps(boot)), clock_ns(), timeout_s=60.0)
    assert not received.stale
    suspend(100.0)
    assert received.age_s >= 100.0
    assert received.stale


@pytest.mark.parametrize("boot", [boot_id(), "another computer"], ids=["here", "elsewhere"])
def test_an_exposure_from_before_a_suspension_that_comes_after_it_is_stale(suspend: Suspend, boot: str) -> None:
    """The service publishes for up to 0.1 s after a suspension, and ends then."""
    stamps = PublicationStamps(boot)
    suspend(100.0)
    received = Message(a_frame(stamps, 0.05), clock_ns(), timeout_s=60.0)
    assert received.age_s >= 100.05
    assert received.stale


def test_a_message_that_was_sent_before_a_suspension_and_comes_after_it_is_stale(suspend: Suspend) -> None:
    content = a_frame(PublicationStamps(boot_id()))
    suspend(100.0)
    assert Message(content, clock_ns(), timeout_s=60.0).stale


@pytest.mark.parametrize("boot", [boot_id(), "another computer"], ids=["here", "elsewhere"])
def test_a_suspension_before_the_start_of_the_service_makes_no_message_old(suspend: Suspend, boot: str) -> None:
    suspend(100.0)
    received = Message(a_frame(PublicationStamps(boot), 0.05), clock_ns(), timeout_s=60.0)
    assert 0.05 <= received.age_s < 60.0
    assert not received.stale


def test_without_the_field_of_the_suspension_the_age_counts_from_the_receipt() -> None:
    """Of a service of an earlier version on this computer the clock is not known."""
    content = a_frame(PublicationStamps(boot_id()))
    content.publication.ClearField("suspended_ns")
    assert Message(content, clock_ns() - 5 * NS).age_s >= 5.0


def test_a_message_that_waited_in_the_socket_during_a_suspension_is_stale(
    suspend: Suspend, socket: zmq.Socket[bytes]
) -> None:
    content = pb.Tracks(schema_version=1, valid=True, publication=PublicationStamps("another computer").stamp(0, 0))
    with TracksSubscriber(address(socket), timeout_s=60.0) as client:
        assert client.wait(0.0) is None
        send(socket, content.SerializeToString())
        assert until(lambda: client._socket.socket.poll(0) > 0)
        suspend(100.0)
        received = client.wait(60.0)
        assert received is not None
        assert received.stale


def test_obstacles_of_neighbours_from_before_a_suspension_are_not_returned(
    suspend: Suspend, socket: zmq.Socket[bytes]
) -> None:
    content = pb.NeighbourObstacles(schema_version=1, t_ns=7, section=3)
    content.publication.CopyFrom(PublicationStamps(boot_id()).stamp(0, 0))
    with NeighboursSubscriber(address(socket), timeout_s=60.0) as client:
        send(socket, content.SerializeToString())
        assert client.newest(wait_s=60.0).t_ns == 7
        suspend(100.0)
        assert client.newest().t_ns == 0


def test_a_copy_of_the_world_cannot_be_used_after_a_suspension(suspend: Suspend, tmp_path: Path) -> None:
    t_ns = time.monotonic_ns()
    content = snapshot_message(World(WorldParams()).picture(t_ns), t_ns)
    content.schema_version = content.section = content.sequence = 1
    content.valid, content.t_ns = True, t_ns
    content.publication.CopyFrom(PublicationStamps(boot_id()).stamp(0, 0))
    with WorldMirror(f"ipc://{tmp_path}/w", f"ipc://{tmp_path}/r", timeout_s=60.0) as mirror:
        mirror._read(content.SerializeToString(), clock_ns())
        assert mirror.usable, mirror.cause
        suspend(100.0)
        assert not mirror.usable
        assert "its newest exposure is 100." in mirror.cause


def test_the_live_page_reports_a_camera_blind_after_a_suspension(suspend: Suspend) -> None:
    subscriber = LiveSubscriber(Streams(prisms="", health="", depth=""))
    now_ns = clock_ns()
    subscriber._add(a_frame(PublicationStamps(boot_id())), now_ns, now_ns)
    subscriber.cameras["front"].info = INFO

    def blind() -> str:
        return str(camera_status(subscriber, "front", None, "", clock_ns())["blind"])

    assert blind() == ""
    suspend(100.0)
    assert blind()
    subscriber.close()
