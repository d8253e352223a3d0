"""The health report as Prometheus text, over HTTP on this machine only, where `[service] metrics_port` asks for it.

The figures are those of the newest report, nothing is measured for them alone. A report that is old is not handed on:
the answer is then 503, which a scraper shows as a target that is down."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer
from typing import Any

from drivers.proto import osape_v1_pb2 as pb
from drivers.watched_thread import WatchedThread

from ..cameras.supervisor import CameraCondition
from .health import STATES

NS = 1_000_000_000
LOOPBACK = "127.0.0.1"
OLDEST_NS = 3 * NS
"""Reports come each second: without one for so long the service does not tell how it is."""
PATIENCE_S = 2.0
"""With a client that sends or takes nothing: one is served at a time."""

POLL_S = 0.1
"""How soon it notices that it is to stop."""

Sample = tuple[dict[str, str], float]


class MetricsServer:
    """Answers GET /metrics. The service goes on without it."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._refused = ""
        self._report: pb.Health | None = None
        self._server: _Server | None = None
        self._thread: WatchedThread | None = None

    def open(self) -> None:
        """Starts the thread; a port that cannot be had is a trouble and no error: nobody flies by it."""
        try:
            self._server = _Server(self.port, self.newest)
        except OSError as error:
            self._refused = (
                f"no metrics: port {self.port} on {LOOPBACK} cannot be had ({error.strerror}); "
                "choose another [service] metrics_port"
            )
            return
        self.port = self._server.server_address[1]
        self._thread = WatchedThread(self._server.serve_forever, "metrics", (POLL_S,))
        self._thread.start()

    @property
    def trouble(self) -> str:
        """Why it cannot answer, in words; empty: it can."""
        if self._thread is not None and self._thread.failure:
            return f"no metrics: their server has ended ({self._thread.failure})"
        return self._refused

    def update(self, report: pb.Health) -> None:
        """The newest report; it is not changed afterwards."""
        self._report = report

    def newest(self) -> str | None:
        """The newest report as text, None when it is old or there is none."""
        report = self._report
        if report is None or time.monotonic_ns() - report.t_ns > OLDEST_NS:
            return None
        return metrics_text(report)

    def close(self) -> None:
        """May be called again."""
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join(5.0)
            self._server.server_close()
            self._server = None


class _Server(TCPServer):
    """Not http.server's own: that one asks the name service for our name before it listens."""

    allow_reuse_address = True

    def __init__(self, port: int, text: Callable[[], str | None]) -> None:
        self.text = text
        super().__init__((LOOPBACK, port), _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that resets its connection is no fault; anything else shows its trace."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """One request."""

    server: _Server
    timeout = PATIENCE_S
    server_version = "osape-companion"
    sys_version = ""

    def do_GET(self) -> None:
        if self.path.split("?")[0] != "/metrics":
            self._answer(404, "there is only /metrics\n")
            return
        text = self.server.text()
        if text is None:
            self._answer(503, "the service has not told for seconds how it is\n")
        else:
            self._answer(200, text)

    def _answer(self, status: int, text: str) -> None:
        body = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Each scrape would be a line in the journal."""


def metrics_text(report: pb.Health) -> str:
    """The report in Prometheus' text format. What is unknown has no sample: it is not 0."""
    lines: list[str] = []
    for name, kind, words, samples in _families(report):
        if samples:
            lines += [f"# HELP osape_{name} {words}", f"# TYPE osape_{name} {kind}"]
            lines += [f"osape_{name}{_labels(labels)} {value:.10g}" for labels, value in samples]
    return "\n".join(lines) + "\n"


def _families(h: pb.Health) -> Iterator[tuple[str, str, str, list[Sample]]]:
    """Name, type, meaning, samples."""
    yield (
        "state",
        "gauge",
        "1 for the present state",
        [({"state": word}, float(h.state == value)) for value, word in STATES.items()],
    )
    yield "troubles", "gauge", "How many things are wrong", [({}, float(len(h.diagnostics)))]
    active: dict[tuple[str, str], int] = Counter((d.code, d.camera) for d in h.diagnostics)
    diagnostics: list[Sample] = [
        ({"code": code, "camera": camera}, float(n)) for (code, camera), n in sorted(active.items())
    ]
    yield "diagnostic", "gauge", "Active diagnostics, by code and camera", diagnostics
    yield "uptime_seconds", "gauge", "Since the service started", [({}, h.uptime_ns / NS)]
    yield "frames_used_total", "counter", "Frames turned into a model", [({}, float(h.frames_used))]
    dropped: list[Sample] = [({"cause": cause}, float(n)) for cause, n in sorted(h.frames_dropped.items())]
    yield "frames_dropped_total", "counter", "Frames not used, by cause", dropped
    lost: list[Sample] = [({}, float(h.samples_lost))]
    yield "samples_lost_total", "counter", "Of the autopilot, before the pipeline took them", lost
    yield from _cameras(h)
    if h.HasField("autopilot"):
        yield from _autopilot(h.autopilot)
    yield "recording", "gauge", "Whether a log is being written", [({}, float(h.recording.recording))]
    yield "recording_bytes", "gauge", "Of the present log", [({}, float(h.recording.bytes))]
    yield "recording_dropped_total", "counter", "Items the disk was too slow for", [({}, float(h.recording.dropped))]
    latencies: list[Sample] = []
    for latency in h.latencies:
        for quantile, ms in (("0.5", latency.p50_ms), ("0.95", latency.p95_ms), ("0.99", latency.p99_ms)):
            latencies.append(({"stage": latency.stage, "quantile": quantile}, ms / 1e3))
    yield "latency_seconds", "gauge", "Of the newest frames, by stage", latencies
    yield "cpu_share", "gauge", "Of one core, since the report before", [({}, h.cpu_share)]
    yield "memory_bytes", "gauge", "Resident", [({}, float(h.memory_bytes))]
    heat: list[Sample] = [({"sensor": t.sensor}, t.celsius) for t in h.temperatures]
    yield "temperature_celsius", "gauge", "Of the machine's sensors", heat


def _cameras(h: pb.Health) -> Iterator[tuple[str, str, str, list[Sample]]]:
    each = [({"camera": c.camera}, c) for c in h.cameras]
    yield "camera_blind", "gauge", "1: nothing of it may be taken as seen", [(n, float(c.blind)) for n, c in each]
    conditions: list[Sample] = [
        ({**n, "condition": code}, float(c.condition == code)) for n, c in each for code in map(str, CameraCondition)
    ]
    yield "camera_condition", "gauge", "1 for the present condition", conditions
    yield "camera_frames_total", "counter", "Frames that arrived", [(n, float(c.frames)) for n, c in each]
    yield "camera_overtaken_total", "counter", "A newer one was there", [(n, float(c.dropped)) for n, c in each]
    yield "camera_starts_total", "counter", "Of its process", [(n, float(c.starts)) for n, c in each]
    yield "camera_rate_hertz", "gauge", "Frames a second", [(n, c.hz) for n, c in each]
    ages = [(n, c.age_ns / NS) for n, c in each if c.HasField("age_ns")]
    yield "camera_age_seconds", "gauge", "Of the newest valid exposure", ages
    offsets = [(n, c.exposure_offset) for n, c in each if c.exposure_offset.HasField("offset_ms")]
    measured: list[Sample] = [(n, o.offset_ms / 1e3) for n, o in offsets]
    yield "camera_exposure_offset_seconds", "gauge", "Exposure stamp minus exposure on the attitude's time", measured


def _autopilot(a: pb.AutopilotHealth) -> Iterator[tuple[str, str, str, list[Sample]]]:
    yield "autopilot_line_open", "gauge", "Whether the line to it is open", [({}, float(a.line_open))]
    yield "autopilot_heard", "gauge", "Whether its heartbeat came", [({}, float(bool(a.autopilot)))]
    if not a.autopilot:
        return
    yield "autopilot_armed", "gauge", "Whether the vehicle is armed", [({}, float(a.armed))]
    yield "autopilot_attitude_hertz", "gauge", "Attitudes a second", [({}, a.attitude_hz)]
    yield "autopilot_position_hertz", "gauge", "Positions a second", [({}, a.position_hz)]
    age: list[Sample] = [({}, a.attitude_age_ns / NS)] if a.HasField("attitude_age_ns") else []
    yield "autopilot_attitude_age_seconds", "gauge", "Of the newest attitude", age
    synchronised = a.clock.source == pb.ClockEstimate.SOURCE_TIMESYNC
    yield "clock_synchronised", "gauge", "Whether TIMESYNC is answered", [({}, float(synchronised))]
    bound: list[Sample] = [({}, a.clock.bound_ns / NS)] if a.clock.HasField("bound_ns") else []
    yield "clock_bound_seconds", "gauge", "The autopilot's clock is known within", bound
    yield "clock_restarts_total", "counter", "Reboots and steps of its clock", [({}, float(a.clock.restarts))]
    odd: list[Sample] = [({"code": code}, float(n)) for code, n in sorted(a.counts.items())]
    yield "autopilot_oddities_total", "counter", "What was odd about its messages", odd


def _labels(labels: dict[str, str]) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(value: str) -> str:
    return value.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
