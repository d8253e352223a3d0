"""Parts of the obstacle output: texts of parameters, the echo check, texts for the ground station."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from companion.autopilot.feedback_check import PATIENCE_NS, EchoCheck, likely_cause
from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.flight_modes import PX4_POSITION, sends_obstacles_back
from companion.autopilot.obstacle_distance import UNKNOWN, clear_cm, obstacle_distance_message
from companion.autopilot.parameter_advice import advice
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.parameters import ASK_AGAIN_NS, AT_ONCE, OPTIONAL, RENEW_NS, TRIES, WANTED, ParameterReader
from companion.autopilot.px4_advice import delay_advice
from companion.autopilot.status_text import MOST_CHARACTERS, StatusTexts, mount_note, shortened
from companion.config.avoidance import AvoidParams
from companion.pipeline.latency import LatencyStage
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session_types import Vehicle
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_models.px4 import Px4Reader
from drivers.simulation.firmware_profile import FirmwareProfile

AVOID = AvoidParams(max_distance_m=12.0)
NS = 1_000_000_000


def answers(autopilot: SimulatedAutopilot, requests: list, now_ns: int) -> list:
    """The autopilot's answers to messages, decoded from bytes."""
    for request in requests:
        autopilot.receive(bytes(request.pack(autopilot._mavlink)), now_ns)
    return MessageSplitter().feed(b"".join(autopilot.due(now_ns)))


def asked(reader: ParameterReader, autopilot: SimulatedAutopilot, begin_ns: int, seconds: float) -> None:
    """Ten times a second what is due is asked, and answered."""
    for step in range(round(10 * seconds)):
        now_ns = begin_ns + step * NS // 10
        for message in answers(autopilot, reader.due(now_ns, 1), now_ns):
            reader.take(message, now_ns)


def receive(reader: ParameterReader, name: str, value: float, now_ns: int) -> None:
    reader.take(dialect.MAVLink_param_value_message(name.encode(), value, 9, 1, 0), now_ns)


# ---- parameters -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (PX4, {"CP_DIST": 3.5, "CP_DELAY": 0.5, "CP_GO_NO_DATA": 1, "MPC_POS_MODE": -1, "COM_OBS_AVOID": 1}),
        (ARDUPILOT, {"PRX1_TYPE": 2, "AVOID_ENABLE": 7, "AVOID_MARGIN": 2.5, "AVOID_BEHAVE": 1, "AVOID_BACKUP_SPD": 0.75, "OA_TYPE": 0, "RC9_OPTION": 40}),
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
    assert any(
        "did not answer for AVOID_MARGIN" in line
        for line in advice(AutopilotFacts(kind=ARDUPILOT, silent=reader.silent()), AVOID)
    )
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
        (ARDUPILOT, {"PRX1_TYPE": 5.0}, "PRX1_TYPE = 5 is another sensor; make it the second one"),
        (
            ARDUPILOT,
            {"PRX1_TYPE": 5.0, "PRX2_TYPE": 2.0},
            "PRX2_TYPE = 2: it reads obstacles as second proximity sensor",
        ),
        (ARDUPILOT, {"AVOID_ENABLE": 1.0}, "AVOID_ENABLE = 1 is without 2"),
        (ARDUPILOT, {"AVOID_MARGIN": 11.9}, "AVOID_MARGIN = 11.9"),
        (ARDUPILOT, {"AVOID_BEHAVE": 0.0}, "AVOID_BEHAVE = 0"),
        (ARDUPILOT, {"AVOID_BACKUP_SPD": 0.75}, "backs away"),
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
def test_a_forged_value_beside_the_true_one_never_moves_the_wall(forged: float, first: bool) -> None:
    """Farther away, the vehicle flies on into unobserved space; nearer, it backs away without end."""
    reader = ParameterReader()
    reader.begin(ARDUPILOT)
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT))
    autopilot.parameters = {"AVOID_MARGIN": 2.5}
    if not first:
        asked(reader, autopilot, NS, 2.0)
        assert reader.value("AVOID_MARGIN") == 2.5
    for step in range(600):  # a minute of forged values, ten a second
        now_ns = 4 * NS + step * NS // 10
        receive(reader, "AVOID_MARGIN", forged, now_ns)
        for message in answers(autopilot, reader.due(now_ns, 1), now_ns):
            reader.take(message, now_ns)
        assert reader.value("AVOID_MARGIN") == (None if first else 2.5)
    (lines,) = reader.contradictions(64 * NS)
    assert "another sender uses the autopilot's ids" in lines
    assert ("neither is used" in lines) == first
    assert reader.settled
    asked(reader, autopilot, 65 * NS, 40.0)
    assert reader.value("AVOID_MARGIN") == 2.5
    assert reader.contradictions(105 * NS) == []


# ---- echo -------------------------------------------------------------------------------------------------------------


def scene(nearest_cm: int | None, at: int = 0) -> np.ndarray:
    values = np.full(72, clear_cm(AVOID), np.uint16)
    if nearest_cm is not None:
        values[at : at + 2] = nearest_cm
    return values


def echoed(
    kind: str, ignores_obstacles: bool, seconds: float, values: np.ndarray, own: np.ndarray | None = None
) -> EchoCheck:
    """Messages at 10 Hz to an autopilot that was asked to send its obstacles back at 2 Hz; own: what another
    sender sends it instead."""
    streams = {330: 2.0} if kind == PX4 else {132: 2.0}
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, streams=streams))
    autopilot.ignores_obstacles = ignores_obstacles
    check = EchoCheck()
    for step in range(round(10 * seconds)):
        now_ns = NS + step * NS // 10
        check.sent(values, clear_cm(AVOID), now_ns)
        message = obstacle_distance_message(values if own is None else own, 0, AVOID)
        for answer in answers(autopilot, [message], now_ns):
            check.take(answer, now_ns)
    return check


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("at", [0, 20, 70])
def test_an_autopilot_that_uses_the_obstacles_is_not_reported(kind: str, at: int) -> None:
    check = echoed(kind, False, 12.0, scene(400, at))
    assert check.fault(kind, NS + 12 * NS) == ""


@pytest.mark.parametrize(("kind", "text"), [(PX4, "CP_DIST"), (ARDUPILOT, "PRX1_TYPE")])
def test_one_that_does_not_is_reported_with_the_likely_cause(kind: str, text: str) -> None:
    check = echoed(kind, True, 8.0, scene(400))
    assert text in check.fault(kind, NS + 8 * NS)
    assert echoed(kind, True, 3.0, scene(400)).fault(kind, 4 * NS) == ""  # patience
    assert echoed(kind, True, 20.0, scene(None)).fault(kind, 21 * NS) == ""  # nothing was there to be sent back


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("ignores_obstacles", [True, False])
def test_intermittent_obstacles_are_checked_too(kind: str, ignores_obstacles: bool) -> None:
    """Two seconds with an obstacle, one without."""
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, streams={330: 2.0} if kind == PX4 else {132: 2.0}))
    autopilot.ignores_obstacles = ignores_obstacles
    check = EchoCheck()
    for step in range(120):
        now_ns = NS + step * NS // 10
        values = scene(400 if step % 30 < 20 else None)
        check.sent(values, clear_cm(AVOID), now_ns)
        for answer in answers(autopilot, [obstacle_distance_message(values, 0, AVOID)], now_ns):
            check.take(answer, now_ns)
    assert bool(check.fault(kind, 13 * NS)) == ignores_obstacles
    for step in range(150):  # and the time starts anew when nothing was there to be sent back
        check.sent(scene(None), clear_cm(AVOID), 13 * NS + step * NS // 10)
    assert check.fault(kind, 28 * NS) == ""


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_other_obstacles_than_ours_are_reported(kind: str) -> None:
    check = echoed(kind, False, 12.0, scene(400), own=scene(150))
    assert "reports other obstacles" in check.fault(kind, NS + 12 * NS)


@pytest.mark.parametrize("bin_deg", [5, 10])
@pytest.mark.parametrize(("cm", "at", "is_other"), [(700, 36, True), (400, 36, True), (700, 0, True), (430, 0, False)])
def test_a_second_sensor_of_px4_behind_the_nearest_obstacle_is_reported(
    bin_deg: int, cm: int, at: int, is_other: bool
) -> None:
    """Only the nearest obstacle of all directions was compared. PX4 keeps its map and sends it back in the body frame, so that the
    value of each direction is one that was sent for it."""
    ours, nearer = scene(400), AvoidParams(max_distance_m=8.0)  # of another range: clear of ours does not replace it
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=PX4, streams={330: 2.0}))
    autopilot.obstacles = Px4Reader(bin_deg)
    check = EchoCheck()
    for step in range(120):
        now_ns = NS + step * NS // 10
        check.sent(ours, clear_cm(AVOID), now_ns)
        other = np.full(72, UNKNOWN, np.uint16)
        other[at : at + 2] = cm
        mine, second = obstacle_distance_message(ours, 0, AVOID), obstacle_distance_message(other, 0, nearer)
        for answer in answers(autopilot, [mine, second], now_ns):
            check.take(answer, now_ns)
    assert ("reports other obstacles" in check.fault(PX4, 13 * NS)) == is_other


@pytest.mark.parametrize("bin_deg", [5, 10])
def test_the_map_of_px4_is_no_second_sensor_while_the_vehicle_turns_and_obstacles_come_and_go(bin_deg: int) -> None:
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=PX4, streams={330: 2.0}))
    autopilot.obstacles = Px4Reader(bin_deg)
    check, rng = EchoCheck(), np.random.default_rng(3)
    for step in range(600):
        now_ns = NS + step * NS // 10
        values = np.full(72, UNKNOWN, np.uint16)
        values[:10] = values[-10:] = clear_cm(AVOID)
        for at in rng.integers(-9, 9, 4):
            values[at] = rng.integers(100, 1200)
        check.sent(np.roll(values, step % 72), clear_cm(AVOID), now_ns)
        message = obstacle_distance_message(np.roll(values, step % 72), 0, AVOID)
        for answer in answers(autopilot, [message], now_ns):
            check.take(answer, now_ns)
        assert check.fault(PX4, now_ns) == ""


def test_obstacles_at_the_same_distance_in_another_face_are_others() -> None:
    """ArduPilot sends the nearest obstacle of each face back."""
    check = echoed(ARDUPILOT, False, 12.0, scene(400), own=scene(400, 36))
    assert "reports other obstacles" in check.fault(ARDUPILOT, NS + 12 * NS)


def faces_taken(check: EchoCheck, now_ns: int, faces: dict[int, int]) -> None:
    """ArduPilot sends one message for each face with an obstacle: face -> cm."""
    check.sent(scene(400), clear_cm(AVOID), now_ns)
    for face, cm in faces.items():
        check.take(dialect.MAVLink_distance_sensor_message(0, 20, 1200, cm, 0, 10, face, 0), now_ns)


def test_obstacles_of_a_second_sensor_in_another_face_are_others_although_ours_are_used() -> None:
    check = EchoCheck()
    for step in range(120):
        faces_taken(check, NS + step * NS // 10, {0: 400, 4: 150})
    assert "reports other obstacles" in check.fault(ARDUPILOT, 13 * NS)
    for step in range(30):  # it is switched off
        faces_taken(check, 13 * NS + step * NS // 10, {0: 400})
    assert check.fault(ARDUPILOT, 16 * NS) == ""


def test_single_obstacles_in_other_faces_are_no_second_sensor() -> None:
    """A face without an obstacle is not sent: what was in it once does not count as being there since."""
    check = EchoCheck()
    for step in range(300):
        faces_taken(check, NS + step * NS // 10, {0: 400, 4: 150} if step % 100 == 0 else {0: 400})
        assert check.fault(ARDUPILOT, NS + step * NS // 10) == ""


def test_obstacles_that_are_no_longer_sent_do_not_explain_those_of_another_sender() -> None:
    """The autopilot sends back what it has received in the last two seconds."""
    check = echoed(PX4, False, 10.0, scene(150))
    other = obstacle_distance_message(scene(150), 0, AVOID)
    for step in range(100):
        now_ns = 11 * NS + step * NS // 10
        check.sent(scene(400), clear_cm(AVOID), now_ns)
        check.take(other, now_ns)
    assert "reports other obstacles" in check.fault(PX4, 21 * NS)


def test_a_range_finder_of_the_autopilot_and_a_face_without_an_obstacle_are_no_echo() -> None:
    """ArduPilot sends range finders with the ids 0 to 9, the faces of the obstacles with 10 and above (AP_Proximity.h). A range
    finder that looks ahead hid that the obstacles are not used, or was reported as a second sensor."""
    unused, used = EchoCheck(), EchoCheck()
    for step in range(120):
        now_ns = NS + step * NS // 10
        for check in (unused, used):
            check.sent(scene(400), clear_cm(AVOID), now_ns)
            check.take(dialect.MAVLink_distance_sensor_message(0, 20, 700, 150, 0, 0, 0, 0), now_ns)
        used.take(dialect.MAVLink_distance_sensor_message(0, 20, 1200, 400, 0, 10, 0, 0), now_ns)
        unused.take(dialect.MAVLink_distance_sensor_message(0, 20, 1200, 1200, 0, 10, 0, 0), now_ns)
    assert "does not use the obstacles" in unused.fault(ARDUPILOT, 13 * NS)
    assert used.fault(ARDUPILOT, 13 * NS) == ""


@pytest.mark.parametrize("kind", ["", "autopilot 8", "ArduPilot or PX4"])
def test_an_autopilot_of_another_kind_is_not_expected_to_send_obstacles_back(kind: str) -> None:
    assert echoed(PX4, True, 8.0, scene(400)).fault(kind, 9 * NS) == ""


@pytest.mark.parametrize(
    ("kind", "values", "signing", "mavlink_1", "text"),
    [
        (PX4, {"CP_DIST": -1.0}, "", False, "CP_DIST = -1 switches collision prevention off"),
        (ARDUPILOT, {"PRX1_TYPE": 0.0}, "", False, "PRX1_TYPE = 0; set it to 2"),
        (
            PX4,
            {"CP_DIST": -1.0},
            "the autopilot signs and no key is configured: x",
            False,
            "signs and no key is configured",
        ),
        (PX4, {"CP_DIST": 3.0}, "", True, "MAV_PROTO_VER = 2"),
        (ARDUPILOT, {"PRX1_TYPE": 2.0}, "", True, "SERIALn_PROTOCOL = 2"),
        (PX4, {"CP_DIST": 3.0}, "", False, "MAV_n_MODE of its link Onboard"),
        (ARDUPILOT, {"PRX1_TYPE": 5.0, "PRX2_TYPE": 2.0}, "", False, "restarted since"),
        (ARDUPILOT, {}, "", False, "restarted since"),
    ],
)
def test_the_likely_cause_is_the_one_that_is_known(
    kind: str, values: dict[str, float], signing: str, mavlink_1: bool, text: str
) -> None:
    vehicle = Vehicle(1, kind, 2, True, PX4_POSITION << 16, 0, mavlink_1)
    lines = echoed(kind, True, 8.0, scene(400)).fault(
        kind, NS + 8 * NS, likely_cause(vehicle, AutopilotFacts(kind=kind, values=values), signing)
    )
    assert lines.startswith("autopilot does not use the obstacles: ")
    assert text in lines


def test_px4_sends_its_map_in_position_mode_alone() -> None:
    def sends(armed: bool, mode: int, version: FirmwareVersion | None = None) -> bool:
        facts = AutopilotFacts(kind=PX4, version=version)
        return sends_obstacles_back(Vehicle(1, PX4, 2, armed, mode, 0), facts)

    orbit, slow = 3 << 16 | 1 << 24, 3 << 16 | 2 << 24
    assert sends(True, 3 << 16)
    assert not sends(False, 3 << 16)
    assert not sends(True, 4 << 16)
    assert not sends(True, orbit, FirmwareVersion(1, 16))
    assert [sends(True, slow, v) for v in (None, FirmwareVersion(1, 15), FirmwareVersion(1, 16))] == [
        False,
        False,
        True,
    ]
    assert sends_obstacles_back(Vehicle(1, ARDUPILOT, 2, False, 5, 0), AutopilotFacts(kind=ARDUPILOT))
    assert PATIENCE_NS > 2 * NS


# ---- words ------------------------------------------------------------------------------------------------------------


def test_one_text_for_a_change_and_never_a_stream() -> None:
    texts = StatusTexts()
    lines = []
    for tenth in range(600):  # blind every other tenth of a second for half a minute, then for good
        blind = (tenth < 300 and tenth % 2 == 0) or tenth >= 300
        message = texts.due({"front": "silent: no notification of its process" if blind else ""}, NS + tenth * NS // 10)
        if message is not None:
            lines.append((tenth, message.severity, message.text))
    assert 1 <= len(lines) <= 16
    assert lines[-1][2].startswith("OA: front blind: silent")
    assert all(b[0] - a[0] >= 20 for a, b in itertools.pairwise(lines))


def test_a_camera_that_changes_all_the_time_leaves_room_for_others() -> None:
    """Each text was of the first camera that had changed: a second blind camera, and that nothing is braked for, were never sent."""
    texts, lines = StatusTexts(), []
    for tenth in range(600):
        front = "silent" if tenth // 19 % 2 else ""
        left, echo = ("lost", "autopilot does not use the obstacles: CP_DIST") if tenth >= 300 else ("", "")
        message = texts.due({"front": front, "left": left}, NS + tenth * NS // 10, {"clock": "", "echo": echo})
        if message is not None:
            lines.append((tenth, message.text))
    others = [(tenth, text) for tenth, text in lines if "front" not in text]
    assert {text for _, text in others} == {"OA: left blind: lost", "OA: autopilot does not use the obstacles"}
    assert len(others) == 2
    assert others[-1][0] <= 300 + 60
    assert len(lines) >= 20


@pytest.mark.parametrize("camera", ["front", "downward_left"])
def test_a_degraded_mount_is_sent_once_and_fits(camera: str) -> None:
    texts = StatusTexts()
    assert texts.due({}, NS, {f"mount {camera}": mount_note(camera, False)}) is None
    sent = texts.due({}, 4 * NS, {f"mount {camera}": mount_note(camera, True)})
    assert sent.text.startswith(f"OA: {camera} mount differs from")
    assert len(sent.text) <= MOST_CHARACTERS
    assert texts.due({}, 8 * NS, {f"mount {camera}": mount_note(camera, True)}) is None
    assert texts.due({}, 12 * NS, {f"mount {camera}": mount_note(camera, False)}).text.startswith("OA: cleared")


def test_opening_cameras_are_no_news() -> None:
    texts = StatusTexts()
    assert texts.due({"front": "starting"}, NS) is None
    assert texts.due({"front": ""}, 9 * NS) is None
    assert texts.due({"front": "silent"}, 10 * NS).severity == 2
    assert "recovered" in texts.due({"front": ""}, 30 * NS).text


def test_a_camera_that_never_opens_is_reported() -> None:
    texts = StatusTexts()
    assert [texts.due({"front": "no such device"}, t * NS) is None for t in (1, 5, 10, 11, 12)] == [True] * 3 + [
        False,
        True,
    ]


@pytest.mark.parametrize(
    "cause",
    [
        "x" * 200,
        "the newest attitude is too old to be carried forward",
        "zu heiss " * 9,
        "a " + "b" * 60,
        "aaaa " * 20,
        "the distances cannot be computed (ValueError: operands could not be broadcast)",
    ],
)
def test_texts_fit_their_field_and_are_never_cut_inside_a_word(cause: str) -> None:
    full = f"OA: front blind: {cause}"
    text = shortened(full)
    assert len(text.encode()) <= MOST_CHARACTERS
    assert text.startswith("OA: front blind:")
    assert full.startswith(text)
    assert full[len(text) :].lstrip(",;(") == "" or full[len(text) :].lstrip(",;(")[0] == " "
    assert len(full) <= MOST_CHARACTERS or set(text.split()) <= set(full.replace(",", "").replace("(", "").split())


def test_a_text_that_fits_is_not_changed() -> None:
    for length in (49, 50):
        assert shortened("y" * length) == "y" * length
    assert shortened("ä" * 10) == "?" * 10
    assert len(shortened("y" * 51)) == MOST_CHARACTERS
