"""`companion doctor --mount` on simulated turns: the configuration's lines, and clear refusals."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest

from companion.config.camera import CameraConfig
from companion.config.loader import Config
from companion.config.service import AutopilotConfig
from companion.doctor.measure_mount import MountMeasurement, finding_of, measured_mounts
from companion.pipeline.mount_messages import mount_lines, mount_text
from companion.pipeline.quaternion import product
from companion.pipeline.sync import SyncParams
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraInfo, CameraMount
from drivers.base import Event
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.flight_path import FlightPath
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scene_library import make_scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info
from osape_client.proto import osape_v1_pb2 as pb
from tests.ports import free_port

TRUE = CameraMount(roll_rad=math.radians(1.0), pitch_rad=math.radians(-12.0))


def by_hand(turn_deg: float, scene: str = "stones", pitch_deg: float = -8.0, seconds: float = 8.0) -> FlightPlan:
    """The vehicle is held 1.2 m above the ground, turned to both sides and tilted."""
    a, p = math.radians(turn_deg) / 2.0, math.radians(pitch_deg)
    rows = [
        [t * seconds, 0.0, 0.0, -1.2, 0.1 * s, p * c, a * s]
        for t, s, c in ((0.0, 0.0, 0.0), (0.25, 1.0, 1.0), (0.5, 0.0, 0.0), (0.75, -1.0, 1.0), (1.0, 0.0, 0.0))
    ]
    return FlightPlan(name="by hand", scene=make_scene(scene, 2), path=FlightPath(rows), sensor=TYPICAL)


INFO = dataclasses.replace(camera_info(160, 120), mount=TRUE)


@functools.cache
def flown(turn_deg: float, scene: str = "stones", pitch_deg: float = -8.0, seconds: float = 8.0) -> tuple[Event, ...]:
    """The events while it is held by hand."""
    plan = by_hand(turn_deg, scene, pitch_deg, seconds)
    return tuple(SimulatedFlight(plan, cameras=(INFO,), seed=3).events())


def measured(events: tuple[Event, ...], configured: CameraMount) -> MountMeasurement:
    info: CameraInfo = dataclasses.replace(INFO, mount=configured)
    measurement = MountMeasurement(info, SyncParams(), CameraConfig(name="front", kind="simulated"))
    for event in events:
        measurement.add(event)
    return measurement


@pytest.mark.parametrize(
    "configured",
    [TRUE, CameraMount(), CameraMount(roll_rad=TRUE.roll_rad, pitch_rad=-TRUE.pitch_rad / 2.0)],
    ids=["right", "none", "sign"],
)
def test_the_lines_to_paste_hold_the_true_mount(configured: CameraMount) -> None:
    finding = finding_of(measured(flown(120.0), configured))
    assert finding.ok is (configured == TRUE)
    assert finding.lines[:2] == ("[[camera]]", 'name = "front"')
    values = {key: float(value) for key, value in (line.split(" = ") for line in finding.lines[2:])}
    assert values["roll_deg"] == pytest.approx(1.0, abs=0.5)
    assert values["pitch_deg"] == pytest.approx(-12.0, abs=0.7)
    assert finding.text.startswith("1.2")


def test_a_mount_without_an_error_has_no_negative_zero() -> None:
    """The lines to paste were roll_deg = -0.0 and pitch_deg = -0.0."""
    measurement = measured((), CameraMount())
    exact = measurement.state.filter
    tiny = dataclasses.replace(exact, mean=(-1e-6, -1e-6, *exact.mean[2:]))
    measurement.state = dataclasses.replace(measurement.state, filter=tiny)
    measurement.heights_m.append(1.2)
    assert measurement.lines()[2:] == ["roll_deg = 0.0", "pitch_deg = 0.0"]
    assert "roll +0.00 +- " in measurement.text()
    health = pb.MountHealth(roll_error_deg=-1e-6, pitch_error_deg=-1e-6, roll_deg=-1e-6, pitch_deg=-1e-6)
    assert mount_lines(health) == "roll_deg = 0.0, pitch_deg = 0.0"
    assert "-0.0" not in mount_text(health)


def test_too_little_turning_is_refused() -> None:
    finding = finding_of(measured(flown(20.0), TRUE))
    assert not finding.ok
    assert not finding.lines
    assert "turn the vehicle" in finding.text


def test_no_ground_is_refused() -> None:
    finding = finding_of(measured(flown(120.0, scene="no_ground"), TRUE))
    assert "ground in only 0 of" in finding.text
    assert not finding.lines


def test_no_frame_is_refused() -> None:
    assert "no frame arrived" in finding_of(measured((), TRUE)).text


def test_frames_without_an_attitude_are_refused() -> None:
    info = camera_info(160, 120)
    measurement = MountMeasurement(info, SyncParams(), CameraConfig(name="front", kind="simulated"))
    flight = SimulatedFlight(by_hand(120.0, seconds=1.0), cameras=(info,))
    frame = flight.frame(0)
    assert frame is not None
    measurement.add(frame)
    assert "attitude" in finding_of(measurement).text


@pytest.mark.parametrize("jump_deg", [0.0, 120.0])
def test_a_jump_of_the_heading_is_no_turn(jump_deg: float) -> None:
    """The vehicle is held still above ground that is inclined by 5 degrees in ned, and the autopilot aligns its heading."""
    measurement = MountMeasurement(INFO, SyncParams(), CameraConfig(name="front", kind="simulated"))
    slope = quaternion_from_euler(0.0, math.radians(5.0), 0.0)
    flight = flown(0.0, pitch_deg=0.0)
    for event in flight:
        if isinstance(event, AttitudeSample):
            late = event.t_ns > (flight[0].t_arrival_ns + flight[-1].t_arrival_ns) // 2
            jump = quaternion_from_euler(0.0, 0.0, math.radians(jump_deg) if late else 0.0)
            event = dataclasses.replace(event, q_ned_frd_wxyz=product(jump, product(slope, event.q_ned_frd_wxyz)))
        measurement.add(event)
    finding = finding_of(measurement)
    assert not finding.lines
    assert "turned by only" in finding.text


def test_it_is_done_when_roll_and_pitch_are_known_well() -> None:
    measurement = measured(flown(160.0, seconds=12.0), TRUE)
    assert measurement.done
    assert not measured(flown(30.0), TRUE).done
    assert measurement.turned_rad > math.radians(100.0)
    assert np.isfinite(measurement.heights_m).all()


def test_without_a_camera_the_configuration_is_named() -> None:
    """It asked to turn the vehicle, and ended without a result and without a cause."""
    config = Config(autopilot=AutopilotConfig(address=f"udpin:127.0.0.1:{free_port()}"))
    said: list[str] = []
    (finding,) = measured_mounts(config, 0.1, said.append)
    assert (finding.ok, said) == (False, [])
    assert "add a [[camera]]" in finding.text
