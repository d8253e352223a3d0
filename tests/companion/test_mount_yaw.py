"""The yaw of a mount by straight flight: measured, and not invented by hovering or turning."""

from __future__ import annotations

import dataclasses
import math

import pytest

from companion.self_check.mount_yaw import MountYaw, MountYawMonitor
from core.types import CameraMount
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.flight_path import FlightPath
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scene_library import make_scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info

DEG = math.pi / 180.0
SWAY = (0.01, 0.015, 0.005)


def straight(scene: str, course_deg: float = 0.0, heading_deg: float = 0.0, speed_m_s: float = 2.0) -> FlightPlan:
    """5 s along a course, with the nose elsewhere where heading_deg differs from it."""
    c, s = math.cos(course_deg * DEG), math.sin(course_deg * DEG)
    rows = [
        [t, c * (speed_m_s * t - 6.0), s * (speed_m_s * t - 6.0), -2.0, 0.0, -0.08, heading_deg * DEG]
        for t in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    ]
    return FlightPlan(name=scene, scene=make_scene(scene, 3), path=FlightPath(rows, sway_rad=SWAY), sensor=TYPICAL)


def measured(plan: FlightPlan, error_deg: float, mount: CameraMount | None = None) -> MountYaw:
    """The estimate after the flight. error_deg: true minus configured."""
    true = mount or CameraMount()
    info = dataclasses.replace(camera_info(320, 240), mount=true)
    flight = SimulatedFlight(plan, cameras=(info,), seed=1)
    configured = dataclasses.replace(true, yaw_rad=true.yaw_rad - error_deg * DEG)
    monitor = MountYawMonitor()
    monitor.announce(dataclasses.replace(info, mount=configured))
    for event in flight.events():
        monitor.event(event)
    (yaw,) = monitor.yaws()
    return yaw


@pytest.mark.parametrize("error_deg", [0.0, 5.0, -10.0])
@pytest.mark.parametrize("scene", ["street", "trees"])
def test_the_yaw_is_measured_in_straight_flight(scene: str, error_deg: float) -> None:
    yaw = measured(straight(scene), error_deg)
    assert yaw.error_rad is not None
    assert yaw.sd_rad is not None
    assert yaw.error_rad / DEG == pytest.approx(error_deg, abs=1.5)
    assert abs(yaw.error_rad / DEG - error_deg) < 3.0 * yaw.sd_rad / DEG
    assert yaw.corrected_rad / DEG == pytest.approx(0.0, abs=1.5)
    assert yaw.warns is (error_deg != 0.0)
    assert ("yaw_deg = " in yaw.warning) is yaw.warns
