"""Two services whose messages reach one client, as through a proxy: the free space of one vehicle is none of the other."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq
from google.protobuf.message import Message

from companion.viewer.live_status import silence_text
from companion.viewer.subscriber import LiveSubscriber, Streams
from osape_client import NeighboursSubscriber, Occupancy, Subscriber, TracksSubscriber, WorldMirror, sources
from osape_client.boot import boot_id
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import until

from .test_cpp_subscriber import compiled
from .test_subscriber import a_frame, a_free_place

pytestmark = pytest.mark.process
MS, NS = 1_000_000, 1_000_000_000
Service = tuple[str, int]
Sent = pb.PrismsFrame | pb.WorldUpdate | pb.Tracks | pb.NeighbourObstacles
ON_TWO_MACHINES: tuple[Service, Service] = ("one", 1), ("two", 1)
ON_ONE_MACHINE: tuple[Service, Service] = (boot_id(), 1), (boot_id(), 2)
PAIRS = pytest.mark.parametrize("pair", [ON_TWO_MACHINES, ON_ONE_MACHINE], ids=["two machines", "one machine"])


class Proxy:
    """Publishes the messages of several services. numbers: of the next message of each."""

    def __init__(self, address: str) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.socket = self.context.socket(zmq.PUB)
        self.socket.bind(address)
        self.address = address
        self.numbers: dict[Service, int] = {}

    def send(self, message: Sent, service: Service, age_ms: int = 0) -> None:
        boot, start_ns = service
        number = self.numbers[service] = self.numbers.get(service, 1000 * start_ns) + 1
        t_ns = time.monotonic_ns() - age_ms * MS
        if isinstance(message, pb.WorldUpdate):
            message.t_ns, message.sequence = t_ns, number
        elif isinstance(message, pb.NeighbourObstacles):
            message.t_ns = t_ns
        else:
            message.t_exposure_ns = t_ns
        suspended_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
        stamp = pb.Publication(boot_id=boot, number=number, age_ns=0, suspended_ns=suspended_ns, start_ns=start_ns)
        message.publication.CopyFrom(stamp)
        self.socket.send(message.SerializeToString())

    def close(self) -> None:
        self.context.destroy(linger=0)


@pytest.fixture
def proxy(tmp_path: Path) -> Iterator[Proxy]:
    proxy = Proxy(f"ipc://{tmp_path}/s")
    yield proxy
    proxy.close()


@PAIRS
def test_nothing_is_free_while_two_services_publish(
    proxy: Proxy, pair: tuple[Service, Service], monkeypatch: pytest.MonkeyPatch
) -> None:
    content, (one, two) = a_frame(), pair
    place = a_free_place(content)
    with Subscriber(proxy.address) as client:
        assert until(lambda: (proxy.send(content, one), client.wait(0.05))[1] is not None, 60.0)
        assert until(lambda: client.wait(0.05) is None, 60.0)
        proxy.send(content, two)
        assert client.wait(60.0) is not None, "it may have been started again"
        for service in (one, two) * 3:
            proxy.send(content, service)
            assert client.wait(0.3) is None
            newest = client.latest()
            assert newest is not None
            assert newest.stale
            assert "two services" in newest.cause
            assert newest.space.points(place).tolist() == [Occupancy.UNKNOWN]
        assert client.stats.conflicting == 6
        assert "two services" in client.stats.last_error
        monkeypatch.setattr(sources, "CONFLICT_NS", 200 * MS)
        time.sleep(0.3)
        proxy.send(content, two)
        received = client.wait(60.0)
        assert received is not None
        assert not received.stale


@PAIRS
def test_a_service_that_has_started_again_is_used_at_once(proxy: Proxy, pair: tuple[Service, Service]) -> None:
    content, (one, two) = a_frame(), pair
    with Subscriber(proxy.address) as client:
        assert until(lambda: (proxy.send(content, two), client.wait(0.05))[1] is not None, 60.0)
        assert until(lambda: client.wait(0.05) is None, 60.0)
        for _ in range(3):
            proxy.send(content, one)  # with a lower number
            received = client.wait(60.0)
            assert received is not None
            assert not received.stale
        assert client.stats.conflicting == 0


def test_a_message_that_waited_while_its_service_was_replaced_is_no_conflict(proxy: Proxy) -> None:
    content, (one, two) = a_frame(), ON_ONE_MACHINE
    with Subscriber(proxy.address) as client:
        assert until(lambda: (proxy.send(content, one), client.wait(0.05))[1] is not None, 60.0)
        assert until(lambda: client.wait(0.05) is None, 60.0)
        proxy.send(content, two)
        assert client.wait(60.0) is not None
        proxy.send(content, one, age_ms=60_000)
        assert client.wait(0.3) is None
        proxy.send(content, two)
        assert client.wait(60.0) is not None
        assert (client.stats.conflicting, client.stats.out_of_order) == (0, 1)


@PAIRS
def test_the_worlds_of_two_services_are_not_mixed(pair: tuple[Service, Service]) -> None:
    """Without sockets. Both begin with a snapshot, and go on with changes."""
    one, two = pair
    numbers = {one: 10, two: 10}

    def update(service: Service, *, snapshot: bool) -> bytes:
        numbers[service] += 1
        boot, start_ns = service
        suspended_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
        stamp = pb.Publication(boot_id=boot, start_ns=start_ns, suspended_ns=suspended_ns)
        message = pb.WorldUpdate(schema_version=1, section=1, valid=True, snapshot=snapshot, publication=stamp)
        message.sequence, message.t_ns = numbers[service], time.monotonic_ns()
        return message.SerializeToString()

    with WorldMirror("ipc:///nowhere/w", "ipc:///nowhere/r") as mirror:
        mirror._read(update(one, snapshot=True), clock_ns())
        assert mirror.usable
        mirror._read(update(two, snapshot=False), clock_ns())
        assert not mirror.usable, "of a service whose snapshot is missing"
        for k in range(6):
            mirror._read(update((one, two)[k % 2], snapshot=k > 2), clock_ns())
            assert not mirror.usable
            assert not np.any(mirror.space.snapshot.masks)
        assert "two services" in mirror.cause
        assert mirror.stats.conflicting == 6


@PAIRS
def test_tracks_and_neighbours_of_two_services_are_not_used(proxy: Proxy, pair: tuple[Service, Service]) -> None:
    tracks, neighbours = pb.Tracks(schema_version=1, frame="ned", valid=True), pb.NeighbourObstacles(schema_version=1)
    with TracksSubscriber(proxy.address) as client:
        assert until(lambda: (proxy.send(tracks, pair[0]), client.wait(0.05))[1] is not None, 60.0)
        assert until(lambda: client.wait(0.05) is None, 60.0)
        proxy.send(tracks, pair[1])
        assert client.wait(60.0) is not None
        for count, service in enumerate(pair * 2, start=1):
            proxy.send(tracks, service)
            assert until(lambda count=count: client.wait(0.05) is None and client.conflicting == count, 60.0)
        assert client.last_error == f"{proxy.address}: {sources.CONFLICT_TEXT}"
    with NeighboursSubscriber(proxy.address) as other:
        assert until(lambda: (proxy.send(neighbours, pair[0]), other.newest(wait_s=0.05).t_ns)[1], 60.0)
        assert until(lambda: (other.newest(wait_s=0.05), other.newest().t_ns == neighbours.t_ns)[1], 60.0)
        proxy.send(neighbours, pair[1])
        newest_ns = neighbours.t_ns
        assert until(lambda: other.newest(wait_s=0.05).t_ns == newest_ns, 60.0)
        for count, service in enumerate(pair * 2, start=1):
            proxy.send(neighbours, service)
            assert until(lambda count=count: (other.newest(wait_s=0.05), other.conflicting == count)[1], 60.0)
            assert other.newest().t_ns in (newest_ns, 0)
        assert other.last_error == f"{proxy.address}: {sources.CONFLICT_TEXT}"


@PAIRS
def test_the_page_and_ros_do_not_show_them(proxy: Proxy, pair: tuple[Service, Service]) -> None:
    """The obstacles of one vehicle would be published in ROS as those of the other."""
    content, (one, two) = a_frame(), pair
    used: list[Message] = []
    subscriber = LiveSubscriber(Streams(prisms=proxy.address, health="", depth=""))
    subscriber.on_message = lambda message, _: used.append(message)
    subscriber.open()
    try:
        assert until(lambda: (proxy.send(content, one), time.sleep(0.05), used)[2], 60.0)
        number = proxy.numbers[one]
        assert until(lambda: used[-1].publication.number == number, 60.0)
        proxy.send(content, two)
        assert until(lambda: used[-1].publication.boot_id == two[0] and used[-1].publication.start_ns == two[1], 60.0)
        count = len(used)
        for service in (one, two):
            proxy.send(content, service)
        subscriber.health, subscriber.health_ns = pb.Health(), clock_ns() - NS  # it arrives once per second
        subscriber.cameras[content.camera].received_ns -= NS
        assert until(
            lambda: (proxy.send(content, one), "two services" in silence_text(subscriber, clock_ns()))[1], 60.0
        )
        assert len(used) == count
        assert "two services" not in silence_text(subscriber, clock_ns() + NS), "neither publishes any more"
    finally:
        subscriber.close()


STEPS = """
#include <iostream>
#include "osape_client/subscriber.h"
int main(int, char** argv) {
  osape_client::Subscriber subscriber(argv[1]);
  for (std::string line; std::getline(std::cin, line);) {
    const bool used = subscriber.wait(std::chrono::milliseconds(300)) != nullptr;
    const auto* newest = subscriber.latest();
    std::cout << (used ? "used " : "none ") << (newest == nullptr || newest->stale() ? "stale " : "fresh ")
              << subscriber.stats().conflicting << std::endl;
  }
}
"""


@PAIRS
def test_the_library_for_cpp_does_not_mix_them_either(
    program: Path, tmp_path: Path, proxy: Proxy, pair: tuple[Service, Service]
) -> None:
    content, (one, two) = a_frame(), pair
    binary = compiled(program, tmp_path, STEPS)
    with subprocess.Popen([binary, proxy.address], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        to, out = process.stdin, process.stdout

        def after(service: Service, age_ms: int = 0) -> str:
            proxy.send(content, service, age_ms)
            to.write("\n")
            to.flush()
            return out.readline().strip()

        assert until(lambda: after(one) == "used fresh 0", 60.0)
        assert after(two) == "used fresh 0", "it may have been started again"
        if pair is ON_ONE_MACHINE:
            assert after(one, age_ms=60_000) == "none fresh 0", "it waited while its service was replaced"
        assert [after(service) for service in (one, two, one)] == [f"none stale {k}" for k in (1, 2, 3)]
        to.close()
