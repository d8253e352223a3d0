"""Messages that wait to be sent."""

from __future__ import annotations

import time
from typing import Any

import pytest

from companion.autopilot.distance_sensor import DOWNWARD, distance_sensor_message
from companion.config.avoidance import AvoidParams
from drivers.mavlink.commands import set_message_interval
from drivers.mavlink.dialect import dialect
from drivers.mavlink.outbox import Outbox

pytestmark = pytest.mark.unit

NOW_NS = 5_000_000_000
OBSTACLES: list[Any] = [
    dialect.MAVLink_obstacle_distance_message(5000, 0, [1201] * 72, 0, 20, 1200, 5.0, 0.0, 12),
    distance_sensor_message(3.0, DOWNWARD, 5000, AvoidParams()),
]


@pytest.mark.parametrize("suspended_s", [0.0, 100.0])
@pytest.mark.parametrize("message", [*OBSTACLES, set_message_interval(1, 330, 2.0)], ids=lambda m: m.get_type())
def test_distances_and_commands_from_before_a_suspension_of_the_computer_are_not_sent(
    message: Any, suspended_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their time limit did not pass, since CLOCK_MONOTONIC stands still: a clear sector of before was sent as of now."""
    clock, outbox = time.clock_gettime_ns, Outbox()
    outbox.post(message, NOW_NS)
    suspended_ns = round(suspended_s * 1e9)
    monkeypatch.setattr(
        time, "clock_gettime_ns", lambda which: clock(which) + (suspended_ns if which == time.CLOCK_BOOTTIME else 0)
    )
    assert outbox.take(NOW_NS + 1_000_000) == ([] if suspended_s else [message])


def test_other_messages_are_sent_after_a_suspension(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, outbox, text = time.clock_gettime_ns, Outbox(), dialect.MAVLink_statustext_message(2, b"OA: front blind")
    outbox.post(text, NOW_NS)
    monkeypatch.setattr(
        time, "clock_gettime_ns", lambda which: clock(which) + (10**11 if which == time.CLOCK_BOOTTIME else 0)
    )
    assert outbox.take(NOW_NS) == [text]
