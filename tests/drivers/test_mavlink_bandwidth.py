"""What a line carries: the budget of a slow line, and what waits on it."""

from __future__ import annotations

import pytest

from drivers.mavlink.bandwidth import budget_of
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import MavlinkParams
from drivers.simulation.autopilot import ARDUPILOT, PX4
from drivers.simulation.flight_path import VehicleState

from .conversation import MS, NS, talk


def warning(bytes_per_s: float | None, params: MavlinkParams | None = None, *, signed: bool = False) -> str:
    budget = budget_of(params or MavlinkParams(), bytes_per_s, signed=signed)
    return budget.warning() if budget is not None else ""


def test_a_slow_line_is_reported_with_the_rate_that_would_fit() -> None:
    assert warning(None) == ""
    assert warning(92_160.0) == ""
    text = warning(5_760.0)
    assert "the line of 57600 baud carries 5760 bytes/s" in text
    hz = int(text.rsplit("attitude_hz = ", 1)[1])
    assert 10 < hz < 40
    assert "attitude_hz" not in warning(5_760.0, MavlinkParams(attitude_hz=float(hz)))


@pytest.mark.parametrize("params", [MavlinkParams(attitude_hz=10, position_hz=5), MavlinkParams(attitude_hz=50)])
def test_a_line_below_230400_baud_is_reported_even_where_all_fits(params: MavlinkParams) -> None:
    assert "set 921600 baud" in warning(11_520.0, params)
    assert warning(23_040.0, params) == ""


def test_what_we_send_and_its_signatures_count() -> None:
    quiet, telling = (
        MavlinkParams(attitude_hz=5, position_hz=1),
        MavlinkParams(attitude_hz=5, position_hz=1, obstacles_hz=20),
    )
    budgets = [budget_of(p, 5_760.0, signed=s) for p, s in ((quiet, False), (telling, False), (telling, True))]
    out = [b.need_out for b in budgets if b is not None]
    assert out[1] - out[0] == pytest.approx(20 * (167 + 12))
    assert out[2] > out[1] + 20 * 13
    assert "each way" in warning(5_760.0, telling)


def test_points_and_distances_up_and_down_count_too() -> None:
    around = MavlinkParams(obstacles_hz=10)
    points = MavlinkParams(obstacles_hz=10, obstacle_points=30, distance_sensors=2)
    a, b = (budget_of(p, 92_160.0) for p in (around, points))
    assert a is not None
    assert b is not None
    assert b.need_out - a.need_out == pytest.approx(10 * (30 * (28 + 12) + 2 * (39 + 12) - (167 + 12)))


def test_messages_between_vehicles_count_in_both_directions() -> None:
    alone, team = MavlinkParams(), MavlinkParams(tunnel_bytes_per_s=300.0, neighbours=2)
    a, b = (budget_of(p, 92_160.0) for p in (alone, team))
    assert a is not None
    assert b is not None
    assert (b.need_in - a.need_in, b.need_out - a.need_out) == pytest.approx((600.0, 300.0))


def test_of_scans_of_points_and_of_distances_the_newest_alone_waits() -> None:
    """A scan is sent whole; an older one is outdated, whichever message it was sent in."""
    c = talk(ARDUPILOT)
    c.run(2.0)
    session = c.session

    def point(time_ms: int, x_m: float) -> None:
        session.post(
            dialect.MAVLink_obstacle_distance_3d_message(time_ms, 4, 12, 65535, x_m, 0.0, 0.0, 0.2, 12.0), c.now_ns
        )

    def sensor(orientation: int, cm: int) -> None:
        session.post(dialect.MAVLink_distance_sensor_message(0, 20, 1200, cm, 4, 1, orientation, 255), c.now_ns)

    session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
    for scan in range(3):
        for k in range(100):
            point(scan, 1.0 + scan + k / 100)
        sensor(24, 250 + scan)
        sensor(25, 150 + scan)
    c.run(0.1)
    autopilot = c.autopilots[0]
    points = autopilot.of_kind("OBSTACLE_DISTANCE_3D")
    assert [m.time_boot_ms for m in points] == [2] * 100
    assert [round(m.x, 2) for m in points] == [round(3.0 + k / 100, 2) for k in range(100)]
    assert [m.current_distance for m in autopilot.of_kind("DISTANCE_SENSOR")] == [252, 152]
    assert autopilot.of_kind("OBSTACLE_DISTANCE") == []


def test_the_budget_holds_what_a_line_carries() -> None:
    """The bytes that a session has sent to it and sends, against the figures."""
    some = (0.1, 0.2, 0.3)  # zeros at the end of a message are not sent
    moving = VehicleState(position_ned_m=some, velocity_ned_m_s=some, euler_rad=some, rates_frd_rad_s=some)
    c = talk(PX4, MavlinkParams(obstacles_hz=10.0), streams={}, boot_at_ns=90 * NS, motion=lambda _: moving)
    c.run(5.0)
    sent_before, received = len(b"".join(c.sent)), 0
    for step in range(1000):
        if step % 100 == 0:
            c.session.post(
                dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns
            )
        c.now_ns += MS
        chunks = [(d, c.now_ns) for d in c.autopilots[0].due(c.now_ns)]
        received += sum(len(d) for d, _ in chunks)
        c.session.receive(chunks)
        for data in c.session.due(c.now_ns):
            c.sent.append(data)
            c.autopilots[0].receive(data, c.now_ns)
    budget = c.session.budget(92_160.0)
    assert budget is not None
    assert 0.75 * budget.need_in < received <= budget.need_in
    assert 0.5 * budget.need_out < len(b"".join(c.sent)) - sent_before <= budget.need_out
