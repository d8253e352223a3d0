"""Flight modes: the effect of the sent obstacles, the texts, and that the sent obstacles do not depend on the mode."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import companion.autopilot.sender as sender_module
from companion.autopilot.ardupilot_advice import ardupilot_faults
from companion.autopilot.failsafe import STOP_INSIDE_M
from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.flight_modes import Effect, mode_fault, mode_of
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.status_text import MOST_CHARACTERS
from companion.config.avoidance import AvoidParams
from core.types import CameraInfo, CameraMount, Intrinsics
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import Vehicle

from ..report_chain import Chain
from ..sector_models import model, wall_at

NS = 1_000_000_000
AVOID = AvoidParams(max_distance_m=12.0, avoid_margin_m=2.0)
INFO = CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5), CameraMount())
COPTER = {
    "STABILIZE": 0,
    "ALT_HOLD": 2,
    "AUTO": 3,
    "GUIDED": 4,
    "LOITER": 5,
    "RTL": 6,
    "CIRCLE": 7,
    "LAND": 9,
    "DRIFT": 11,
    "SPORT": 13,
    "FLIP": 14,
    "AUTOTUNE": 15,
    "POSHOLD": 16,
    "BRAKE": 17,
    "THROW": 18,
    "AVOID_ADSB": 19,
    "SMART_RTL": 21,
    "FOLLOW": 23,
    "ZIGZAG": 24,
    "SYSTEMID": 25,
    "AUTOROTATE": 26,
    "AUTO_RTL": 27,
    "TURTLE": 28,
    "mode 99": 99,
}
PX4 = {
    "Manual": 1 << 16,
    "Altitude": 2 << 16,
    "Position": 3 << 16,
    "Orbit": 3 << 16 | 1 << 24,
    "Position Slow": 3 << 16 | 2 << 24,
    "mode 3.77": 3 << 16 | 77 << 24,
    "Altitude Cruise": 11 << 16,
    "Termination": 10 << 16,
    "Mission": 4 << 16 | 4 << 24,
    "Return": 4 << 16 | 5 << 24,
    "Land": 4 << 16 | 6 << 24,
    "Precision Land": 4 << 16 | 9 << 24,
    "Hold": 4 << 16 | 3 << 24,
    "Offboard": 6 << 16,
    "mode 4.77": 4 << 16 | 77 << 24,
}
ALL = [("ArduPilot", name, number) for name, number in COPTER.items()] + [
    ("PX4", name, number) for name, number in PX4.items()
]


def vehicle(kind: str, mode: int, armed: bool = True) -> Vehicle:
    return Vehicle(1, kind, 2, armed, mode, NS)


@pytest.mark.parametrize(("kind", "name", "number"), ALL)
def test_all_modes_but_those_known_to_stop_are_reported(kind: str, name: str, number: int) -> None:
    stops = {"LOITER", "BRAKE", "Position", "Hold"}
    for parameters in ({}, {"OA_TYPE": 0.0}, {"OA_TYPE": 1.0}):
        facts = AutopilotFacts(kind=kind, values=parameters)
        assert mode_of(vehicle(kind, number), facts)[0] == name
        texts = mode_fault(vehicle(kind, number), facts)
        assert bool(texts) == (name not in stops)
        assert mode_fault(vehicle(kind, number, armed=False), facts) == ""
        if texts:
            assert texts.startswith(name)
            assert len(f"OA: cleared: {texts.split(':')[0]}") <= MOST_CHARACTERS + 6
            assert "stops" in texts  # what to choose instead


@pytest.mark.parametrize("vehicle_type", [0, 1, 10, 12, 20, 22])
@pytest.mark.parametrize(("kind", "number"), [("ArduPilot", 5), ("ArduPilot", 17), ("PX4", 3 << 16)])
def test_a_vehicle_that_is_no_multicopter_is_not_said_to_brake(kind: str, number: int, vehicle_type: int) -> None:
    """FBWA of ArduPlane, number 5, was taken for LOITER."""
    other = replace(vehicle(kind, number), vehicle_type=vehicle_type)
    assert mode_of(other, AutopilotFacts(kind=kind))[1] is Effect.UNKNOWN
    text = mode_fault(other, AutopilotFacts(kind=kind))
    name = "Position" if kind == "PX4" else f"mode {number}"
    assert text == f"{name} is not known to brake: the vehicle is not a multicopter (MAV_TYPE {vehicle_type})"
    assert len(f"OA: {text.split(':')[0]}") <= MOST_CHARACTERS
    assert mode_fault(replace(other, armed=False), AutopilotFacts(kind=kind)) == ""


@pytest.mark.parametrize("mode", [0.0, 3.0, 4.0])
@pytest.mark.parametrize(("version", "brakes"), [((1, 14), False), ((1, 15), False), ((1, 16), True), ((1, 17), True)])
def test_position_slow_is_flown_by_acceleration_whatever_mpc_pos_mode_is(
    version: tuple[int, int], brakes: bool, mode: float
) -> None:
    """FlightModeManager starts ManualAccelerationSlow without a look at MPC_POS_MODE; only v1.16 and newer brake in it."""
    facts = AutopilotFacts(kind="PX4", values={"MPC_POS_MODE": mode}, version=FirmwareVersion(*version))
    slow = vehicle("PX4", PX4["Position Slow"])
    assert (mode_of(slow, facts)[1] is Effect.BRAKES) == brakes
    assert (mode_fault(slow, facts) == "") == brakes


def test_velocities_with_a_vertical_part_are_not_said_to_be_limited() -> None:
    """AC_Avoid::limit_velocity_3D lays the margin along the velocity: tests/drivers/test_ardupilot_guided.py. LOITER leaves the
    vertical part out."""
    for name in ("GUIDED", "FOLLOW"):
        facts = AutopilotFacts(kind="ArduPilot", version=FirmwareVersion(4, 6))
        text = mode_fault(vehicle("ArduPilot", COPTER[name]), facts)
        assert "while it climbs or descends" in text
        assert "also when blind" in text


@pytest.mark.parametrize(
    ("version", "effect"), [((4, 6, 3), Effect.LEVEL), ((4, 7), Effect.NOTHING), (None, Effect.UNKNOWN)]
)
def test_follow_does_not_brake_where_it_gives_positions_to_the_position_controller(
    version: tuple[int, ...] | None, effect: Effect
) -> None:
    """ModeFollow::run of the development version of 4.7 calls input_pos_vel_accel_NE_m, and nothing of AC_Avoid."""
    facts = AutopilotFacts(kind="ArduPilot", version=None if version is None else FirmwareVersion(*version))
    copter = vehicle("ArduPilot", COPTER["FOLLOW"])
    assert mode_of(copter, facts)[1] is effect
    assert mode_fault(copter, facts).startswith(f"FOLLOW {effect}:")


def test_a_path_planner_is_not_said_to_lead_guided_around_obstacles() -> None:
    """ModeGuided::set_destination uses the waypoint controller only with bit 6 of GUID_OPTIONS, which is 0 as delivered."""
    copter = vehicle("ArduPilot", COPTER["GUIDED"])
    text = mode_fault(copter, AutopilotFacts(kind="ArduPilot", values={"OA_TYPE": 1.0}))
    assert text.startswith("GUIDED brakes level velocity targets alone: with other targets, ")
    assert "flies on, also when blind" in text
    assert "may fly around the artificial wall" in text


def test_the_legs_that_zigzag_flies_by_itself_do_not_brake() -> None:
    """ModeZigZag::auto_control flies by the waypoint controller, which simple avoidance does not limit, but a path planner does."""
    texts = [
        mode_fault(vehicle("ArduPilot", COPTER["ZIGZAG"]), AutopilotFacts(kind="ArduPilot", values=values))
        for values in ({"OA_TYPE": 0.0}, {"OA_TYPE": 2.0}, {}, {"OA_TYPE": 1.0}, {"OA_TYPE": 3.0})
    ]
    assert all(text.startswith("ZIGZAG brakes for the pilot's stick alone:") for text in texts)
    assert ["it flies on" in text for text in texts] == [True, True, True, False, False]
    assert ["OA_TYPE is not known" in text for text in texts] == [False, False, True, False, False]
    assert ["around the artificial wall into unobserved space" in text for text in texts] == [False] * 3 + [True] * 2


@pytest.mark.parametrize(
    "name", ["FLIP", "AUTOTUNE", "THROW", "SYSTEMID", "AUTOROTATE", "TURTLE", "DRIFT", "SPORT", "CIRCLE", "POSHOLD"]
)
def test_modes_without_simple_avoidance_are_not_said_to_brake(name: str) -> None:
    """mode_*.cpp of ArduCopter: none of them calls AC_Avoid for horizontal movement; POSHOLD calls AC_Loiter::update(false)."""
    facts = AutopilotFacts(kind="ArduPilot")
    assert mode_of(vehicle("ArduPilot", COPTER[name]), facts)[1] is Effect.NOTHING


def test_avoidance_of_other_aircraft_brakes_as_velocity_targets_do() -> None:
    """ModeAvoidADSB::set_velocity gives velocities to GUIDED, also for a climb or descent."""
    adsb = vehicle("ArduPilot", COPTER["AVOID_ADSB"])
    assert mode_of(adsb, AutopilotFacts(kind="ArduPilot"))[1] is Effect.LEVEL


@pytest.mark.parametrize("name", ["AUTO", "GUIDED", "RTL", "SMART_RTL", "AUTO_RTL"])
def test_a_path_planner_and_one_that_may_be_there_are_reported(name: str) -> None:
    copter = vehicle("ArduPilot", COPTER[name])
    on, off, unread = (AutopilotFacts(kind="ArduPilot", values=v) for v in ({"OA_TYPE": 1.0}, {"OA_TYPE": 0.0}, {}))
    assert (mode_of(copter, on)[1] is Effect.PLANS) == (name != "GUIDED")
    assert "round the artificial wall" in mode_fault(copter, on)
    assert mode_of(copter, off)[1] is not Effect.PLANS
    assert "OA_TYPE is not known" in mode_fault(copter, unread).replace("(OA_TYPE) is", "OA_TYPE is")
    assert "not known" not in mode_fault(copter, off)


@pytest.mark.parametrize(("oa_type", "plans"), [(1.0, True), (2.0, False), (3.0, True)])
def test_a_planner_by_fences_alone_is_not_said_to_plan_around_obstacles(oa_type: float, plans: bool) -> None:
    """OA_TYPE = 2, Dijkstra, does not read the obstacles of the proximity sensor (AP_OAPathPlanner::avoidance_thread)."""
    values = {"OA_TYPE": oa_type}
    for name in ("AUTO", "GUIDED"):
        text = mode_fault(vehicle("ArduPilot", COPTER[name]), AutopilotFacts(kind="ArduPilot", values=values))
        assert ("artificial wall" in text) == plans
        assert plans or "neither before obstacles nor when blind" in text or "it flies on, also when blind" in text
    assert ("OA_TYPE" in [fault.name for fault in ardupilot_faults(values, AVOID)]) == plans


def test_an_autopilot_of_another_kind_is_not_known_to_brake() -> None:
    assert mode_of(vehicle("autopilot 8", 5), AutopilotFacts(kind="autopilot 8"))[1] is Effect.UNKNOWN
    assert "not known to brake" in mode_fault(vehicle("autopilot 8", 5), AutopilotFacts(kind="autopilot 8"))


@pytest.mark.parametrize("oa_type", [None, 0.0, 1.0])
@pytest.mark.parametrize("kind", ["ArduPilot", "PX4"])
def test_what_is_sent_when_blind_is_the_same_in_each_mode(kind: str, oa_type: float | None) -> None:
    """Armed or not, planner or not, AVOID_MARGIN read or not; only the wall's distance is AVOID_MARGIN's."""
    modes = [vehicle(kind, number, armed) for k, _, number in ALL if k == kind for armed in (True, False)]
    now = modes[0]
    obstacle_output = ObstacleOutput(
        AVOID,
        CameraUse(cameras=("front",), timeout_s=0.3),
        AutopilotLine(lambda: now, lambda message: None),
    )
    obstacle_output.announce(INFO)
    if oa_type is not None:
        for t_ns in (NS, 4 * NS):  # a value counts when it was received again
            obstacle_output.tick(t_ns)
            for name_of, value in (("OA_TYPE", oa_type), ("AVOID_MARGIN", 3.0)):
                obstacle_output.message(dialect.MAVLink_param_value_message(name_of.encode(), value, 9, 1, 0), t_ns)
    margin_m = 2.0 if oa_type is None else 3.0
    wall = int(100 * (margin_m - STOP_INSIDE_M) / np.cos(np.pi / 8))
    for now in modes:
        decided = obstacle_output._builder.decide(obstacle_output._autopilot(), 10 * NS)
        assert decided.values is not None
        ahead = set(np.unique(decided.values[[0, 1, 2, 70, 71]]))
        assert ahead == ({UNKNOWN} if kind == "PX4" else {wall}), now
        assert decided.policy == ("unknown" if kind == "PX4" else "stop"), now


def test_the_mode_is_reported_once_and_again_when_it_changes() -> None:
    now = [vehicle("ArduPilot", COPTER["AUTO"])]
    texts: list[str] = []

    def post(message: object) -> None:
        if isinstance(message, dialect.MAVLink_statustext_message):
            texts.append(message.text)

    obstacle_output = ObstacleOutput(
        AVOID, CameraUse(cameras=("front",), timeout_s=0.3), AutopilotLine(lambda: now[0], post)
    )
    for tenth in range(100):
        obstacle_output.tick(NS + tenth * NS // 10)
    assert texts == ["OA: AUTO does not brake"]
    assert "flight_mode_unprotected" in [d.code for d in obstacle_output.diagnostics(11 * NS)]
    now[0] = vehicle("ArduPilot", COPTER["LOITER"])
    for tenth in range(100, 200):
        obstacle_output.tick(NS + tenth * NS // 10)
    assert texts == ["OA: AUTO does not brake", "OA: cleared: AUTO does not brake"]
    assert "flight_mode_unprotected" not in [d.code for d in obstacle_output.diagnostics(21 * NS)]


def test_px4_need_not_send_obstacles_back_before_position_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """In takeoff PX4 does not evaluate obstacles; their time does not count when Position mode begins."""
    now = [vehicle("PX4", 4 << 16 | 2 << 24)]
    obstacle_output = ObstacleOutput(
        AVOID, CameraUse(cameras=("front",), timeout_s=0.3), AutopilotLine(lambda: now[0], lambda message: None)
    )
    obstacle_output.announce(INFO)
    chain = Chain(model(wall_at(0.0, 4.0, 2.0), free_to_m=4.0, view_deg=72.0))
    chain.builder = obstacle_output._builder
    monkeypatch.setattr(sender_module, "time", SimpleNamespace(monotonic_ns=lambda: chain.now_ns))

    def faulty(seconds: float) -> bool:
        for _ in range(round(10 * seconds)):
            chain.fly(0.1)
            obstacle_output.sender._send(chain.now_ns)
        return "obstacles_not_accepted" in [d.code for d in obstacle_output.diagnostics(chain.now_ns)]

    assert not faulty(6.0)
    now[0] = vehicle("PX4", PX4["Orbit"])
    assert not faulty(6.0)
    now[0] = vehicle("PX4", PX4["Position"])
    assert not faulty(3.0)
    assert faulty(4.0)


def test_faults_are_sent_again_to_an_autopilot_that_was_switched_off() -> None:
    """The battery is replaced while the companion runs on: the pilot must learn of a blind camera before the next flight
    too."""
    now: list[Vehicle | None] = [vehicle("ArduPilot", COPTER["AUTO"])]
    texts: list[str] = []

    def post(message: object) -> None:
        if isinstance(message, dialect.MAVLink_statustext_message):
            texts.append(message.text)

    obstacle_output = ObstacleOutput(
        AVOID, CameraUse(cameras=("front",), timeout_s=0.3), AutopilotLine(lambda: now[0], post)
    )
    obstacle_output.announce(INFO)
    obstacle_output.sender.report = obstacle_output._builder.decide(obstacle_output._autopilot(), NS)
    for tenth in range(150):
        obstacle_output.tick(NS + tenth * NS // 10)
    faults = ["OA: AUTO does not brake", "OA: front blind: no frame yet"]
    assert texts == faults
    now[0] = None
    for tenth in range(150, 200):
        obstacle_output.tick(NS + tenth * NS // 10)
    assert texts == faults  # nothing is sent while no autopilot is received
    now[0] = vehicle("ArduPilot", COPTER["AUTO"])
    for tenth in range(200, 300):
        obstacle_output.tick(NS + tenth * NS // 10)
    assert sorted(texts[2:]) == faults
    now[0] = None
    obstacle_output.tick(32 * NS)
    now[0] = vehicle("ArduPilot", COPTER["LOITER"])
    for tenth in range(320, 400):
        obstacle_output.tick(NS + tenth * NS // 10)
    assert sorted(texts[4:]) == ["OA: cleared: AUTO does not brake", "OA: front blind: no frame yet"]
