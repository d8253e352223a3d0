"""The web server of the live page: what it answers, to whom, and to how many."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Iterator

import pytest

from companion.cli import main
from companion.viewer import live_server
from companion.viewer.live_page import LivePage
from companion.viewer.live_server import LiveServer, in_url, is_loopback
from drivers.base import DeviceNotFound
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.process


@pytest.fixture
def server(page: LivePage) -> Iterator[LiveServer]:
    server = LiveServer(page, "127.0.0.1", 0)
    server.open()
    yield server
    server.close()


def get(
    server: LiveServer, path: str, host: str | None = None, headers: dict[str, str] | None = None
) -> tuple[int, str, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60.0)
    try:
        connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{server.port}"} | (headers or {}))
        reply = connection.getresponse()
        return reply.status, reply.getheader("Content-Type", ""), reply.read()
    finally:
        connection.close()


def test_http_gives_page_and_news_and_nothing_else(server: LiveServer) -> None:
    status, kind, page = get(server, "/")
    assert (status, kind) == (200, "text/html; charset=utf-8")
    assert b"connect-src 'self'" in page
    status, kind, body = get(server, "/update?name=&after=0")
    assert (status, kind) == (200, "application/json")
    assert json.loads(body)["frames"] == []
    assert get(server, "/../etc/passwd")[0] == 404
    for after in ("x", "-1", "9" * 40, "٣"):
        assert get(server, "/update?after=" + "".join(f"%{b:02x}" for b in after.encode()))[0] == 400
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60.0)
    connection.request("POST", "/update", body=b"x")
    assert connection.getresponse().status == 501
    connection.close()


def test_the_address_it_listens_on_is_its_own_name(page: LivePage) -> None:
    server = LiveServer(page, "127.0.0.2", 0)
    server.open()
    try:
        connection = http.client.HTTPConnection("127.0.0.2", server.port, timeout=60.0)
        connection.request("GET", "/update?after=0")
        assert connection.getresponse().status == 200
        connection.close()
    finally:
        server.close()


@pytest.mark.parametrize("host", ["::1", "[::1]"])
def test_it_listens_on_an_ipv6_address(page: LivePage, host: str) -> None:
    server = LiveServer(page, host, 0)
    server.open()
    try:
        for name, status in (("[::1]", 200), ("evil.example", 403)):
            connection = http.client.HTTPConnection("::1", server.port, timeout=60.0)
            connection.request("GET", "/update?after=0", headers={"Host": f"{name}:{server.port}"})
            assert connection.getresponse().status == status
            connection.close()
    finally:
        server.close()


@pytest.mark.parametrize(
    ("host", "shown", "loopback"),
    [
        ("127.0.0.1", "127.0.0.1", True),
        ("127.1", "127.1", True),
        ("0.0.0.0", "127.0.0.1", False),
        ("::1", "[::1]", True),
        ("[::1]", "[::1]", True),
        ("::", "[::1]", False),
        ("fe80::1", "[fe80::1]", False),
        ("drone.local", "drone.local", False),
    ],
)
def test_the_printed_address_and_whether_others_can_connect(host: str, shown: str, loopback: bool) -> None:
    assert (in_url(host), is_loopback(host)) == (shown, loopback)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8760", "127.0.0.1.evil.example:8760"])
def test_a_foreign_name_that_leads_here_is_refused(server: LiveServer, host: str) -> None:
    assert get(server, "/update?after=0", host)[0] == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_page_of_another_server_gets_no_answer(server: LiveServer, site: str) -> None:
    """It could not read the answer, but take the places of pages, and keep the depth images subscribed."""
    header = {"Sec-Fetch-Site": site}
    assert get(server, "/update?after=0", headers=header)[0] == 403
    assert get(server, "/", headers=header)[0] == 200
    for own in ("same-origin", "none"):
        assert get(server, "/update?after=0", headers={"Sec-Fetch-Site": own})[0] == 200


def test_connections_are_limited_and_their_places_come_back(
    server: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has a thread and a file descriptor, and one that sends a byte now and then stays open."""
    monkeypatch.setattr(live_server, "CONNECTIONS", 8)
    address = "127.0.0.1", server.port
    held = [socket.create_connection(address, PATIENCE_S) for _ in range(8)]
    for connection in held:
        connection.sendall(b"G")
    with socket.create_connection(address, PATIENCE_S) as one_more:
        assert one_more.recv(1) == b""
    for connection in held:
        connection.close()

    def served() -> bool:
        try:
            return get(server, "/update?after=0")[0] == 200
        except ConnectionError:
            return False

    assert until(served)


def test_a_port_that_is_taken_is_named(page: LivePage, server: LiveServer) -> None:
    with pytest.raises(DeviceNotFound, match=f"port {server.port} on 127.0.0.1 .*--port"):
        LiveServer(page, "127.0.0.1", server.port).open()


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        (["--live", "flight.mcap"], "leave FILE.mcap"),
        (["--live", "-o", "x"], "leave FILE.mcap"),
        ([], "or --live"),
        (["--live", "--port", "70000"], "expected 0..65535"),
        (["--live", "--foxglove", "-1"], "expected 0..65535"),
    ],
)
def test_wrong_use_is_reported(text: list[str], printed: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", *text]) == 2
    assert printed in capsys.readouterr().err
