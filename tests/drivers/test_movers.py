"""Moving solids of the simulator: what the camera sees at a time is the solid at its place then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.frames import R_CAMFRD_OPTICAL
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.movers import moved
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import camera_info, look

INFO = camera_info(96, 72)
AT = np.array([0.0, 0.0, -1.5])


def scene(shift: tuple[float, float, float], velocity: tuple[float, float, float]) -> Scene:
    """One solid of each kind that can move, shifted."""
    s, (x, y, z) = SceneBuilder("kinds"), shift
    s.ground()
    s.velocity_m_s = velocity
    s.box("box", 8.0 + x, -3.0 + y, 1.0, 1.0, 2.0, 0.4, base=-z)
    s.ellipsoid("ball", (7.0 + x, 0.0 + y, -1.5 + z), (0.5, 0.4, 0.6), 0.3)
    s.cylinder("pole", (6.0 + x, 2.0 + y, z), (6.0 + x, 2.2 + y, -3.0 + z), 0.1)
    s.disc("leaf", (5.0 + x, 1.0 + y, -2.0 + z), (-1.0, 0.2, 0.1), 0.3)
    return s.build()


def test_a_moving_solid_is_seen_where_it_is_then() -> None:
    velocity = (0.5, -1.0, -0.2)
    later = look(moved(scene((0.0, 0.0, 0.0), velocity), 1.5), INFO, np.array(R_CAMFRD_OPTICAL), AT)
    there = look(scene((0.75, -1.5, -0.3), (0.0, 0.0, 0.0)), INFO, np.array(R_CAMFRD_OPTICAL), AT)
    np.testing.assert_allclose(later.depth_m, there.depth_m, rtol=1e-9)
    np.testing.assert_array_equal(later.solid, there.solid)


def test_a_static_scene_is_the_same_object_at_any_time() -> None:
    street = make_scene("street", 1)
    assert moved(street, 3.0) is street


def test_a_flight_shows_its_movers() -> None:
    flight = SimulatedFlight("movers", cameras=(INFO,), duration_s=2.0)
    names = flight.plan.scene.names
    places = []
    for t_ns in (flight.start_ns, flight.start_ns + 1_000_000_000):
        truth = flight.truth(INFO, t_ns)
        R, at = flight.camera_pose(INFO, t_ns)
        person = truth.label(flight.plan.scene) == names.index("person across")
        v, u = np.nonzero(person)
        k, z = INFO.intrinsics, truth.depth_m[person]
        rays = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=-1)
        places.append((rays @ R.T + at).mean(axis=0))
    assert places[1][1] - places[0][1] == pytest.approx(1.5, abs=0.15)


def test_an_endless_plane_cannot_move() -> None:
    s = SceneBuilder("slope")
    s.velocity_m_s = (1.0, 0.0, 0.0)
    s.ground(math.tan(0.1))
    with pytest.raises(ValueError, match="endless plane"):
        moved(s.build(), 1.0)


def test_stereo_rendering_refuses_movers() -> None:
    with pytest.raises(ValueError, match="render"):
        SimulatedFlight("movers", cameras=(INFO,), render="stereo")
