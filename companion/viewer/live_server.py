"""The web server of the live page: who may connect, and how many at a time."""

from __future__ import annotations

import errno
import re
import socket
import threading
import time
from ipaddress import ip_address
from socketserver import ThreadingMixIn
from typing import Any
from urllib.parse import parse_qs, urlsplit

from drivers.base import DeviceNotFound

from ..http_server import HttpHandler, HttpServer
from .live_page import LivePage

LOOPBACK, PORT = "127.0.0.1", 8760
PAGES = 16
"""Largest number of parallel requests."""
CONNECTIONS = 128
"""Largest number of connections, each with a thread and a file descriptor. Others are closed at once: without descriptors
the server would try to accept them without pause."""
CLIENT_TIMEOUT_S = 20.0
"""Time limit for a connection without requests."""
FOREIGN = ("cross-site", "same-site")
"""Values of Sec-Fetch-Site of requests by pages of other servers. They cannot read an answer, but each takes a place, and
keeps the depth images subscribed."""
POLL_S = 0.1
CLOSE_S = 2.0
"""Longest wait at the end for requests that are being answered: a thread within OpenCV when the interpreter ends aborts the
process."""


class LiveServer:
    """The web server. `open` raises DeviceNotFound where the port cannot be bound."""

    def __init__(self, page: LivePage, host: str, port: int) -> None:
        self._page, self.host, self.port = page, host.strip("[]"), port
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Starts the server threads."""
        try:
            self._server = _Server(self._page, self.host, self.port)
        except OSError as error:
            by_port = error.errno in (errno.EADDRINUSE, errno.EACCES)
            remedy = "choose another with --port" if by_port else "give --listen an address of this computer"
            raise DeviceNotFound(
                f"the page: port {self.port} on {self.host} cannot be bound ({error.strerror}); {remedy}"
            ) from error
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(POLL_S,), name="pages", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops the server. May be called twice."""
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join(5.0)
            self._server.server_close()
            self._server.finish(CLOSE_S)
            self._server = None


def names_of(host: str) -> frozenset[str]:
    """Allowed values of the Host header. On the loopback address these are its own names, so that a web page cannot
    read the data through a host name that resolves to this computer; on other addresses any (empty)."""
    return frozenset({LOOPBACK, "localhost", "[::1]", in_url(host)}) if is_loopback(host) else frozenset()


def is_loopback(host: str) -> bool:
    """Whether only this computer can connect."""
    if host == "localhost" or host.startswith("127."):
        return True
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def in_url(host: str) -> str:
    """A host as in an address of a browser: IPv6 in brackets, and the loopback address for all addresses."""
    host = host.strip("[]")
    return {"0.0.0.0": LOOPBACK, "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)


def answer(page: LivePage, path: str) -> tuple[int, str, bytes]:
    """(status, type, body) of a request."""
    asked = urlsplit(path)
    if asked.path == "/":
        return 200, "text/html; charset=utf-8", page.page().encode()
    if asked.path != "/update":
        return 404, "text/plain", b"there are the page (/) and its updates (/update)\n"
    query = parse_qs(asked.query)
    numbers = [query.get(key, ["0"])[0] for key in ("after", "world", "team")]
    if not all(number.isascii() and number.isdigit() and len(number) < 16 for number in numbers):
        return 400, "text/plain", b"after, world, team: numbers were expected\n"
    return 200, "application/json", page.answer(query.get("name", [""])[0], *map(int, numbers))


class _Server(ThreadingMixIn, HttpServer):
    """Serves each connection in a thread of its own."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, page: LivePage, host: str, port: int) -> None:
        self._page, self._names = page, names_of(host)
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._places = threading.BoundedSemaphore(PAGES)
        self._connections: set[Any] = set()
        super().__init__((host, port), _Handler)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether a connection is served."""
        if len(self._connections) >= CONNECTIONS:
            return False
        self._connections.add(request)
        return True

    def shutdown_request(self, request: Any) -> None:
        """Called at the end of each connection."""
        self._connections.discard(request)
        super().shutdown_request(request)

    def finish(self, longest_s: float) -> None:
        """Waits until no request is being answered. Later ones are refused."""
        end_s = time.monotonic() + longest_s
        for _ in range(PAGES):
            if not self._places.acquire(timeout=max(0.0, end_s - time.monotonic())):
                return

    def reply(self, host: str, path: str, site: str = "") -> tuple[int, str, bytes]:
        """(status, type, body) of a request. host: its Host header; site: its Sec-Fetch-Site header."""
        if self._names and re.sub(r":\d*$", "", host) not in self._names:  # without the port
            return 403, "text/plain", b"this server answers to its own name only\n"
        if site in FOREIGN and path != "/":  # a link to the page may be anywhere
            return 403, "text/plain", b"this server answers to its own page only\n"
        if not self._places.acquire(blocking=False):
            return 503, "text/plain", b"too many pages are open\n"
        try:
            return answer(self._page, path)
        finally:
            self._places.release()


class _Handler(HttpHandler):
    """Serves the requests of one connection."""

    server: _Server
    timeout = CLIENT_TIMEOUT_S
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        headers = self.headers
        status, kind, body = self.server.reply(headers.get("Host", ""), self.path, headers.get("Sec-Fetch-Site", ""))
        try:
            self.send_response(status)
            for name, value in {
                "Content-Type": kind,
                "Content-Length": str(len(body)),
                "Cache-Control": "no-store",
                "X-Content-Type-Options": "nosniff",
                "X-Frame-Options": "DENY",
            }.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)
        except (BrokenPipeError, ConnectionResetError, TimeoutError):
            self.close_connection = True  # the page was closed
