"""Flights: rates against finite differences, order of arrival, determinism, failures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from core.frames import rotation_from_quaternion
from core.types import AttitudeSample, CameraInfo, CameraMount, DepthFrame, PoseSample
from drivers.simulation.flight import Rates, SimulatedFlight
from drivers.simulation.flight_path import FlightPath, body_rates
from drivers.simulation.flights import FLIGHTS, flight_plan
from drivers.simulation.source import camera_info

SMALL = {"width": 64, "height": 48}


def path() -> FlightPath:
    return FlightPath(
        [[0, 0, 0, -2, 0, 0, 0], [1, 1, 2, -3, 0.5, -0.4, 1.0], [3, 4, 2, -2, -0.4, 0.3, 4.0]],
        sway_rad=(0.05, 0.1, 0.2),
    )


@pytest.mark.parametrize("t_s", [0.0, 0.31, 1.0, 1.77, 2.9, 3.5])
def test_body_rates_and_velocity_are_the_derivatives(t_s: float) -> None:
    p, h = path(), 1e-5
    before, now, after = p.at(t_s - h), p.at(t_s), p.at(t_s + h)
    W = now.R_ned_frd.T @ (after.R_ned_frd - before.R_ned_frd) / (2 * h)
    np.testing.assert_allclose((W[2, 1], W[0, 2], W[1, 0]), now.rates_frd_rad_s, atol=2e-4)
    v = (np.array(after.position_ned_m) - np.array(before.position_ned_m)) / (2 * h)
    np.testing.assert_allclose(v, now.velocity_ned_m_s, atol=2e-4)


def test_path_passes_its_waypoints_and_rests_beyond_them() -> None:
    p = FlightPath([[0, 0, 0, -2, 0, 0, 0], [1, 1, 2, -3, 0.5, -0.4, 1.0], [3, 4, 2, -2, 0, 0.3, 4.0]])
    assert p.at(1.0).position_ned_m == pytest.approx((1.0, 2.0, -3.0))
    assert p.at(1.0).euler_rad == pytest.approx((0.5, -0.4, 1.0))
    assert p.at(9.0).position_ned_m == pytest.approx((4.0, 2.0, -2.0))
    assert p.at(9.0).velocity_ned_m_s == (0.0, 0.0, 0.0)


def test_the_path_is_the_librarys_spline_with_its_slopes_and_sways() -> None:
    """At the waypoints, between them, and hovering before and after."""
    rows = [[0, 0, 0, -2, 0, 0, 0], [1, 1, 2, -3, 0.5, -0.4, 1.0], [3, 4, 2, -2, 0, 0.3, 4.0]]
    sway_rad, sway_hz = (0.03, 0.04, 0.02), 0.7
    table = np.array(rows, dtype=np.float64)
    spline = CubicSpline(table[:, 0], table[:, 1:], bc_type="clamped")
    p = FlightPath(rows, sway_rad=sway_rad, sway_hz=sway_hz)
    for t_s in (-0.5, 0.0, 0.4, 1.0, 1.7, 2.999, 3.0, 3.3, *np.linspace(0.0, 3.0, 101).tolist()):
        inside = min(max(t_s, 0.0), 3.0)
        value, slope = spline(inside), spline(inside, 1) if inside == t_s else np.zeros(6)
        turned = 2.0 * math.pi * sway_hz * t_s + 2.0 * math.pi / 3.0 * np.arange(3)
        state = p.at(t_s)
        assert state.position_ned_m == pytest.approx(value[:3], rel=1e-12, abs=1e-12)
        assert state.velocity_ned_m_s == pytest.approx(slope[:3], rel=1e-12, abs=1e-12)
        assert state.euler_rad == pytest.approx(value[3:] + sway_rad * np.sin(turned), rel=1e-12, abs=1e-12)
        rates = slope[3:] + np.array(sway_rad) * 2.0 * math.pi * sway_hz * np.cos(turned)
        assert state.rates_frd_rad_s == pytest.approx(body_rates(state.euler_rad, tuple(rates)), rel=1e-9, abs=1e-9)


def test_body_rates_of_a_pure_yaw_while_pitched() -> None:
    assert body_rates((0.0, math.pi / 2, 0.0), (0.0, 0.0, 1.0)) == pytest.approx((-1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "rows", [[[0, 0, 0, 0, 0, 0, 0]], [[0] * 7, [0] * 7], [[0] * 6, [1] * 6], [[0] * 7, [1] * 6 + [math.nan]]]
)
def test_impossible_paths_are_refused(rows: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="flight path"):
        FlightPath(rows)


@pytest.mark.parametrize("name", list(FLIGHTS))
def test_events_come_in_order_of_arrival_and_are_reproducible(name: str) -> None:
    flight = SimulatedFlight(name, seed=2, duration_s=0.5, **SMALL)
    events, again = list(flight.events()), list(SimulatedFlight(name, seed=2, duration_s=0.5, **SMALL).events())
    arrivals = [e.t_arrival_ns for e in events]
    assert arrivals == sorted(arrivals)
    assert {type(e) for e in events} == {DepthFrame, AttitudeSample, PoseSample}
    assert len(events) == len(again)
    for a, b in zip(events, again, strict=True):
        assert a.t_arrival_ns == b.t_arrival_ns
        if isinstance(a, DepthFrame):
            assert isinstance(b, DepthFrame)
            np.testing.assert_array_equal(a.depth_mm, b.depth_mm)


def test_samples_are_the_true_state_at_their_instant_and_arrive_later() -> None:
    flight = SimulatedFlight("tilted", **SMALL)
    for a in flight.attitudes()[::20]:
        truth = flight.state(a.t_ns)
        np.testing.assert_allclose(rotation_from_quaternion(a.q_ned_frd_wxyz), truth.R_ned_frd, atol=1e-12)
        assert a.rates_frd_rad_s == truth.rates_frd_rad_s
        assert 0.006e9 <= a.t_arrival_ns - a.t_ns <= 0.0121e9
    first = flight.poses()[0]
    assert first.t_ns < flight.start_ns
    assert flight.poses()[-1].t_ns > flight.start_ns + 4.5e9


@pytest.mark.parametrize("name", list(FLIGHTS))
def test_no_flight_comes_near_to_anything(name: str) -> None:
    """Seen all around the vehicle, level, once a second: a camera inside a solid would not see it."""
    flight = SimulatedFlight(name)
    around = tuple(
        CameraInfo(f"{i}", camera_info(64, 48, focal_px=32.0).intrinsics, CameraMount(yaw_rad=i * math.pi / 2))
        for i in range(4)
    )
    for t_s in np.arange(0.0, flight.duration_s + 0.1, 1.0):
        for camera in around:
            truth = flight.truth(camera, flight.start_ns + round(t_s * 1e9))
            assert truth.depth_m[~truth.drawn_ground].min(initial=99.0) > 0.8


def test_tilted_flight_reaches_thirty_degrees() -> None:
    flight = SimulatedFlight("tilted", **SMALL)
    euler = np.array([flight.plan.path.at(t).euler_rad for t in np.linspace(0.0, 4.5, 91)])
    assert np.degrees(euler[:, 0].max()) > 29.0
    assert np.degrees(euler[:, 0].min()) < -29.0
    assert np.degrees(euler[:, 1].min()) < -29.0


def test_broken_flight_fails_as_planned() -> None:
    flight = SimulatedFlight("broken", **SMALL)
    frames = {i: flight.frame(i) for i in range(flight.frame_count())}
    assert [i for i, f in frames.items() if f is None] == [50, 51, 52, 53]
    depth = {i: f.depth_mm for i, f in frames.items() if f is not None}
    assert [i for i, d in depth.items() if not d.any()] == list(range(10, 18))
    assert all(np.array_equal(depth[24], depth[i]) for i in range(25, 32))
    assert not np.array_equal(depth[23], depth[24])
    assert not np.array_equal(depth[31], depth[32])
    stamps = [a.t_ns for a in flight.attitudes()]
    gap = int(np.argmax(np.diff(stamps)))
    assert (stamps[gap + 1] - stamps[gap]) * 1e-9 == pytest.approx(1.02, abs=0.03)


def test_mount_and_lever_arm_move_the_camera() -> None:
    mount = CameraMount(yaw_rad=math.pi / 2, x_m=0.2, z_m=-0.1)
    base = camera_info(64, 48)
    right = type(base)("right", base.intrinsics, mount=mount)
    flight = SimulatedFlight("street", cameras=(base, right))
    t_ns = flight.start_ns
    state = flight.state(t_ns)
    R, at = flight.camera_pose(right, t_ns)
    np.testing.assert_allclose(R[:, 2], state.R_ned_frd[:, 1], atol=1e-12)
    np.testing.assert_allclose(at, np.array(state.position_ned_m) + state.R_ned_frd @ [0.2, 0.0, -0.1])
    frames = [
        e
        for e in SimulatedFlight("street", cameras=(base, right), duration_s=0.2).events()
        if isinstance(e, DepthFrame)
    ]
    assert sorted({f.camera for f in frames}) == ["front", "right"]
    with pytest.raises(ValueError, match="same name"):
        SimulatedFlight("street", cameras=(base, base))


def test_unknown_flight_and_impossible_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="demo"):
        flight_plan("nowhere")
    with pytest.raises(ValueError, match="depth_hz"):
        Rates(depth_hz=0.0)


def test_a_flight_seen_by_rendered_stereo_measures_the_same_scene() -> None:
    """Where the matcher measures, its depth is that of the ray caster; the sky is not measured nearby."""
    flight = SimulatedFlight("street", width=160, height=120, duration_s=0.2, render="stereo")
    frame = flight.frame(0)
    again = SimulatedFlight("street", width=160, height=120, duration_s=0.2, render="stereo").frame(0)
    assert frame is not None
    assert again is not None
    assert np.array_equal(frame.depth_mm, again.depth_mm)
    truth = flight.truth(flight.cameras[0], frame.t_exposure_ns).depth_m
    measured = (frame.depth_mm > 0) & np.isfinite(truth) & (truth < 6.0)
    assert measured.sum() > 500
    off = np.abs(1000.0 / np.maximum(frame.depth_mm, 1)[measured] - 1.0 / truth[measured])
    assert np.median(off) < 0.02
    assert not ((frame.depth_mm > 0) & (frame.depth_mm < 5000))[~np.isfinite(truth)].any()


def test_an_unknown_rendering_is_named() -> None:
    with pytest.raises(ValueError, match="render='photo', expected one of depth, stereo"):
        SimulatedFlight("street", render="photo")
