"""Messages from another machine that were long on the way: their age contains it, and nothing in them is free."""

from __future__ import annotations

import itertools
import math
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

from companion.viewer.subscriber import LiveSubscriber, Streams
from osape_client import NeighboursSubscriber, Occupancy, Subscriber, TracksSubscriber
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.receive_time import CLOCK_DRIFT, Delays
from osape_client.world.mirror import WorldMirror
from tests.waiting import until

from .test_subscriber import a_frame, a_free_place

pytestmark = pytest.mark.process
S = 1_000_000_000
AGE_NS = S // 50
"""Age of the exposures when they are sent."""


Sent = pb.PrismsFrame | pb.WorldUpdate | pb.Tracks | pb.NeighbourObstacles


class Network:
    """A publisher on another machine, whose clock differs from the one here by an hour."""

    def __init__(self, address: str) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.socket = self.context.socket(zmq.PUB)
        self.socket.bind(address)
        self.address = address
        self.number = 0

    def deliver(
        self, message: pb.PrismsFrame | pb.WorldUpdate | pb.Tracks, late_s: float = 0.0, boot: str = "far"
    ) -> None:
        """Delivers now a message that was sent `late_s` ago."""
        sent_ns = time.monotonic_ns() + 3600 * S - round(late_s * S)
        if isinstance(message, pb.WorldUpdate):
            message.t_ns, message.sequence = sent_ns - AGE_NS, self.number
        elif isinstance(message, pb.NeighbourObstacles):
            message.t_ns = sent_ns - AGE_NS
        else:
            message.t_exposure_ns = sent_ns - AGE_NS
        message.publication.CopyFrom(
            pb.Publication(boot_id=boot, number=self.number, age_ns=AGE_NS, suspended_ns=7 * S)
        )
        self.number += 1
        self.socket.send(message.SerializeToString())

    def close(self) -> None:
        self.context.destroy(linger=0)


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    network = Network(f"ipc://{tmp_path}/s")
    yield network
    network.close()


def test_nothing_is_free_in_a_message_that_was_long_on_the_way(network: Network) -> None:
    """A link that was interrupted delivered what had waited in it, and each message counted as new."""
    content = a_frame()
    with Subscriber(network.address) as client:
        assert until(lambda: (network.deliver(content), client.wait(0.05))[1] is not None, 60.0)
        for late_s in (3.0, 2.0, 1.0):
            network.deliver(content, late_s)
            received = client.wait(60.0)
            assert received is not None
            assert late_s <= received.age_s < late_s + 60.0
            assert received.stale
            assert received.space.points(a_free_place(content)).tolist() == [Occupancy.UNKNOWN]
        assert until(lambda: (network.deliver(content), (m := client.wait(1.0)) is not None and not m.stale)[1], 60.0)


def test_after_a_restart_of_the_other_machine_the_fastest_message_is_found_anew(network: Network) -> None:
    content = a_frame()
    with Subscriber(network.address) as client:
        assert until(lambda: (network.deliver(content), client.wait(0.05))[1] is not None, 60.0)
        network.deliver(content, 100.0, boot="again")
        received = client.wait(60.0)
        assert received is not None
        assert received.age_s < 60.0


def test_a_world_that_lags_is_not_usable(network: Network, tmp_path: Path) -> None:
    """The changes of a world wait in order in a link that is too slow, twenty seconds of them."""
    message = pb.WorldUpdate(schema_version=1, section=1, valid=True, snapshot=True)
    with WorldMirror(network.address, f"ipc://{tmp_path}/no-requests") as mirror:
        assert until(lambda: (network.deliver(message), mirror.update(0.05))[1], 60.0)
        before = mirror.stats.messages
        network.deliver(message, 5.0)
        assert until(lambda: (mirror.update(), mirror.stats.messages > before)[1], 60.0)
        assert mirror.age_s >= 5.0
        assert not mirror.usable
        assert "old" in mirror.cause
        assert until(lambda: (network.deliver(message), mirror.update(0.05))[1], 60.0)


def test_tracks_that_were_long_on_the_way_are_stale(network: Network) -> None:
    message = pb.Tracks(schema_version=1, frame="ned", valid=True)
    with TracksSubscriber(network.address) as client:
        assert until(lambda: (network.deliver(message), client.wait(0.05))[1] is not None, 60.0)
        network.deliver(message, 2.0)
        received = client.wait(60.0)
        assert received is not None
        assert received.age_s >= 2.0
        assert received.stale


def test_moving_obstacles_of_neighbours_go_on_while_their_message_is_on_the_way(network: Network) -> None:
    message = pb.NeighbourObstacles(schema_version=1)
    message.movers.add(centre_m=pb.Vector3(x=8.0), half_size_m=pb.Vector3(x=0.4, y=0.4, z=0.4), velocity_x_m_s=2.0)
    with NeighboursSubscriber(network.address, timeout_s=60.0) as client:
        assert until(lambda: (network.deliver(message), client.newest(wait_s=0.05))[1].movers, 60.0)
        network.deliver(message, 5.0)
        assert until(lambda: client.newest(wait_s=0.05).t_ns == message.t_ns, 60.0)
        (mover,) = client.newest().movers
        assert mover.centre_m[0] >= 8.0 + 2.0 * 5.0
        assert mover.age_s >= 5.0


def test_the_client_in_cpp_counts_the_delay_too(program: Path, network: Network) -> None:
    content = a_frame()
    with subprocess.Popen([program, network.address], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            for late_s, expected in ((0.0, "planes"), (9.0, "s old"), (0.0, "planes")):
                network.deliver(content, late_s)
                for line in itertools.islice(process.stdout, 200):
                    if expected in line:
                        break
                    network.deliver(content, late_s)
                assert expected in line
                if late_s:
                    assert float(line.split(":")[1].split()[0]) >= late_s
        finally:
            process.kill()


def test_the_page_and_ros_show_the_age_of_a_late_frame() -> None:
    """The bridge to ROS publishes frames that are newer than its timeout with the time of their exposure."""
    subscriber = LiveSubscriber(Streams(prisms="", health="", depth=""))
    content = a_frame()
    for sent_s, expected_s in ((100.0, 0.0), (95.0, 5.0)):
        now_ns = clock_ns()
        content.t_exposure_ns = now_ns + round(sent_s * S)
        content.publication.CopyFrom(pb.Publication(boot_id="far"))
        subscriber._add(content, now_ns, now_ns)
        assert now_ns - subscriber.cameras[content.camera].exposed_ns >= (expected_s - 0.1) * S
    subscriber.close()


def test_a_planner_that_always_finds_a_message_knows_when_it_can_have_come(network: Network) -> None:
    """One that is slower than the service never waited, and counted the age of each message from the beginning."""
    content = a_frame()
    with Subscriber(network.address) as client:
        assert until(lambda: (network.deliver(content), client.wait(0.05))[1] is not None, 60.0)
        assert until(lambda: client.wait(0.05) is None, 60.0)
        before_ns = 0
        for _ in range(3):
            network.deliver(content)
            assert client._socket.socket.poll(60_000)
            now_ns = clock_ns()
            received = client.wait(60.0)
            assert received is not None
            assert received.received_ns >= before_ns
            before_ns = now_ns


def test_after_a_wait_without_a_message_the_next_one_is_not_older_than_the_wait(network: Network) -> None:
    """One that came between two waits counted as old as the first of them where that ended late, and was stale after 0.4 s."""
    with Subscriber(network.address) as client:
        assert until(lambda: (network.deliver(a_frame()), client.wait(0.05))[1] is not None, 60.0)
        assert until(lambda: client.wait(0.05) is None, 60.0)
        begun_ns = clock_ns()
        assert client._socket._next(500) is None
        network.deliver(a_frame())
        assert client._socket.socket.poll(60_000)
        received = client.wait(60.0)
        assert received is not None
        assert received.received_ns >= begun_ns + S // 2


def arrivals(monkeypatch: pytest.MonkeyPatch, delays: Delays, sent_s: float, now_s: float, **more: int) -> float:
    """Seconds from the counted arrival of a message to now."""
    monkeypatch.setattr("osape_client.receive_time.clock_ns", lambda: round(now_s * S))
    stamp = pb.Publication(boot_id="far", age_ns=more.get("age_ns", 0), suspended_ns=more.get("suspended_ns", 0))
    t_ns = round(sent_s * S) - stamp.age_ns - stamp.suspended_ns
    return (round(now_s * S) - delays.arrival_ns(stamp, t_ns, round(now_s * S) - more.get("waited_ns", 0))) / S


def test_the_fastest_message_is_the_measure(monkeypatch: pytest.MonkeyPatch) -> None:
    delays = Delays()
    assert arrivals(monkeypatch, delays, 500.0, 10.0) == 0.0
    assert arrivals(monkeypatch, delays, 501.0, 11.2) == pytest.approx(0.2 - 1.2 * CLOCK_DRIFT)
    assert arrivals(monkeypatch, delays, 501.0, 11.2, age_ns=-3 * S) == pytest.approx(0.2 - 1.2 * CLOCK_DRIFT)
    assert arrivals(monkeypatch, delays, 503.0, 12.5) == 0.0, "it was faster than the first one"
    assert arrivals(monkeypatch, delays, 503.5, 13.5) == pytest.approx(0.5, abs=0.01)
    assert arrivals(monkeypatch, delays, 504.5, 14.0, waited_ns=S) == 1.0, "it may have waited in the socket"


def test_a_service_that_starts_again_after_a_suspension_sends_nothing_old(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its clock stood still meanwhile."""
    delays = Delays()
    assert arrivals(monkeypatch, delays, 500.0, 10.0) == 0.0
    assert arrivals(monkeypatch, delays, 600.0, 110.0, suspended_ns=90 * S) == 0.0
    assert arrivals(monkeypatch, delays, 600.0, 111.0, suspended_ns=90 * S) == pytest.approx(1.0, abs=0.01)


def test_clocks_that_drift_apart_make_nothing_old(monkeypatch: pytest.MonkeyPatch) -> None:
    delays = Delays()
    for second in range(0, 36_000, 10):
        assert arrivals(monkeypatch, delays, second * (1.0 - 0.9 * CLOCK_DRIFT), 5.0 + second) == 0.0


def test_a_delay_that_lasts_is_forgotten_as_fast_as_clocks_may_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page on planner clients states how long 0.4 s count."""
    delays = Delays()
    assert arrivals(monkeypatch, delays, 500.0, 10.0) == 0.0
    late_s = [arrivals(monkeypatch, delays, 500.0 + second - 0.4, 10.0 + second) for second in range(1, 600)]
    assert all(late_s[:390])
    assert not any(late_s[420:])


def test_without_an_exposure_nothing_is_compared() -> None:
    assert Delays().arrival_ns(pb.Publication(), 0, 42) == 42


@pytest.mark.parametrize("number", [-(2**63), 2**63 - 1])
def test_numbers_of_a_damaged_message_make_nothing_new(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    delays = Delays()
    assert arrivals(monkeypatch, delays, 500.0, 10.0) == 0.0
    damaged = delays.arrival_ns(pb.Publication(boot_id="far", age_ns=number), 1, 10 * S)
    assert damaged <= 10 * S
    assert arrivals(monkeypatch, delays, 501.0, 11.0) >= 0.0
    assert math.isfinite(damaged)
