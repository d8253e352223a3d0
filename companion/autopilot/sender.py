"""Sends the decisions of an `ObstacleReportBuilder` to the autopilot, in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.mavlink.session_types import ARDUPILOT
from drivers.watched_thread import WatchedThread

from ..config.avoidance import AvoidParams
from ..suspension import Suspension
from .distance_sensor import DOWNWARD, UPWARD, distance_sensor_message
from .failsafe import AutopilotNow
from .obstacle_distance import obstacle_distance_message
from .obstacle_distance_3d import level_points, obstacle_points_messages
from .obstacle_report import ObstacleReport
from .report_builder import ObstacleReportBuilder

NS = 1_000_000_000
LATE_NS = NS // 10
"""A decision that took longer is made again: the process was stopped, or had no processor time, and what was seen may be too
old now."""
DECISIONS = 3
"""Most decisions for one message. On a computer that needs more than LATE_NS for each, the last one is sent."""


def messages_of(report: ObstacleReport, autopilot: str, avoid: AvoidParams, now_ns: int) -> list[Any]:
    """Returns the messages of a decision: OBSTACLE_DISTANCE, or points for ArduPilot if they are switched on;
    DISTANCE_SENSOR."""
    if report.values is None:
        return []
    time_ms = now_ns // 1_000_000
    if avoid.points and autopilot == ARDUPILOT:
        points_m = np.concatenate([level_points(report.values, avoid), report.points_m])
        out = obstacle_points_messages(points_m, time_ms, avoid)
    else:
        out = [obstacle_distance_message(report.values, now_ns // 1000, avoid)]
    for distance_m, orientation in ((report.up_m, UPWARD), (report.down_m, DOWNWARD)):
        if distance_m is not None and distance_m < avoid.max_distance_m:
            out.append(distance_sensor_message(distance_m, orientation, time_ms, avoid))
    return out


class ObstacleSender:
    """Runs a builder in a thread of its own. ask: what is known of the autopilot; post: sends a message."""

    def __init__(
        self,
        builder: ObstacleReportBuilder,
        avoid: AvoidParams,
        ask: Callable[[], AutopilotNow],
        post: Callable[[Any], None],
    ) -> None:
        self._builder, self._avoid, self._ask, self._post = builder, avoid, ask, post
        self._suspension = Suspension()
        self._stop = threading.Event()
        self._thread = WatchedThread(self._run, "obstacles")
        self._sent_last = False
        self.report: ObstacleReport | None = None
        self.sent = 0
        self.alive_ns = time.monotonic_ns()

    def open(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread. May be called twice. If an exception has ended the thread, the last decision is sent from
        here."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(2.0)
        if self._thread.failure and not self._sent_last:
            self._sent_last = True
            self._send(time.monotonic_ns())

    @property
    def running(self) -> bool:
        """False once the thread has ended, for whatever reason."""
        return self._thread.is_alive()

    @property
    def failure(self) -> str:
        """The exception that ended the thread, as text; empty: none."""
        return self._thread.failure

    def _run(self) -> None:
        step_ns = round(NS / self._avoid.rate_hz)
        next_ns = time.monotonic_ns()
        while not self._stop.wait(max(0.0, (next_ns - time.monotonic_ns()) / NS)):
            now_ns = time.monotonic_ns()
            next_ns = max(next_ns + step_ns, now_ns)
            self._send(now_ns)
            self.alive_ns = time.monotonic_ns()
        self._send(time.monotonic_ns())  # the last message is decided after the stop, with its cause

    def _send(self, now_ns: int) -> None:
        autopilot = self._ask()
        if not autopilot.kind:  # the policy depends on the autopilot
            self._builder.catch_up()  # what waits must not pile up
            return
        report = self._builder.decide(autopilot, now_ns)
        for _ in range(DECISIONS - 1):
            if time.monotonic_ns() - now_ns <= LATE_NS:
                break
            now_ns = time.monotonic_ns()
            report = self._builder.decide(autopilot, now_ns)
        if fault := self._suspension.fault():  # before or during the decision: what was seen counts as new, and is old
            self._builder.end(fault)
            now_ns = time.monotonic_ns()
            report = self._builder.decide(autopilot, now_ns)
        self.report = report
        messages = messages_of(report, autopilot.kind, self._avoid, now_ns)
        for message in messages:
            self._post(message)
        self.sent += bool(messages)
