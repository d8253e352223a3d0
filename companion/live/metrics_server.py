"""Publishes the health report as Prometheus text over HTTP on the loopback interface (`[service] metrics_port`).

The values are those of the newest report. When that is older than MAX_REPORT_AGE_NS, the answer is 503, which a scraper
shows as a target that is down."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable

from drivers.watched_thread import WatchedThread
from osape_client.proto import osape_v1_pb2 as pb

from ..http_server import HttpHandler, HttpServer
from .prometheus import metrics_text

NS = 1_000_000_000
LOOPBACK = "127.0.0.1"
MAX_REPORT_AGE_NS = 3 * NS
"""Reports arrive once a second; an older report does not describe the present state."""
CLIENT_TIMEOUT_S = 2.0
"""Time limit for a whole request and its answer: requests are served one at a time."""
POLL_S = 0.1
"""Interval at which the server checks whether it has to stop."""


class MetricsServer:
    """Answers GET /metrics. A fault of the server does not affect the rest of the service."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._refused = ""
        self._report: pb.Health | None = None
        self._server: _Server | None = None
        self._thread: WatchedThread | None = None

    def open(self) -> None:
        """Starts the server thread. A port that cannot be bound sets `fault` and raises nothing."""
        try:
            self._server = _Server(self.port, self.newest)
        except OSError as error:
            self._refused = (
                f"no metrics: port {self.port} on {LOOPBACK} cannot be bound ({error.strerror}); "
                "choose another [service] metrics_port"
            )
            return
        self.port = self._server.server_address[1]
        self._thread = WatchedThread(self._server.serve_forever, "metrics", (POLL_S,))
        self._thread.start()

    @property
    def fault(self) -> str:
        """Why the server does not answer, as text; empty while it runs."""
        if self._thread is not None and self._thread.failure:
            return f"no metrics: the metrics server has ended ({self._thread.failure}); restart the service"
        return self._refused

    def update(self, report: pb.Health) -> None:
        """Sets the newest report. The caller must not change it afterwards."""
        self._report = report

    def newest(self) -> str | None:
        """The newest report as text; None when there is none or it is older than MAX_REPORT_AGE_NS."""
        report = self._report
        if report is None or time.monotonic_ns() - report.t_ns > MAX_REPORT_AGE_NS:
            return None
        return metrics_text(report)

    def close(self) -> None:
        """Stops the server. May be called twice."""
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._thread.join(5.0)
            self._server.server_close()
            self._server = None


class _Server(HttpServer):
    def __init__(self, port: int, text: Callable[[], str | None]) -> None:
        self.text = text
        super().__init__((LOOPBACK, port), _Handler)


class _Handler(HttpHandler):
    """Answers one request."""

    server: _Server
    timeout = CLIENT_TIMEOUT_S

    def setup(self) -> None:
        super().setup()
        # `timeout` is that of a single read or write: a client that sends byte by byte would hold the server
        self._limit = threading.Timer(CLIENT_TIMEOUT_S, self._cut_off)
        self._limit.daemon = True
        self._limit.start()

    def finish(self) -> None:
        self._limit.cancel()
        super().finish()

    def _cut_off(self) -> None:
        with contextlib.suppress(OSError):  # it has just ended
            self.connection.shutdown(socket.SHUT_RDWR)

    def do_GET(self) -> None:
        if self.path.split("?")[0] != "/metrics":
            self._answer(404, "only /metrics is available\n")
            return
        text = self.server.text()
        if text is None:
            self._answer(503, "the newest health report is too old\n")
        else:
            self._answer(200, text)

    def _answer(self, status: int, text: str) -> None:
        body = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
