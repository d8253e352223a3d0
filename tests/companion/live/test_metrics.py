"""The health report as Prometheus text: over real HTTP, from this machine only, never an old one."""

from __future__ import annotations

import http.client
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.config.loader import config_of
from companion.live import metrics_server
from companion.live.metrics_server import LOOPBACK, MAX_REPORT_AGE_NS, MetricsServer
from companion.live.prometheus import metrics_text
from companion.live.service import Service
from companion.paths import Folders
from osape_client.proto import osape_v1_pb2 as pb
from tests.ports import free_port

from .test_status import report

LINE = re.compile(
    r'^osape_[a-z_]+(\{[a-z_]+="(?:[^"\\\n]|\\.)*"(?:,[a-z_]+="(?:[^"\\\n]|\\.)*")*\})? -?[0-9][0-9.e+-]*$'
)


def samples(text: str) -> dict[str, float]:
    """name{labels} -> value; fails on a line that Prometheus could not read."""
    found = {}
    for line in text.splitlines():
        if line.startswith("#"):
            assert re.match(r"^# (HELP osape_\w+ \S.*|TYPE osape_\w+ (gauge|counter))$", line), line
            continue
        assert LINE.match(line), line
        name, value = line.rsplit(" ", 1)
        found[name] = float(value)
    return found


def fetched(port: int, path: str = "/metrics") -> tuple[int, str]:
    connection = http.client.HTTPConnection(LOOPBACK, port, timeout=60.0)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


@pytest.fixture
def server() -> Iterator[MetricsServer]:
    server = MetricsServer(0)  # any port that is free
    server.open()
    assert server.fault == ""
    yield server
    server.close()
    server.close()


def fresh() -> pb.Health:
    h = report()
    h.t_ns = time.monotonic_ns()
    return h


def test_the_figures_are_those_of_the_report() -> None:
    found = samples(metrics_text(report()))
    expected = {
        'osape_state{state="degraded"}': 1.0,
        'osape_state{state="active"}': 0.0,
        "osape_diagnostics": 1.0,
        'osape_diagnostic{code="optional_camera_unavailable",camera="right"}': 1.0,
        'osape_camera_condition{camera="right",condition="lost"}': 1.0,
        'osape_camera_condition{camera="right",condition="running"}': 0.0,
        "osape_frames_used_total": 1200.0,
        'osape_frames_dropped_total{cause="no_attitude"}': 7.0,
        'osape_camera_frames_total{camera="front"}': 1210.0,
        'osape_camera_age_seconds{camera="front"}': 0.042,
        "osape_autopilot_armed": 1.0,
        "osape_clock_bound_seconds": 0.00031,
        'osape_latency_seconds{stage="extract",quantile="0.99"}': 0.0062,
        "osape_recording_bytes": 12_300_000.0,
        "osape_memory_bytes": 210_000_000.0,
    }
    assert {name: found[name] for name in expected} == expected


def test_what_is_unknown_has_no_sample() -> None:
    found = samples(metrics_text(pb.Health(state=pb.Health.STATE_STARTING)))
    assert found['osape_state{state="starting"}'] == 1.0
    assert not any("autopilot" in name or "age" in name or "camera" in name for name in found)
    silent_link = pb.Health()
    silent_link.autopilot.line_open = True
    assert {n for n in samples(metrics_text(silent_link)) if "autopilot" in n or "clock" in n} == {
        "osape_autopilot_link_open",
        "osape_autopilot_connected",
    }


def test_any_name_can_be_read() -> None:
    h = pb.Health()
    h.frames_dropped['a "quoted" \\ name\nof two lines'] = 3
    found = samples(metrics_text(h))
    assert found[r'osape_frames_dropped_total{cause="a \"quoted\" \\ name\nof two lines"}'] == 3.0


def test_asked_over_http(server: MetricsServer) -> None:
    health = fresh()
    server.update(health)
    assert fetched(server.port) == (200, metrics_text(health))
    assert fetched(server.port, "/")[0] == 404


def test_an_old_report_is_not_handed_on(server: MetricsServer) -> None:
    """A service that hangs must not look well."""
    assert fetched(server.port)[0] == 503
    health = fresh()
    health.t_ns -= MAX_REPORT_AGE_NS
    server.update(health)
    assert fetched(server.port)[0] == 503
    server.update(fresh())
    assert fetched(server.port)[0] == 200


def test_it_listens_on_this_machine_only(server: MetricsServer) -> None:
    for address in socket.gethostbyname_ex(socket.gethostname())[2]:
        if not address.startswith("127."):
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((address, server.port), timeout=5.0)
    assert server._server is not None
    assert server._server.socket.getsockname()[0] == LOOPBACK


def test_a_client_that_reports_nothing_does_not_stop_the_others(
    server: MetricsServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metrics_server, "CLIENT_TIMEOUT_S", 0.2)
    server.update(fresh())
    with socket.create_connection((LOOPBACK, server.port)):
        assert fetched(server.port)[0] == 200


def test_a_client_that_sends_its_request_byte_by_byte_is_cut_off(
    server: MetricsServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each byte arrives within the time limit of the socket; all others would wait for as long as it goes on."""
    monkeypatch.setattr(metrics_server, "CLIENT_TIMEOUT_S", 0.2)
    server.update(fresh())
    with socket.create_connection((LOOPBACK, server.port)) as client:
        client.settimeout(0.05)
        client.sendall(b"GET /metrics HTTP/1.0\r\n")
        sent = 0
        while sent < 200:
            try:
                sent += 1
                client.sendall(b"X")
                if client.recv(1) == b"":
                    break
            except TimeoutError:
                continue
            except ConnectionError:
                break
        else:
            pytest.fail(f"after {sent} bytes the server still waits for the rest")
    assert fetched(server.port)[0] == 200


def test_a_taken_port_is_reported_and_no_error(server: MetricsServer) -> None:
    second = MetricsServer(server.port)
    second.open()
    assert f"port {server.port} on 127.0.0.1 cannot be bound" in second.fault
    second.close()


def service(folder: Path, port: int) -> Service:
    config = config_of({"service": {"metrics_port": port}, "record": {"record": "off"}}, "test")
    for name in ("run", "state"):
        (folder / name).mkdir(exist_ok=True)
    return Service(config, Folders(folder / "run", folder / "state"), lambda: None)


def test_the_service_publishes_its_own_boot_id(tmp_path: Path) -> None:
    port = free_port()
    running = service(tmp_path, port)
    try:
        running.open()
        assert running.parts.pipeline_thread.started.wait(60.0)
        running.tick()
        status, text = fetched(port)
        assert status == 200
        assert samples(text)['osape_state{state="blind"}'] == 1.0
    finally:
        running.close()
    with pytest.raises(ConnectionRefusedError):
        fetched(port)


def test_the_service_goes_on_where_the_port_is_taken(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        running = service(tmp_path, taken.getsockname()[1])
        try:
            running.open()
            assert running.parts.pipeline_thread.started.wait(60.0)
            running.tick()
            assert any("choose another [service] metrics_port" in t for t in running.diagnostic_texts)
        finally:
            running.close()


def test_without_a_port_there_is_none(tmp_path: Path) -> None:
    running = service(tmp_path, 0)
    assert running.parts.metrics is None
    running.close()
