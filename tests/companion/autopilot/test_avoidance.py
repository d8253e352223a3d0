"""Parameters of the autopilot: how they are read, and which of them are reported."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.parameter_advice import advice
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.parameters import ASK_AGAIN_NS, AT_ONCE, OPTIONAL, RENEW_NS, TRIES, WANTED, ParameterReader
from companion.autopilot.px4_advice import delay_advice
from companion.pipeline.latency import LatencyStage
from drivers.mavlink.dialect import dialect
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

from ..parameter_replies import AVOID, NS, answers


def asked(reader: ParameterReader, autopilot: SimulatedAutopilot, begin_ns: int, seconds: float) -> None:
    """Ten times a second what is due is asked, and answered."""
    for step in range(round(10 * seconds)):
        now_ns = begin_ns + step * NS // 10
        for message in answers(autopilot, reader.due(now_ns, 1), now_ns):
            reader.take(message, now_ns)


def receive(reader: ParameterReader, name: str, value: float, now_ns: int) -> None:
    reader.take(dialect.MAVLink_param_value_message(name.encode(), value, 9, 1, 0), now_ns)


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (PX4, {"CP_DIST": 3.5, "CP_DELAY": 0.5, "CP_GO_NO_DATA": 1, "MPC_POS_MODE": -1, "COM_OBS_AVOID": 1}),
        (ARDUPILOT, {"PRX1_TYPE": 2, "AVOID_ENABLE": 7, "AVOID_MARGIN": 2.5, "AVOID_BEHAVE": 1, "AVOID_BACKUP_SPD": 0.75, "AVOID_BACKUP_DZ": 0.25, "AVOID_BACKZ_SPD": 0.5, "OA_TYPE": 0, "RC9_OPTION": 40}),
    ],
)  # fmt: skip
def test_parameters_are_read_as_the_autopilot_means_them(kind: str, parameters: dict[str, float]) -> None:
    autopilot, reader = SimulatedAutopilot(FirmwareProfile(kind=kind)), ParameterReader()
    autopilot.parameters = dict(parameters)
    reader.begin(kind)
    asked(reader, autopilot, NS, 2.0)
    assert reader.values() == parameters
    assert {m.param_id for m in reader.due(3 * NS + ASK_AGAIN_NS, 1)} <= OPTIONAL
    autopilot.parameters |= {"CP_DIST": 5.0} if kind == PX4 else {"AVOID_MARGIN": 5.0}
    asked(reader, autopilot, 3 * NS, RENEW_NS / NS + 2.0)
    assert 5.0 in reader.values().values()
    assert reader.contradictions(15 * NS) == []


def test_a_parameter_without_an_answer_is_requested_again_and_reported() -> None:
    reader = ParameterReader()
    reader.begin(ARDUPILOT)
    wanted = len(WANTED[ARDUPILOT])
    asked = [len(reader.due(NS + k * ASK_AGAIN_NS // 5, 1)) for k in range(5 * (TRIES + 3))]
    assert max(asked) == AT_ONCE
    assert sum(asked) == TRIES * wanted
    assert set(reader.silent()) == set(WANTED[ARDUPILOT]) - OPTIONAL
    assert {"AVOID_BACKUP_DZ", "AVOID_BACKZ_SPD"} <= OPTIONAL  # not in every version
    lines = advice(AutopilotFacts(kind=ARDUPILOT, silent=reader.silent()), AVOID)
    (line,) = [line for line in lines if "did not answer" in line]
    assert all(name in line for name in reader.silent())
    reader.begin(PX4)
    assert reader.silent() == ()


@pytest.mark.parametrize(
    ("kind", "values", "text"),
    [
        (PX4, {"CP_DIST": -1.0}, "will not brake: CP_DIST = -1"),
        (PX4, {"CP_DIST": 12.0}, "never fly on"),
        (PX4, {"CP_DIST": 3.0, "CP_GO_NO_DATA": 1.0}, "CP_GO_NO_DATA"),
        (PX4, {"CP_DIST": 3.0, "MPC_POS_MODE": 1.0}, "MPC_POS_MODE = 1"),
        (PX4, {"CP_DIST": 3.0, "COM_OBS_AVOID": 1.0}, "hovers in Mission, Return, Takeoff and Land: COM_OBS_AVOID = 1"),
        (ARDUPILOT, {"PRX1_MIN": 3.0, "AVOID_MARGIN": 3.0}, "PRX1_MIN = 3 m, also the artificial wall"),
        (ARDUPILOT, {"PRX1_MIN": 0.5}, "PRX1_MIN = 0.5 m, while they are nearer"),
        (ARDUPILOT, {"PRX1_MAX": 3.0, "AVOID_MARGIN": 3.0}, "PRX1_MAX = 3 m, also the artificial wall"),
        (ARDUPILOT, {"PRX1_MAX": 8.0}, "PRX1_MAX = 8 m, so that it brakes late"),
        (ARDUPILOT, {"PRX1_ORIENT": 1.0}, "PRX1_ORIENT = 1"),
        (ARDUPILOT, {"PRX1_YAW_CORR": -90.0}, "PRX1_YAW_CORR = -90"),
        (ARDUPILOT, {"PRX_IGN_GND": 1.0}, "artificial wall near the ground: PRX_IGN_GND = 1"),
        (ARDUPILOT, {"AVOID_ALT_MIN": 2.0}, "AVOID_ALT_MIN = 2"),
        (ARDUPILOT, {"RC9_OPTION": 40.0, "RC7_OPTION": 41.0}, "turns proximity avoidance off: RC9_OPTION = 40"),
        (ARDUPILOT, {"PRX_FILT": 0.25}, "delays an approaching obstacle by 0.6 s: PRX_FILT = 0.25 Hz"),
        (ARDUPILOT, {"RC3_OPTION": 40.0}, "turns proximity avoidance off: RC3_OPTION = 40"),
        (ARDUPILOT, {"PRX1_TYPE": 0.0}, "does not read obstacles: PRX1_TYPE = 0"),
        (ARDUPILOT, {"PRX1_TYPE": 5.0}, "PRX1_TYPE = 5 is another sensor; remove it or choose"),
        (ARDUPILOT, {"PRX1_TYPE": 2.0, "PRX2_TYPE": 5.0}, "forgets what the second proximity sensor (PRX2_TYPE = 5)"),
        (
            ARDUPILOT,
            {"PRX1_TYPE": 5.0, "PRX2_TYPE": 2.0},
            "PRX2_TYPE = 2: it reads obstacles as second proximity sensor",
        ),
        (ARDUPILOT, {"AVOID_ENABLE": 1.0}, "AVOID_ENABLE = 1 is without 2"),
        (ARDUPILOT, {"AVOID_MARGIN": 11.9}, "AVOID_MARGIN = 11.9"),
        (ARDUPILOT, {"AVOID_BEHAVE": 0.0}, "AVOID_BEHAVE = 0"),
        (ARDUPILOT, {"AVOID_BACKUP_SPD": 0.75}, "backs away"),
        (ARDUPILOT, {"AVOID_BACKUP_SPD": 0.75, "AVOID_BACKUP_DZ": 0.1}, "that no camera may cover; 0 makes it stand"),
        (ARDUPILOT, {"AVOID_BACKUP_SPD": 0.75, "AVOID_BACKUP_DZ": 0.03}, "also from the artificial wall, without end"),
        (ARDUPILOT, {"AVOID_MARGIN": 0.2}, "AVOID_MARGIN = 0.2 m is too small"),
        (ARDUPILOT, {"OA_TYPE": 1.0}, "when blind around the wall"),
    ],
)
def test_what_keeps_the_vehicle_from_braking_is_reported(kind: str, values: dict[str, float], text: str) -> None:
    lines = advice(AutopilotFacts(kind=kind, values=values, version=FirmwareVersion(1, 16)), AVOID)
    assert len(lines) == 1
    assert text in lines[0]


def test_a_delay_shorter_than_what_was_measured_is_reported_with_the_one_to_set() -> None:
    measured = (LatencyStage.EXPOSURE_TO_AUTOPILOT, 120.0, 190.0, 231.0)
    assert delay_advice(AutopilotFacts(kind=PX4, values={"CP_DELAY": 0.25}), measured) == []
    late = AutopilotFacts(kind=PX4, values={"CP_DELAY": 0.2})
    (lines,) = delay_advice(late, measured)
    assert "older than 0.23 s" in lines
    assert lines.endswith("set CP_DELAY to 0.3")
    assert delay_advice(late, None) == delay_advice(AutopilotFacts(kind=PX4), measured) == []
    assert delay_advice(AutopilotFacts(kind=ARDUPILOT, values={"CP_DELAY": 0.2}), measured) == []


def test_backing_up_or_down_is_reported_where_heights_are_sent() -> None:
    """AC_Avoid::adjust_velocity, adjust_velocity_z: OBSTACLE_DISTANCE has no vertical part, so that it makes no vehicle climb or
    descend. Without backing away, AVOID_BACKUP_DZ changes nothing."""
    facts = AutopilotFacts(
        kind=ARDUPILOT, values={"AVOID_BACKZ_SPD": 0.75, "AVOID_BACKUP_SPD": 0.0, "AVOID_BACKUP_DZ": 0.0}
    )
    assert advice(facts, AVOID) == []
    for avoid in (replace(AVOID, points=True), replace(AVOID, upward=True)):
        (line,) = advice(facts, avoid)
        assert "AVOID_BACKZ_SPD = 0.75 m/s" in line
    assert advice(AutopilotFacts(kind=ARDUPILOT, values={"AVOID_BACKZ_SPD": 0.0}), replace(AVOID, points=True)) == []


def test_good_parameters_are_not_reported() -> None:
    px4 = {"CP_DIST": 3.0, "CP_DELAY": 0.4, "CP_GO_NO_DATA": 0.0, "MPC_POS_MODE": 4.0, "COM_OBS_AVOID": 0.0}
    assert advice(AutopilotFacts(kind=PX4, values=px4, version=FirmwareVersion(1, 16)), AVOID) == []
    good = {
        "PRX1_TYPE": 2.0,
        "AVOID_ENABLE": 7.0,
        "AVOID_MARGIN": 2.0,
        "AVOID_BEHAVE": 1.0,
        "AVOID_BACKUP_SPD": 0.0,
        "OA_TYPE": 0.0,
        "PRX1_MIN": 0.0,
        "PRX1_MAX": 0.0,
        "PRX_FILT": 1.0,
        "RC9_OPTION": 41.0,
    }
    assert advice(AutopilotFacts(kind=ARDUPILOT, values=good), AVOID) == []


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_a_value_that_is_no_number_is_no_value(value: float) -> None:
    """A damaged or forged message must neither end the service nor move the wall."""
    reader = ParameterReader()
    reader.begin(ARDUPILOT)
    reader.due(NS, 1)
    for name in ("AVOID_ENABLE", "AVOID_MARGIN"):
        receive(reader, name, value, NS)
        receive(reader, name, value, 3 * NS)
    assert reader.values() == {}
    assert advice(AutopilotFacts(kind=ARDUPILOT, values=reader.values()), AVOID) == []


def test_another_vehicle_has_parameters_of_its_own() -> None:
    reader = ParameterReader()
    reader.begin(ARDUPILOT, 1)
    reader.due(NS, 1)
    receive(reader, "AVOID_MARGIN", 5.0, NS)
    receive(reader, "AVOID_MARGIN", 5.0, 3 * NS)
    reader.begin(ARDUPILOT, 1)
    assert reader.value("AVOID_MARGIN") == 5.0
    reader.begin(ARDUPILOT, 2)
    assert reader.value("AVOID_MARGIN") is None
    assert reader.due(NS, 2)


@pytest.mark.parametrize("forged", [20.0, 0.5])
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(("kind", "name"), [(ARDUPILOT, "AVOID_MARGIN"), (PX4, "CP_DIST")])
def test_a_forged_value_beside_the_true_one_never_moves_the_wall(
    kind: str, name: str, forged: float, first: bool
) -> None:
    """Farther away, the vehicle flies on into unobserved space; nearer, it backs away without end."""
    reader = ParameterReader()
    reader.begin(kind)
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind))
    autopilot.parameters = {name: 2.5}
    if not first:
        asked(reader, autopilot, NS, 2.0)
        assert reader.value(name) == 2.5
    for step in range(600):  # a minute of forged values, ten a second
        now_ns = 4 * NS + step * NS // 10
        receive(reader, name, forged, now_ns)
        for message in answers(autopilot, reader.due(now_ns, 1), now_ns):
            reader.take(message, now_ns)
        assert reader.value(name) == (None if first else 2.5)
    (lines,) = reader.contradictions(64 * NS)
    assert "another sender uses the autopilot's ids" in lines
    assert ("neither is used" in lines) == first
    assert reader.settled
    asked(reader, autopilot, 65 * NS, 40.0)
    assert reader.value(name) == 2.5
    assert reader.contradictions(105 * NS) == []
