"""Conflicts and echo faults reach the ground station in full: the part before the colon fits into a STATUSTEXT."""

from __future__ import annotations

import pytest

from companion.autopilot.conflict_codes import CONFLICT_CODES
from companion.autopilot.feedback_check import CAUSES, EchoCheck
from companion.autopilot.status_text import MOST_CHARACTERS
from drivers.mavlink.conflicts import ConflictDetector
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import Frame, MessageSplitter
from drivers.simulation.autopilot import ARDUPILOT, PX4

NS = 1_000_000_000


def message(system: int, component: int) -> Frame:
    m = dialect.MAVLink_obstacle_distance_message(0, 4, [500] * 72, 5, 20, 1200, 5.0, 0.0, 12)
    (frame,) = MessageSplitter().frames(bytes(m.pack(dialect.MAVLink(None, system, component))))
    return frame


def all_conflicts() -> dict[str, str]:
    detector = ConflictDetector(196)
    detector.kind("PX4", NS)
    detector.kind("ArduPilot", NS)
    detector.received(message(1, 196), 1, NS)
    detector.received(message(255, 1), 1, NS)
    for system in (1, 255):
        detector.vehicle(system, "PX4", NS)
    found = detector.texts(NS, 0, connected=True, two_clocks=True)
    detector.left_out(255, NS)
    return found | detector.texts(NS, 1, connected=False)


@pytest.mark.parametrize("topic", sorted(CONFLICT_CODES))
def test_a_conflict_is_sent_in_full_when_it_begins_and_ends(topic: str) -> None:
    """Sent were `OA: timestamps of the autopilot contradict each` and `OA: ArduPilot or PX4`."""
    head = all_conflicts()[topic].split(":")[0]
    assert len(head.split()) >= 2
    assert not head.startswith(("PX4", "ArduPilot"))
    assert len(f"OA: cleared: {head}") <= MOST_CHARACTERS


def test_the_text_of_several_vehicles_names_the_key_that_ends_it() -> None:
    """All cameras are blind until it is set, and the pilot receives nothing but the part before the first colon."""
    assert "set system_id" in all_conflicts()["several vehicles"].split(":")[0]


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_unused_obstacles_are_sent_in_full(kind: str) -> None:
    assert kind in CAUSES
    check = EchoCheck()
    check._waited_ns = 1000 * NS
    text = check.fault(kind, 2000 * NS)
    assert len(f"OA: cleared: {text.split(':')[0]}") <= MOST_CHARACTERS
    check._waited_ns, check._differs_since_ns = 0, NS
    text = check.fault(kind, 2000 * NS)
    assert len(f"OA: cleared: {text.split(':')[0]}") <= MOST_CHARACTERS
