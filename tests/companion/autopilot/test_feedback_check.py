"""Whether the autopilot uses the obstacles: what it sends back, compared with what was sent."""

from __future__ import annotations

import numpy as np
import pytest

from companion.autopilot.feedback_check import PATIENCE_NS, EchoCheck, likely_cause
from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.flight_modes import PX4_POSITION, sends_obstacles_back
from companion.autopilot.obstacle_distance import UNKNOWN, clear_cm, obstacle_distance_message
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.config.avoidance import AvoidParams
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import Vehicle
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_models.px4 import Px4Reader
from drivers.simulation.firmware_profile import FirmwareProfile

from ..parameter_replies import AVOID, NS, answers


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
