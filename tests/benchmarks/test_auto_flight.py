"""The models of mission, guided and stop modes: what they do with commands, and how they fly and brake."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.autopilot.auto_flight import (
    ACCEPTED,
    COPTER_AUTO,
    COPTER_GUIDED,
    DENIED,
    DRAG_PER_S,
    FAILED,
    PX4_HOLD,
    PX4_MISSION,
    PX4_OFFBOARD,
    AutoFlight,
    CopterAutoFlight,
    Px4AutoFlight,
    Yaw,
)
from benchmarks.autopilot.px4_position_mode import GRAVITY_M_S2
from benchmarks.autopilot.wind import Wind
from drivers.mavlink import commands
from drivers.mavlink.dialect import dialect
from drivers.simulation.autopilot import ARDUPILOT, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

FAR = np.array([[300.0, 0.0]])


def px4(speed_m_s: float = 5.0, mode: int = PX4_MISSION, waypoints: np.ndarray = FAR) -> AutoFlight:
    return Px4AutoFlight(waypoints, 3.0, speed_m_s, mode)


def copter(speed_m_s: float = 5.0, mode: int = COPTER_AUTO, waypoints: np.ndarray = FAR) -> AutoFlight:
    return CopterAutoFlight(waypoints, 3.0, speed_m_s, mode)


def fly(flight: AutoFlight, seconds: float) -> AutoFlight:
    for _ in range(round(seconds / 0.02)):
        flight.step(0.02)
    return flight


def stop_m(flight: AutoFlight) -> float:
    """Way until it stands."""
    begin_m = float(flight.position_m[0])
    fly(flight, 15.0)
    assert flight.speed_m_s < 0.05
    return float(flight.position_m[0]) - begin_m


@pytest.mark.parametrize("make", [px4, copter])
def test_a_mission_is_flown_at_its_speed_and_without_overshoot(make: object) -> None:
    assert callable(make)
    flight = make(3.0, waypoints=np.array([[30.0, 0.0], [30.0, 15.0]]))
    fastest, farthest = 0.0, 0.0
    for _ in range(5000):
        flight.step(0.02)
        fastest, farthest = max(fastest, flight.speed_m_s), max(farthest, float(flight.position_m[0]))
    assert flight.finished
    assert fastest == pytest.approx(3.0, abs=0.4)
    assert farthest < 30.5
    assert np.allclose(flight.position_m, [30.0, 15.0], atol=0.5)


@pytest.mark.parametrize(("speed_m_s", "least_m", "most_m"), [(2.0, 1.0, 2.6), (5.0, 5.0, 8.0)])
def test_hold_and_brake_stop_the_vehicle(speed_m_s: float, least_m: float, most_m: float) -> None:
    flight = fly(px4(speed_m_s), 10.0)
    assert flight.command(commands.set_px4_hold(1)) == ACCEPTED
    assert flight.mode == PX4_HOLD
    assert least_m < stop_m(flight) < most_m
    flight = fly(copter(speed_m_s), 10.0)
    assert flight.command(commands.set_copter_mode(1, commands.COPTER_BRAKE)) == ACCEPTED
    assert least_m < stop_m(flight) < most_m
    loiter = fly(copter(speed_m_s), 10.0)
    loiter.command(commands.set_copter_mode(1, commands.COPTER_LOITER))
    assert stop_m(loiter) > speed_m_s * 1.0


def test_reposition_without_coordinates() -> None:
    flight = fly(px4(), 5.0)
    assert flight.command(commands.px4_reposition_here(1)) == ACCEPTED
    assert flight.mode == PX4_HOLD
    assert fly(copter(), 5.0).command(commands.px4_reposition_here(1)) == DENIED


def test_hold_from_offboard_begins_with_the_velocity_setpoint() -> None:
    flight = px4(mode=PX4_OFFBOARD)
    flight.velocity_target_m_s = np.array([5.0, 0.0])
    fly(flight, 0.6)
    assert flight.speed_m_s < 3.0
    flight.command(commands.set_px4_hold(1))
    assert flight.speed_m_s == pytest.approx(5.0)
    assert 5.0 < stop_m(flight) < 8.0


def test_change_speed() -> None:
    for flight in (px4(), copter()):
        fly(flight, 8.0)
        assert flight.command(commands.change_speed(1, 2.0)) == ACCEPTED
        assert fly(flight, 8.0).speed_m_s == pytest.approx(2.0, abs=0.1)
    offboard = px4(mode=PX4_OFFBOARD)
    offboard.velocity_target_m_s = np.array([4.0, 0.0])
    assert fly(offboard, 6.0).command(commands.change_speed(1, 2.0)) == ACCEPTED
    assert fly(offboard, 6.0).speed_m_s == pytest.approx(4.0, abs=0.1), "accepted, without effect"
    assert copter(mode=commands.COPTER_LOITER).command(commands.change_speed(1, 2.0)) == FAILED


def test_an_autopilot_that_ignores_commands_or_does_not_follow_them() -> None:
    flight = fly(px4(), 5.0)
    flight.ignores_commands = True
    assert flight.command(commands.set_px4_hold(1)) is None
    flight.ignores_commands, flight.stubborn = False, True
    assert flight.command(commands.set_px4_hold(1)) == ACCEPTED
    assert flight.mode == PX4_MISSION


def test_it_leans_forward_in_flight_and_back_when_it_brakes() -> None:
    flight = fly(copter(), 10.0)
    assert -0.15 < flight.state().euler_rad[1] < -0.03
    flight.command(commands.set_copter_mode(1, commands.COPTER_BRAKE))
    assert fly(flight, 0.8).state().euler_rad[1] > 0.1


NOTHING = np.zeros(2)


@pytest.mark.parametrize("make", [px4, copter])
def test_its_rates_are_those_of_its_attitude_while_it_brakes_and_turns(make: object) -> None:
    """R(t) turned by the body rates for one step is R(t + step), also where roll, pitch and heading change at once."""
    assert callable(make)
    flight = make(5.0, waypoints=np.array([[30.0, 0.0], [30.0, 60.0]]))
    flight.acceptance_m, flight.yaw = 3.0, Yaw.PATH
    worst, fastest = 0.0, 0.0
    for _ in range(800):
        before = flight.state()
        flight.step(0.02)
        now = flight.state()
        rates = np.array(now.rates_frd_rad_s)
        turned = Rotation.from_matrix(before.R_ned_frd.T @ now.R_ned_frd).as_rotvec() / 0.02
        worst, fastest = max(worst, float(np.abs(turned - rates).max())), max(fastest, float(np.abs(turned).max()))
    assert fastest > 0.3
    assert worst < 0.05


def test_its_attitude_carries_its_acceleration() -> None:
    """The thrust along -z of the body, divided by its vertical part and times g, is the acceleration without the drag."""
    flight = fly(px4(5.0), 0.6)
    flight.heading_rad = 0.8
    m = flight.state()
    thrust = -m.R_ned_frd[:, 2]
    lean = flight._acceleration + DRAG_PER_S * flight.velocity_m_s
    assert np.linalg.norm(lean) > 1.0
    np.testing.assert_allclose(thrust[:2] / -thrust[2] * GRAVITY_M_S2, lean, atol=1e-9)


def test_a_steady_wind_leans_the_vehicle_and_does_not_move_it() -> None:
    flight = px4(waypoints=np.zeros((0, 2)))
    flight.wind = Wind(np.array([-5.0, 0.0]), NOTHING)
    fly(flight, 3.0)
    assert flight.speed_m_s < 0.01
    assert flight.state().euler_rad[1] < -0.05


def test_a_gust_moves_the_vehicle_and_ends() -> None:
    flight = copter(waypoints=np.zeros((0, 2)))
    flight.wind = Wind(NOTHING, np.array([0.0, 5.0]), 3.0)
    fastest = max(fly(flight, 0.1).speed_m_s for _ in range(60))
    assert 0.1 < fastest < 1.0
    assert flight.state().velocity_ned_m_s[0] == 0.0


def test_the_way_to_rest_is_longer_with_a_gust_from_behind() -> None:
    calm, pushed = fly(px4(), 8.0), fly(px4(), 8.0)
    pushed.wind = Wind(NOTHING, np.array([5.0, 0.0]), 4.0)
    for flight in (calm, pushed):
        flight.enter(PX4_HOLD)
        fly(flight, 2.0)
    assert pushed.speed_m_s > calm.speed_m_s + 0.1


def test_guided_follows_its_velocity_and_turns_there() -> None:
    flight = copter(mode=COPTER_GUIDED)
    flight.velocity_target_m_s = np.array([0.0, 2.0])
    fly(flight, 6.0)
    assert np.allclose(flight.velocity_m_s, [0.0, 2.0], atol=0.05)
    assert flight.heading_rad == pytest.approx(np.pi / 2, abs=0.05)


def test_the_simulated_autopilot_answers_its_own_commands_alone() -> None:
    flight = copter()
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, system_id=7, armed=True, flight=flight))
    sender = dialect.MAVLink(None, 7, 196)
    now_ns = time.monotonic_ns()
    autopilot.due(now_ns)
    for system, results in ((9, 0), (7, 1)):
        autopilot.receive(bytes(commands.set_copter_mode(system, 17).pack(sender)), now_ns)
        parser = dialect.MAVLink(None)
        sent = [m for data in autopilot.due(now_ns + 1) for m in parser.parse_buffer(data) or []]
        acks = [m for m in sent if m.get_type() == "COMMAND_ACK"]
        assert len(acks) == results
        assert all((m.target_system, m.target_component) == (7, 196) for m in acks)
    assert flight.mode == 17
