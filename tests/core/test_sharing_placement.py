"""The place of another frame by the origins on Earth, where meridians converge and far from the own origin."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from core.sharing.placement import placement_by_position
from core.sharing.records import LocalFrame

STEP_DEG = 1e-6
Place = tuple[float, float]
"""Latitude and longitude, degrees."""
Projection = Callable[[Place, Place], tuple[float, float]]


def by_px4(origin: Place, place: Place) -> tuple[float, float]:
    """North and east as PX4 computes them: the azimuthal equidistant projection of a sphere (MapProjection of src/lib/geo)."""
    lat0, lon0, lat, lon = np.radians([*origin, *place])
    c = math.acos(min(1.0, math.sin(lat0) * math.sin(lat) + math.cos(lat0) * math.cos(lat) * math.cos(lon - lon0)))
    scale_m = 6_371_000.0 * (c / math.sin(c) if c > 0.0 else 1.0)
    north = math.cos(lat0) * math.sin(lat) - math.sin(lat0) * math.cos(lat) * math.cos(lon - lon0)
    return scale_m * north, scale_m * math.cos(lat) * math.sin(lon - lon0)


def by_ardupilot(origin: Place, place: Place) -> tuple[float, float]:
    """As ArduPilot computes them: degrees times a constant (Location::get_distance_NE)."""
    north, east = (np.radians(place) - np.radians(origin)) * 6_378_100.0
    return float(north), float(east * math.cos(math.radians(0.5 * (origin[0] + place[0]))))


def on_earth(latitude_deg: float, longitude_deg: float, altitude_m: float) -> NDArray[np.float64]:
    """Earth-centred coordinates on the ellipsoid of WGS-84 by its half axes."""
    a, b = 6_378_137.0, 6_356_752.314245
    lat, lon = math.radians(latitude_deg), math.radians(longitude_deg)
    w = math.hypot(a * math.cos(lat), b * math.sin(lat))
    r, z = (a * a / w + altitude_m) * math.cos(lat), (b * b / w + altitude_m) * math.sin(lat)
    return np.array([r * math.cos(lon), r * math.sin(lon), z])


def local(frame: LocalFrame, place: NDArray[np.float64], altitude_m: float) -> tuple[float, float, float]:
    """Coordinates in a frame of an autopilot: north and east by steps along the meridian and the parallel, and the altitude."""
    origin = frame.latitude_deg, frame.longitude_deg, frame.altitude_m
    north = on_earth(origin[0] + STEP_DEG, *origin[1:]) - on_earth(origin[0] - STEP_DEG, *origin[1:])
    east = on_earth(origin[0], origin[1] + STEP_DEG, origin[2]) - on_earth(origin[0], origin[1] - STEP_DEG, origin[2])
    n, e = ((place - on_earth(*origin)) @ axis / np.linalg.norm(axis) for axis in (north, east))
    c, s = math.cos(frame.yaw_rad), math.sin(frame.yaw_rad)
    return c * n + s * e, c * e - s * n, frame.altitude_m - altitude_m


@pytest.mark.parametrize(
    ("own", "other"),
    [
        ((89.99, 0.0, 0.0), (89.99, 90.0, 0.0)),
        ((-89.99, 10.0, 0.5), (-89.995, -100.0, -0.3)),
        ((-17.0, 179.9995, 0.0), (-17.0003, -179.9995, 0.2)),
        ((60.0, 10.0, 0.0), (60.01, 10.06, 1.0)),
        ((0.0, -70.0, 0.0), (0.0005, -70.0, -2.0)),
    ],
    ids=["north pole", "south pole", "antimeridian", "kilometres apart", "equator"],
)
def test_a_point_has_its_place_in_both_frames(
    own: tuple[float, float, float], other: tuple[float, float, float]
) -> None:
    """The axes of frames whose origins are apart differ: the meridians are not parallel."""
    frames = [
        LocalFrame(latitude_deg=lat, longitude_deg=lon, altitude_m=400.0 + 5.0 * k, yaw_rad=yaw)
        for k, (lat, lon, yaw) in enumerate((own, other))
    ]
    place = on_earth(own[0] + 2e-4, own[1] + 1e-4, 420.0)
    vehicle = on_earth(own[0] + 1e-4, own[1], 410.0)
    found = placement_by_position(frames[0], frames[1], local(frames[1], vehicle, 410.0))
    got = found.points(np.array([local(frames[1], place, 420.0)]))[0]
    assert got == pytest.approx(local(frames[0], place, 420.0), abs=0.05)


@pytest.mark.parametrize("own_kind", [by_px4, by_ardupilot])
@pytest.mark.parametrize("other_kind", [by_px4, by_ardupilot])
def test_the_margin_contains_how_autopilots_compute_their_frames(own_kind: Projection, other_kind: Projection) -> None:
    """At the neighbour, with origins that are known exactly. Autopilots of two kinds disagree by a metre per kilometre."""
    rng = np.random.default_rng(1)

    def beside(place: Place, most_m: float) -> Place:
        north, east = np.degrees(rng.uniform(-most_m, most_m, 2) / 6_371_000.0)
        return place[0] + float(north), place[1] + float(east) / math.cos(math.radians(place[0]))

    for k in range(2000):
        own = float(rng.uniform(-70.0, 70.0)), float(rng.uniform(-170.0, 170.0))
        other = beside(own, (0.0, 300.0, 2000.0)[k % 3])
        vehicle = beside(other, (300.0, 1000.0, 2000.0)[k % 5 % 3])
        frames = [
            LocalFrame(latitude_deg=lat, longitude_deg=lon, altitude_m=0.0, sigma_m=0.0) for lat, lon in (own, other)
        ]
        found = placement_by_position(*frames, (*other_kind(other, vehicle), 0.0))
        assert math.dist(found.at_m[:2], own_kind(own, vehicle)) <= 2.0 * found.sigma_m + 0.01


def test_frames_whose_origins_are_far_apart_are_less_certain() -> None:
    """Autopilots compute local coordinates on a sphere: at the equator their metres are wrong by up to 0.7 %."""
    near, far = (
        placement_by_position(
            LocalFrame(latitude_deg=0.0, longitude_deg=20.0, altitude_m=0.0),
            LocalFrame(latitude_deg=north_deg, longitude_deg=20.0, altitude_m=0.0),
            (0.0, 0.0, 0.0),
        )
        for north_deg in (0.0, 0.01)
    )
    assert near.sigma_m == pytest.approx(math.hypot(3.0, 3.0))
    assert 2.0 * math.sqrt(far.sigma_m**2 - near.sigma_m**2) >= 0.0067 * 0.01 * 110_574.0
