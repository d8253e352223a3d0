"""The yaw of a mount by straight flight: measured, and not invented by hovering or turning."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from functools import lru_cache

import numpy as np
import pytest

from companion.pipeline.mount_messages import mount_text
from companion.pipeline.quaternion import product
from companion.self_check.mount_yaw import MAX_WAITING, MountYaw, MountYawMonitor, add_yaw
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraMount, DepthFrame
from drivers.base import Event
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.flight_path import FlightPath
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scene_library import make_scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info
from osape_client.proto import osape_v1_pb2 as pb
from tests.nightly import nightly

DEG = math.pi / 180.0
SWAY = (0.01, 0.015, 0.005)
AHEAD = CameraMount()
CAMERA = dataclasses.replace(camera_info(240, 180), mount=AHEAD)


def straight(
    scene: str, course_deg: float = 0.0, heading_deg: float = 0.0, speed_m_s: float = 2.0, seconds: float = 6.0
) -> FlightPlan:
    """Flight along a course, with the nose elsewhere where heading_deg differs from it."""
    c, s = math.cos(course_deg * DEG), math.sin(course_deg * DEG)
    rows = [
        [t, c * (speed_m_s * t - 6.0), s * (speed_m_s * t - 6.0), -2.0, 0.0, -0.08, heading_deg * DEG]
        for t in np.arange(0.0, seconds + 1.0)
    ]
    return FlightPlan(name=scene, scene=make_scene(scene, 3), path=FlightPath(rows, sway_rad=SWAY), sensor=TYPICAL)


def flown(plan: FlightPlan, mount: CameraMount = AHEAD) -> tuple[Event, ...]:
    """The events of a flight of this camera."""
    info = dataclasses.replace(CAMERA, mount=mount)
    return tuple(SimulatedFlight(plan, cameras=(info,), seed=1).events())


@lru_cache(maxsize=2)
def flown_straight(scene: str) -> tuple[Event, ...]:
    """The flight that several tests measure, rendered once."""
    return flown(straight(scene))


def measured(events: Iterable[Event], error_deg: float, true: CameraMount = AHEAD) -> MountYaw:
    """The estimate after the flight. error_deg: true minus configured."""
    configured = dataclasses.replace(true, yaw_rad=true.yaw_rad - error_deg * DEG)
    monitor = MountYawMonitor()
    monitor.announce(dataclasses.replace(CAMERA, mount=configured))
    for event in events:
        monitor.event(event)
    (yaw,) = monitor.yaws()
    return yaw


@pytest.mark.parametrize(
    ("scene", "error_deg"),
    [("street", 0.0), ("street", 5.0), ("street", -10.0), *nightly(("trees", 0.0), ("trees", 5.0))],
)
def test_the_yaw_is_measured_in_straight_flight(scene: str, error_deg: float) -> None:
    yaw = measured(flown_straight(scene), error_deg)
    assert yaw.error_rad is not None
    assert yaw.sd_rad is not None
    assert abs(yaw.error_rad / DEG - error_deg) < 3.0 * yaw.sd_rad / DEG
    assert yaw.sd_rad < 1.5 * DEG
    assert yaw.corrected_rad / DEG == pytest.approx(0.0, abs=3.0)
    assert yaw.warns is (error_deg != 0.0)
    assert ("yaw_deg = " in yaw.warning) is yaw.warns


def turning() -> FlightPlan:
    rows = [[t, 0.6 * t - 3.0, 0.0, -2.0, 0.0, 0.0, 1.2 * math.sin(1.2 * t)] for t in range(7)]
    return FlightPlan(name="turning", scene=make_scene("street", 3), path=FlightPath(rows), sensor=TYPICAL)


def test_hovering_and_turning_give_no_value() -> None:
    for plan in (straight("street", speed_m_s=0.0), turning()):
        yaw = measured(flown(plan), 5.0)
        assert yaw.error_rad is None
        assert not yaw.warning


@pytest.mark.parametrize(("apart_ms", "paired"), [(250, True), (450, False)])
def test_images_that_are_far_apart_are_no_pairs(apart_ms: int, paired: bool) -> None:
    """Over half a second an error of the velocity would count as one of the mount."""
    monitor = MountYawMonitor()
    monitor.announce(CAMERA)
    newest_ns = 0
    for event in flown_straight("street"):
        if isinstance(event, DepthFrame):
            if event.t_exposure_ns - newest_ns < apart_ms * 1_000_000:
                continue
            newest_ns = event.t_exposure_ns
        monitor.event(event)
    assert bool(monitor._cameras[CAMERA.camera]._errors_rad) is paired


def test_images_without_an_attitude_do_not_pile_up() -> None:
    monitor = MountYawMonitor()
    monitor.announce(CAMERA)
    for event in flown_straight("street"):
        if not isinstance(event, AttitudeSample):
            monitor.event(event)
    assert 1 <= len(monitor._cameras[CAMERA.camera]._waiting) <= MAX_WAITING


def test_a_side_camera_is_measured_as_well() -> None:
    aside = CameraMount(yaw_rad=90.0 * DEG, pitch_rad=-15.0 * DEG)
    yaw = measured(flown(straight("street"), aside), 5.0, aside)
    assert yaw.error_rad is not None
    assert yaw.error_rad / DEG == pytest.approx(5.0, abs=2.0)


@pytest.fixture(scope="module")
def slow_flight() -> tuple[Event, ...]:
    return flown(straight("street", speed_m_s=1.5, seconds=9.0))


@pytest.mark.parametrize("jumps", [True, False])
def test_a_heading_that_was_corrected_is_no_yaw_of_the_mount(jumps: bool, slow_flight: tuple[Event, ...]) -> None:
    """The autopilot notices by GPS that its heading is 20 degrees wrong, and resets it. What was measured before does not
    describe the mount."""
    events, wrong = slow_flight, quaternion_from_euler(0.0, 0.0, -20.0 * DEG)
    reset_ns = events[0].t_arrival_ns + round(7.5 * 1e9)
    monitor = MountYawMonitor()
    monitor.announce(CAMERA)
    before: MountYaw | None = None
    for event in events:
        if isinstance(event, AttitudeSample):
            if event.t_ns < reset_ns or not jumps:
                event = dataclasses.replace(event, q_ned_frd_wxyz=product(wrong, event.q_ned_frd_wxyz))
            elif before is None:
                (before,) = monitor.yaws()
        monitor.event(event)
    (after,) = monitor.yaws()
    if jumps:
        assert before is not None
        assert before.warns
        assert not after.warns
        assert not after.warning
    else:
        assert after.error_rad == pytest.approx(20.0 * DEG, abs=3.0 * DEG)


def test_small_and_uncertain_errors_give_no_warning() -> None:
    known = MountYaw(camera="front", yaw_rad=0.0, error_rad=4.0 * DEG, sd_rad=1.0 * DEG, pairs=50)
    assert "set yaw_deg = 4.0" in known.warning
    health = pb.MountHealth()
    add_yaw(health, known)
    assert "yaw +4.0 +- 1.0 deg" in mount_text(health)
    assert not dataclasses.replace(known, error_rad=2.0 * DEG).warns
    assert not dataclasses.replace(known, sd_rad=1.4 * DEG).warns
