"""The demonstration flights by name: a scene, a path through it, a sensor with its faults, and what fails on
the way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from .flight_path import FlightPath
from .scene_library import make_scene
from .scenes import Scene
from .sensor_model import TYPICAL, SensorModel

Span = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Failures:
    """What breaks during a flight, as spans of seconds since its start."""

    blind: tuple[Span, ...] = ()  # every pixel UNKNOWN
    frozen: tuple[Span, ...] = ()  # the camera repeats the image it had when the span began
    no_attitude: tuple[Span, ...] = ()  # no attitude samples
    no_frames: tuple[Span, ...] = ()  # frames that never arrive, their sequence numbers being missing


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FlightPlan:
    """One simulated flight without its camera: where, how, with which faults."""

    name: str
    scene: Scene
    path: FlightPath
    sensor: SensorModel = TYPICAL
    failures: Failures = Failures()


_SWAY = (0.03, 0.04, 0.02)


def _street(seed: int) -> FlightPlan:
    path = FlightPath(
        [[0, -2, 0, -2, 0, 0, 0], [2, 0, 0.3, -2.2, 0, -0.12, 0.05], [4, 4, -0.4, -2.5, 0, 0.08, -0.1]], sway_rad=_SWAY
    )
    return FlightPlan(name="street", scene=make_scene("street", seed), path=path)


def _trees(seed: int) -> FlightPlan:
    path = FlightPath(
        [[0, -1, 0, -2, 0, 0, 0], [2, 1, -1, -2.6, -0.1, -0.08, -0.2], [4, 3, 0.5, -2.4, 0.1, 0, 0.25]], sway_rad=_SWAY
    )
    return FlightPlan(name="trees", scene=make_scene("trees", seed), path=path)


def _alley(seed: int) -> FlightPlan:
    path = FlightPath(
        [[0, -1, 0, -1.6, 0, 0, 0], [2, 1.5, 0.2, -1.8, 0.05, -0.1, 0.1], [4, 5, -0.1, -1.9, 0, 0.05, 0]],
        sway_rad=_SWAY,
    )
    return FlightPlan(name="alley", scene=make_scene("alley", seed), path=path)


def _window(seed: int) -> FlightPlan:
    path = FlightPath(
        [[0, -2, 1, -2, 0, 0, -0.1], [2, 0, 0.5, -2, 0, -0.06, 0], [4, 3, 0, -2.1, 0, 0.04, 0.03]], sway_rad=_SWAY
    )
    return FlightPlan(name="window", scene=make_scene("window", seed), path=path)


def _tilted(seed: int) -> FlightPlan:
    """Roll and pitch to 30 degrees either way."""
    d = math.radians(30.0)
    rows = [[0.0, 0.0, 0.0, -2.5, 0.0, 0.0, 0.0]]
    tilts = ((d, 0.0), (-d, 0.0), (0.0, -d), (0.0, 0.8 * d), (0.7 * d, -0.7 * d))
    for i, (roll, pitch) in enumerate(tilts, start=1):
        rows.append([0.9 * i, 0.3 * i, 0.1 * (-1) ** i, -2.5, roll, pitch, 0.03 * i])
    return FlightPlan(name="tilted", scene=make_scene("mixture", seed), path=FlightPath(rows))


def _by_hand(seed: int) -> FlightPlan:
    """Held 1.2 m above the ground, turned by 60 degrees to both sides and tilted: for `companion doctor --mount`."""
    a, p = math.radians(60.0), math.radians(-8.0)
    rows = [[2.0 * i, 0.0, 0.0, -1.2, 0.1 * s, p * abs(s), a * s] for i, s in enumerate((0.0, 1.0, 0.0, -1.0, 0.0))]
    return FlightPlan(name="by_hand", scene=make_scene("stones", seed), path=FlightPath(rows))


def _broken(seed: int) -> FlightPlan:
    """Large holes throughout; then blind, frozen, without attitude, without frames."""
    path = FlightPath(
        [[0, -1, 0, -2, 0, 0, 0], [3, 1, 0.5, -2.2, 0.1, -0.1, 0.1], [6, 2, 0, -2, -0.1, 0, 0]], sway_rad=_SWAY
    )
    sensor = replace(TYPICAL, holes=25, hole_radius_px=22.0, saturated_share=0.02, dropout_share=0.15)
    failures = Failures(blind=((1.0, 1.8),), frozen=((2.4, 3.2),), no_attitude=((3.6, 4.6),), no_frames=((5.0, 5.4),))
    return FlightPlan(name="broken", scene=make_scene("street", seed), path=path, sensor=sensor, failures=failures)


def _demo(seed: int) -> FlightPlan:
    """Ten seconds along a street with lamps and trees, up to a window."""
    path = FlightPath(
        [
            [0.0, -3.0, 0.0, -1.8, 0.0, 0.0, 0.0],
            [2.0, -0.5, 0.6, -2.2, 0.06, -0.14, 0.06],
            [4.5, 5.0, -0.8, -2.6, -0.14, -0.10, -0.18],
            [7.0, 10.5, 0.5, -2.5, 0.16, -0.06, 0.14],
            [9.0, 14.5, 0.1, -2.2, -0.05, 0.14, 0.0],
            [10.0, 15.3, 0.0, -2.1, 0.0, 0.0, 0.0],
        ],
        sway_rad=_SWAY,
    )
    return FlightPlan(name="demo", scene=make_scene("demo", seed), path=path)


def _movers(seed: int) -> FlightPlan:
    """Six seconds slowly along a street on which two people walk and a car crosses."""
    path = FlightPath(
        [[0, -2, 0, -2, 0, 0, 0], [3, 0, 0.2, -2.1, 0, -0.05, 0.04], [6, 2, 0, -2, 0, 0, 0]], sway_rad=_SWAY
    )
    return FlightPlan(name="movers", scene=make_scene("movers", seed), path=path)


FLIGHTS: dict[str, Callable[[int], FlightPlan]] = {
    "demo": _demo,
    "movers": _movers,
    "street": _street,
    "trees": _trees,
    "alley": _alley,
    "window": _window,
    "tilted": _tilted,
    "by_hand": _by_hand,
    "broken": _broken,
}


def flight_plan(name: str, seed: int = 0) -> FlightPlan:
    """A named flight; the seed also makes its scene. Raises ValueError for a name that does not exist."""
    if name not in FLIGHTS:
        raise ValueError(f"no flight {name!r}; there are: {', '.join(FLIGHTS)}")
    return FLIGHTS[name](seed)
