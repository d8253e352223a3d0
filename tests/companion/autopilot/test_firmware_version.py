"""The version of the autopilot: read from it, and what it decides."""

from __future__ import annotations

import pytest

from companion.autopilot.feedback_check import likely_cause
from companion.autopilot.firmware_version import RENEW_NS, TRIES, FirmwareVersion, VersionReader
from companion.autopilot.flight_modes import Effect, mode_fault, mode_of
from companion.autopilot.obstacle_output import shutdown_text
from companion.autopilot.parameter_advice import advice
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.parameter_writer import changes
from companion.autopilot.status_text import MOST_CHARACTERS
from companion.config.avoidance import AvoidParams
from companion.config.loader import Config
from drivers.mavlink.session_types import Vehicle
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

from ..parameter_replies import answers

NS = 1_000_000_000
AVOID = AvoidParams(max_distance_m=12.0)
POSITION_MODE = 3 << 16
V1_14, V1_15, V1_16, V1_17 = (FirmwareVersion(1, minor) for minor in (14, 15, 16, 17))


def read(version: tuple[int, int, int], kind: str = PX4, seconds: int = 8) -> VersionReader:
    autopilot, reader = SimulatedAutopilot(FirmwareProfile(kind=kind, version=version)), VersionReader()
    reader.begin(kind, 1)
    for second in range(1, seconds + 1):
        for message in answers(autopilot, reader.due(second * NS, 1), second * NS):
            reader.take(message)
    return reader


@pytest.mark.parametrize(("kind", "version"), [(PX4, (1, 15, 4)), (PX4, (1, 16, 0)), (ARDUPILOT, (4, 6, 2))])
def test_the_version_is_read(kind: str, version: tuple[int, int, int]) -> None:
    reader = read(version, kind, seconds=1)
    assert reader.version == FirmwareVersion(*version)
    assert reader.settled
    assert reader.due(2 * NS, 1) == []
    assert len(reader.due(2 * NS + RENEW_NS, 1)) == 1
    reader.begin(kind, 2)
    assert reader.version is None


def test_both_requests_are_tried_and_not_without_end() -> None:
    reader = VersionReader()
    assert reader.due(NS, 1) == []  # no autopilot yet
    reader.begin(PX4, 1)
    asked = [request for k in range(TRIES + 5) for request in reader.due((k + 1) * NS, 1)]
    assert [m.command for m in asked] == [512, 520] * (TRIES // 2)
    assert reader.settled
    assert reader.version is None
    assert read((0, 0, 0)).version is None  # firmware that does not fill it in


@pytest.mark.parametrize(
    ("version", "mode", "to"),
    [
        (V1_14, 0, None),
        (V1_14, 3, None),
        (V1_14, 4, 0),
        (V1_15, 0, None),
        (V1_15, 4, 0),
        (V1_15, 1, 0),
        (V1_16, 4, None),
        (V1_16, 0, 4),
        (V1_16, 3, 4),
        (V1_17, 4, None),
        (V1_17, 0, 4),
    ],
)
def test_the_version_decides_which_position_mode_brakes(version: FirmwareVersion, mode: int, to: int | None) -> None:
    facts = AutopilotFacts(
        kind=PX4, values={"CP_DIST": 3.0, "CP_DELAY": 0.4, "MPC_POS_MODE": float(mode)}, version=version
    )
    vehicle = Vehicle(1, PX4, 2, True, POSITION_MODE, 0)
    written = {change.name: change.to for change in changes(facts, Config())}
    if to is None:
        assert advice(facts, AVOID) == []
        assert written == {}
        assert mode_fault(vehicle, facts) == ""
        assert "MPC_POS_MODE" not in likely_cause(vehicle, facts, "")
        return
    assert advice(facts, AVOID) == [f"PX4 v{version} will not brake: MPC_POS_MODE = {mode}; set it to {to}"]
    assert written == {"MPC_POS_MODE": float(to)}
    assert mode_of(vehicle, facts)[1] is Effect.WRONG_MODE
    text = mode_fault(vehicle, facts)
    assert len(f"OA: {text.split(':')[0]}") <= MOST_CHARACTERS
    assert f"set it to {to}" in text
    assert f"set it to {to}" in likely_cause(vehicle, facts, "")


@pytest.mark.parametrize(
    ("mode", "part"), [(4, "v1.16 or newer"), (0, "v1.15 or older"), (3, "v1.15 or older"), (1, "none of")]
)
def test_of_an_unknown_version_both_are_reported_and_nothing_is_written(mode: int, part: str) -> None:
    facts = AutopilotFacts(kind=PX4, values={"CP_DIST": 3.0, "CP_DELAY": 0.4, "MPC_POS_MODE": float(mode)})
    (text,) = advice(facts, AVOID)
    assert "version is not known" in text
    assert part in text
    assert changes(facts, Config()) == []
    assert "version is not known" in likely_cause(Vehicle(1, PX4, 2, True, POSITION_MODE, 0), facts, "")


def test_an_autopilot_that_does_not_answer_has_no_version() -> None:
    autopilot, reader = SimulatedAutopilot(FirmwareProfile(hides_version=True)), VersionReader()
    reader.begin(PX4, 1)
    for second in range(1, 9):
        for message in answers(autopilot, reader.due(second * NS, 1), second * NS):
            reader.take(message)
    assert reader.version is None
    assert reader.settled


@pytest.mark.parametrize(
    ("facts", "stands"),
    [
        (AutopilotFacts(kind=ARDUPILOT), False),
        (AutopilotFacts(kind=PX4, values={"MPC_POS_MODE": 4.0}, version=V1_16), True),
        (AutopilotFacts(kind=PX4, values={"MPC_POS_MODE": 4.0}, version=V1_15), False),
        (AutopilotFacts(kind=PX4, values={"MPC_POS_MODE": 0.0}), False),
        (AutopilotFacts(kind="ArduPilot or PX4"), False),
    ],
)
def test_the_text_at_the_end_promises_nothing_that_px4_does_not_do(facts: AutopilotFacts, stands: bool) -> None:
    assert ("Position mode stands" in shutdown_text(facts)) == stands
    assert len(shutdown_text(facts)) <= MOST_CHARACTERS
