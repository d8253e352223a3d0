"""HTTP clients that reset their connection leave no traceback."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest

import companion.viewer.live_server as view_live
from companion.live.metrics_server import MetricsServer
from companion.viewer.live_server import LiveServer

pytestmark = pytest.mark.process


class Room:
    """In place of a LivePage."""

    def page(self) -> str:
        return "x" * 5_000_000


def reset(port: int, request: bytes) -> None:
    """Sends a request, or a part of it, and ends the connection by a reset."""
    with socket.create_connection(("127.0.0.1", port), 60.0) as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.sendall(request)
        time.sleep(0.05)  # the server must have begun to read, or there would be nothing to reset


@pytest.fixture(params=["page", "metrics"])
def port(request: pytest.FixtureRequest) -> Iterator[int]:
    server: Any
    server = LiveServer(cast(Any, Room()), "127.0.0.1", 0) if request.param == "page" else MetricsServer(0)
    server.open()
    yield server.port
    server.close()


@pytest.mark.parametrize("request_bytes", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"])
def test_a_reset_leaves_no_traceback(port: int, request_bytes: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    for _ in range(3):
        reset(port, request_bytes)
    with socket.create_connection(("127.0.0.1", port), 60.0) as client:  # it answers on
        client.sendall(b"GET /none HTTP/1.0\r\nHost: localhost\r\n\r\n")
        assert b"404" in client.recv(100)
    assert "Traceback" not in capfd.readouterr().err


def test_another_error_shows_its_trace(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    def broken(*arguments: Any) -> Callable[[], None]:
        raise RuntimeError("a defect")

    monkeypatch.setattr(view_live, "answer", broken)
    server = LiveServer(cast(Any, Room()), "127.0.0.1", 0)
    server.open()
    with socket.create_connection(("127.0.0.1", server.port), 60.0) as client:
        client.sendall(b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
        client.recv(100)
    server.close()
    assert "a defect" in capfd.readouterr().err


def test_the_end_waits_for_a_request_that_is_being_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread within OpenCV when the interpreter ends aborts the process."""
    begun, ended = threading.Event(), threading.Event()

    def slow(page: object, path: str) -> tuple[int, str, bytes]:
        begun.set()
        time.sleep(0.3)
        ended.set()
        return 200, "text/plain", b""

    monkeypatch.setattr(view_live, "answer", slow)
    server = LiveServer(cast(Any, Room()), "127.0.0.1", 0)
    server.open()
    with socket.create_connection(("127.0.0.1", server.port), 60.0) as client:
        client.sendall(b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
        assert begun.wait(60.0)
        server.close()
        assert ended.is_set()
