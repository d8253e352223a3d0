"""What was opened is closed where a later part cannot be opened."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import pytest
import zmq

from companion.config.loader import config_of
from companion.live.world_thread import open_world
from companion.paths import Folders
from companion.share import share_service
from companion.share.share_service import ShareService
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher, Stream
from drivers.base import DeviceNotFound
from drivers.mavlink.address import parse_address
from drivers.mavlink.tcp_line import TcpLine
from osape_client import KeyFileError, Subscriber, WorldMirror

pytestmark = pytest.mark.process


def is_free(folder: Path, name: str) -> bool:
    """Whether a stream can be published at this place."""
    with zmq.Context() as context:
        try:
            Publisher(Stream(name, f"ipc://{folder}/{name}"), context).close()
        except DeviceNotFound:
            return False
        return True


def test_the_stream_of_neighbours_is_closed_where_a_link_cannot_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise DeviceNotFound("no such line")

    monkeypatch.setattr(share_service, "TunnelLine", fails)
    content = {
        "autopilot": {"address": "udpin:127.0.0.1:14550"},
        "publish": {"world": "ipc://{run}/world", "world_requests": "ipc://{run}/requests"},
        "share": {"enabled": True, "tunnel": "udpin:127.0.0.1:14999"},
    }
    config = config_of(content, "test")
    service = ShareService(config, Folders(tmp_path, tmp_path), PublicationStamps("boot"), lambda *_: None)
    with zmq.Context() as context:
        with pytest.raises(DeviceNotFound, match="no such line") as kept:  # with all objects that the error refers to
            service.open(context, None)
        service.close()
        assert is_free(tmp_path, "neighbours"), kept


def test_the_stream_of_the_world_is_closed_where_its_requests_cannot_be_served(tmp_path: Path) -> None:
    (tmp_path / "requests.lock").mkdir()
    publish = {"world": "ipc://{run}/world", "world_requests": "ipc://{run}/requests"}
    with zmq.Context() as context:
        with pytest.raises(DeviceNotFound, match=r"requests\.lock: Is a directory") as kept:
            open_world(config_of({"publish": publish}, "test"), tmp_path, context, None, PublicationStamps("boot"))
        assert is_free(tmp_path, "world"), kept


def test_the_lock_of_a_stream_is_released_where_it_has_no_socket(tmp_path: Path) -> None:
    with zmq.Context() as context:
        context.set(zmq.MAX_SOCKETS, 1)
        with context.socket(zmq.PUB), pytest.raises(DeviceNotFound, match="cannot be bound") as kept:
            Publisher(Stream("prisms", f"ipc://{tmp_path}/prisms"), context)
        assert is_free(tmp_path, "prisms"), kept


@pytest.mark.parametrize("kind", [Subscriber, WorldMirror])
def test_a_client_without_usable_keys_leaves_nothing_open(
    kind: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[zmq.Context[Any]] = []

    class Context(zmq.Context[Any]):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            made.append(self)

    monkeypatch.setattr(zmq, "Context", Context)
    with pytest.raises(KeyFileError):
        kind(f"ipc://{tmp_path}/x", keys=tmp_path)
    assert [context.closed for context in made] == [True]


def test_a_computer_without_free_descriptors_is_a_line_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread of the link ended, and the service with it."""

    def no_socket(*_: Any) -> None:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(socket, "socket", no_socket)
    with pytest.raises(DeviceNotFound, match="Too many open files"):
        TcpLine(parse_address("tcp:127.0.0.1:5760"))
