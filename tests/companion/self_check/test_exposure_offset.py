"""The offset of exposure stamps against the attitude: measured within 3 ms, never invented."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from functools import lru_cache

import pytest

from companion.cameras.worker import with_offset
from companion.live.health import exposure_offset_message
from companion.live.prometheus import metrics_text
from companion.live.status import status_lines
from companion.self_check.exposure_monitor import ExposureOffsetMonitor
from companion.self_check.exposure_offset import ExposureOffset, OffsetState, config_line, warning_text
from core.types import AttitudeSample, CameraInfo, DepthFrame
from drivers.base import Event
from drivers.simulation.flight import Rates, SimulatedFlight
from drivers.simulation.flight_path import FlightPath
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scene_library import make_scene
from drivers.simulation.sensor_model import TYPICAL
from osape_client.proto import osape_v1_pb2 as pb
from tests.nightly import nightly

NS = 1_000_000_000
SECONDS = 20.0
NO_SWAY = (0.0, 0.0, 0.0)


def plan(scene: str, *, turn_rad: float = 0.5, speed_m_s: float = 0.0, sway: bool = True) -> FlightPlan:
    """Turning left and right every 4 s, at a place or forward and back."""
    rows: list[list[float]] = []
    for i in range(round(SECONDS * 8) + 1):
        t = i / 8
        x = -2.0 + speed_m_s * min(t, SECONDS - t)
        rows.append([t, x, 0.0, -2.0, 0.0, 0.0, turn_rad * math.sin(0.5 * math.pi * t)])
    path = FlightPath(rows, sway_rad=(0.03, 0.04, 0.02) if sway else NO_SWAY)
    return FlightPlan(name=scene, scene=make_scene(scene, 0), path=path, sensor=TYPICAL)


@lru_cache(maxsize=2)
def flown(scene: str, hz: float) -> tuple[CameraInfo, tuple[Event, ...]]:
    flight = SimulatedFlight(plan(scene), width=240, height=180, rates=Rates(depth_hz=hz), duration_s=SECONDS)
    return flight.cameras[0], tuple(flight.events())


def late(events: Iterable[Event], late_s: float) -> Iterator[Event]:
    """The events with exposure stamps that are late by so much."""
    for event in events:
        if isinstance(event, DepthFrame):
            yield dataclasses.replace(event, t_exposure_ns=event.t_exposure_ns + round(late_s * NS))
        else:
            yield event


def measured(info: CameraInfo, events: Iterable[Event]) -> ExposureOffset:
    monitor = ExposureOffsetMonitor()
    monitor.announce(info)
    for event in events:
        monitor.event(event)
    (offset,) = monitor.offsets()
    return offset


@pytest.mark.parametrize("late_ms", [-30.0, 5.0, 80.0, *nightly(10.0, 20.0, 40.0)])
@pytest.mark.parametrize(("scene", "hz"), [("street", 12.0), *nightly(("trees", 30.0))])
def test_a_late_camera_is_measured_within_3_ms_in_20_s_and_reported(scene: str, hz: float, late_ms: float) -> None:
    info, events = flown(scene, hz)
    offset = measured(info, late(events, late_ms / 1000.0))
    assert offset.state is OffsetState.MEASURED
    assert offset.offset_s is not None
    assert 1000.0 * offset.offset_s == pytest.approx(late_ms, abs=3.0)
    if abs(late_ms) > 5.0:
        assert offset.warns


@pytest.mark.parametrize(
    ("scene", "hz"), [("street", 12.0), *nightly(("trees", 30.0), ("mixture", 20.0), ("alley", 12.0))]
)
def test_right_stamps_give_no_warning(scene: str, hz: float) -> None:
    monitor = ExposureOffsetMonitor()
    info, events = flown(scene, hz)
    monitor.announce(info)
    for event in events:
        monitor.event(event)
        (offset,) = monitor.offsets()
        assert not offset.warns, offset.text
    assert offset.state is OffsetState.MEASURED


@pytest.mark.parametrize("speed_m_s", [1.0, *nightly(0.0)])
def test_without_turning_nothing_is_measured(speed_m_s: float) -> None:
    still = plan("street", turn_rad=0.0, speed_m_s=speed_m_s, sway=False)
    flight = SimulatedFlight(still, width=160, height=120, rates=Rates(depth_hz=12.0), duration_s=SECONDS)
    offset = measured(flight.cameras[0], late(flight.events(), 0.04))
    assert offset.state is OffsetState.NOT_ENOUGH_MOTION
    assert offset.offset_s is None
    assert not offset.warns
    assert "not measured" in offset.text


def test_without_attitude_nothing_is_measured() -> None:
    info, events = flown("street", 12.0)
    offset = measured(info, (e for e in events if not isinstance(e, AttitudeSample)))
    assert (offset.state, offset.offset_s) == (OffsetState.NO_ATTITUDE, None)


def test_frozen_images_are_not_measured() -> None:
    info, events = flown("street", 12.0)
    first = next(e for e in events if isinstance(e, DepthFrame)).depth_mm
    frozen = (dataclasses.replace(e, depth_mm=first) if isinstance(e, DepthFrame) else e for e in events)
    assert measured(info, frozen).offset_s is None


def test_the_same_events_give_the_same_estimate() -> None:
    info, events = flown("street", 12.0)
    assert measured(info, late(events, 0.02)) == measured(info, late(events, 0.02))


def test_the_pasted_value_removes_the_offset() -> None:
    info, events = flown("street", 12.0)
    wrong = list(late(events, 0.04))
    before = measured(info, wrong)
    assert before.offset_s is not None
    key, value = config_line(before.offset_s, 0.0).split(" = ")
    assert key == "exposure_offset_ms"
    cured = (with_offset(e, float(value)) if isinstance(e, DepthFrame) else e for e in wrong)
    after = measured(info, cured)
    assert after.offset_s is not None
    assert abs(after.offset_s) < 0.002
    assert not after.warns


def test_the_warning_has_the_line_to_paste() -> None:
    offset = ExposureOffset(camera="front", state=OffsetState.MEASURED, offset_s=0.0183, sigma_s=0.0004, pairs=90)
    text = warning_text(offset, 12.0)
    assert "18.3 ms later" in text
    assert "`exposure_offset_ms = 30.3`" in text
    right = dataclasses.replace(offset, offset_s=0.003)
    assert warning_text(right, 12.0) == ""


def test_an_exposure_is_never_after_its_arrival() -> None:
    _, events = flown("street", 12.0)
    frame = next(e for e in events if isinstance(e, DepthFrame))
    assert with_offset(frame, 20.0).t_exposure_ns == frame.t_exposure_ns - 20_000_000
    assert with_offset(frame, -100.0).t_exposure_ns == frame.t_arrival_ns


def test_status_and_metrics_show_it_and_no_value_where_it_is_not_measured() -> None:
    known = ExposureOffset(camera="front", state=OffsetState.MEASURED, offset_s=0.02, sigma_s=0.0004, pairs=90)
    health = pb.Health(cameras=[pb.CameraHealth(camera="front", exposure_offset=exposure_offset_message(known))])
    assert "20.0 ms later" in "\n".join(status_lines(health))
    assert 'osape_camera_exposure_offset_seconds{camera="front"} 0.02' in metrics_text(health)
    unknown = ExposureOffset(camera="front", state=OffsetState.NOT_ENOUGH_MOTION)
    health = pb.Health(cameras=[pb.CameraHealth(camera="front", exposure_offset=exposure_offset_message(unknown))])
    assert "not measured" in "\n".join(status_lines(health))
    assert "exposure_offset" not in metrics_text(health)
