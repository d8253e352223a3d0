"""The size of messages that a client receives: a damaged or hostile publisher cannot take its memory."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import zmq

from companion.config.loader import config_of
from osape_client import Subscriber
from osape_client.connect import MOST_BYTES, MOST_WORLD_BYTES
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.world.decode import PLANE_RECORD
from osape_client.world.mirror import WorldMirror
from tests.companion.small_recordings import MS
from tests.waiting import until

pytestmark = pytest.mark.process


@pytest.mark.parametrize("kind", ["prisms", "world"])
def test_a_message_that_is_too_large_is_not_received_and_the_next_one_is(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There was no limit: the client took as much memory as the publisher announced."""
    monkeypatch.setattr("osape_client.receive_time.SILENCE_NS", 200 * MS)
    address = f"ipc://{tmp_path}/s"
    small = pb.PrismsFrame(schema_version=1).SerializeToString()
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        publisher.setsockopt(zmq.XPUB_VERBOSE, 1)
        publisher.bind(address)
        client = Subscriber(address) if kind == "prisms" else WorldMirror(address, f"ipc://{tmp_path}/r")
        with client:
            assert publisher.poll(60_000)
            publisher.recv()
            publisher.send(bytes((MOST_BYTES if kind == "prisms" else MOST_WORLD_BYTES) + 1))

            def look() -> int:
                client.wait(0.05) if isinstance(client, Subscriber) else client.update(0.05)
                return client.stats.messages + client.stats.undecodable

            assert until(lambda: look() > 0 or bool(publisher.poll(0)), 60.0), "it connects again"
            assert look() == 0, "the large message was received"
            publisher.recv()
            assert until(lambda: (publisher.send(small), look())[1] > 0, 60.0)


def test_a_message_of_the_greatest_size_is_received(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/s"
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        publisher.setsockopt(zmq.XPUB_VERBOSE, 1)
        publisher.bind(address)
        with Subscriber(address) as client:
            assert publisher.poll(60_000)
            publisher.send(bytes(MOST_BYTES))
            # it is no message of this schema
            assert until(lambda: client.wait(0.05) is not None or client.stats.undecodable == 1, 60.0)
            assert (client.stats.messages, client.stats.undecodable) == (0, 1)


def test_a_wait_without_an_end_returns_the_next_message(tmp_path: Path) -> None:
    """It raised OverflowError."""
    address, small = f"ipc://{tmp_path}/s", pb.PrismsFrame(schema_version=1)
    small.publication.CopyFrom(pb.Publication(boot_id="far", number=1))
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        publisher.setsockopt(zmq.XPUB_VERBOSE, 1)
        publisher.bind(address)
        with Subscriber(address) as client:
            assert publisher.poll(60_000)
            publisher.send(small.SerializeToString())
            assert client.wait(math.inf) is not None


def test_the_whole_world_of_the_default_configuration_fits() -> None:
    """Free space that cannot be compressed, in each block."""
    world = config_of({}, "defaults").world
    block = 256 * (8 + 4) + 3 * 5
    assert 4 * (world.most_planes * PLANE_RECORD.itemsize + world.most_free_blocks * block) <= MOST_WORLD_BYTES
