"""The text for the ground station while the autopilot's clock is uncertain."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from companion.autopilot.clock_note import NO_ANSWERS, UNCERTAIN
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.status_text import MOST_CHARACTERS
from companion.config.avoidance import AvoidParams
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import LinkStatus, MavlinkParams, Vehicle
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

from ..link_status import link_status

NS = 1_000_000_000
MS = 1_000_000
VEHICLE = Vehicle(1, "PX4", 2, False, 0, NS)


def link(bound_ms: float | None, answered: bool = True) -> LinkStatus:
    """A link whose clock has this error bound; None: there are only arrival times."""
    known = ClockEstimate(ClockSource.TIMESYNC, bound_ns=round((bound_ms or 0.0) * MS))
    clock = ClockEstimate(ClockSource.ENVELOPE) if bound_ms is None else known
    return link_status(VEHICLE, clock=clock, timesync_answered=answered)


def texts_of(state: Callable[[int], LinkStatus], seconds: float) -> list[str]:
    """What the output sends while the link has these states, by tenths of a second."""
    texts: list[str] = []

    def post(message: object) -> None:
        if isinstance(message, dialect.MAVLink_statustext_message):
            texts.append(message.text)

    output = ObstacleOutput(
        AvoidParams(), CameraUse(cameras=("front",), timeout_s=0.3), AutopilotLine(lambda: VEHICLE, post)
    )
    for tenth in range(round(10 * seconds)):
        output.tick(NS + tenth * NS // 10, state(tenth))
    return [text for text in texts if "front" not in text and "brake" not in text]


@pytest.mark.parametrize("text", [NO_ANSWERS, UNCERTAIN])
def test_the_notes_fit_with_their_prefixes(text: str) -> None:
    assert len(f"OA: cleared: {text}") <= MOST_CHARACTERS
    assert ":" not in text


@pytest.mark.parametrize("bound_ms", [None, 0.4])
def test_missing_answers_are_sent_once_and_their_return(bound_ms: float | None) -> None:
    sent = texts_of(lambda tenth: link(bound_ms, answered=not 40 <= tenth < 300), 60.0)
    assert sent == [f"OA: {NO_ANSWERS}", f"OA: cleared: {NO_ANSWERS}"]


def test_a_clock_with_a_small_bound_is_no_news() -> None:
    assert texts_of(lambda tenth: link(0.4), 20.0) == []
    assert texts_of(lambda tenth: link(10.0), 20.0) == []


def test_a_large_bound_is_sent_once_and_its_end() -> None:
    sent = texts_of(lambda tenth: link(55.0 if 30 <= tenth < 300 else 0.5), 60.0)
    assert sent == [f"OA: {UNCERTAIN}", f"OA: cleared: {UNCERTAIN}"]


def test_the_slow_first_answers_after_a_start_are_not_sent() -> None:
    assert texts_of(lambda tenth: link(40.0 if tenth < 15 else 0.5), 30.0) == []


def test_a_bound_that_changes_with_each_answer_is_one_text() -> None:
    """While NTP corrects the clock of this computer, each third answer makes the estimate begin again."""
    sent = texts_of(lambda tenth: link(55.0 if 30 <= tenth < 300 and tenth % 3 else 0.5), 60.0)
    assert sent == [f"OA: {UNCERTAIN}", f"OA: cleared: {UNCERTAIN}"]


@pytest.mark.parametrize("answers", [True, False])
def test_an_autopilot_behind_a_router_without_timesync_is_named(answers: bool) -> None:
    """Real messages: the simulated autopilot, a session and the output."""
    profile = FirmwareProfile(answers_timesync=answers)
    autopilot, session = SimulatedAutopilot(profile), MavlinkSession(MavlinkParams())
    texts: list[str] = []

    def post(message: object) -> None:
        if isinstance(message, dialect.MAVLink_statustext_message):
            texts.append(message.text)

    output = ObstacleOutput(
        AvoidParams(), CameraUse(cameras=("front",), timeout_s=0.3), AutopilotLine(lambda: session.vehicle, post)
    )
    for k in range(8000):
        now_ns = 100 * NS + k * MS
        for data in autopilot.due(now_ns):
            session.receive([(data, now_ns)])
        for data in session.due(now_ns):
            autopilot.receive(data, now_ns)
        if k % 100 == 0:
            output.tick(now_ns, session.status(now_ns))
    assert (f"OA: {NO_ANSWERS}" in texts) is not answers
