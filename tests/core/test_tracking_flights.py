"""Random flights with faults, judged against the true scene: nothing measured is lost, and no track is far from a wall."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker
from core.types import FrameModel, FreeEnd

from .tracked import SMALL, STEP
from .worlds import NS, blind, seen

Floats = NDArray[np.float64]
STEADY, MEMORY_S, LOST_MEMORY_S = 12, SMALL.memory_s - 1.0, SMALL.memory_without_position_s - 0.2
"""Observations after which a place is kept for the memory, which is that of the parameters less a frame or two."""
REACH_M = 0.5
EVENTS = ("gap", "reset", "yaw", "position", "clock", "invalid", "masked", "dropped")


def turn(angle_rad: float) -> Floats:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


def random_walls(rng: np.random.Generator) -> Floats:
    """(2 N, 6): walls with both of their sides."""
    rows = []
    for _ in range(rng.integers(4, 10)):
        x, y, angle = rng.uniform(3.0, 25.0), rng.uniform(-8.0, 8.0), rng.uniform(0.0, math.tau)
        half = 0.5 * rng.choice([1.0, 3.0, 8.0])
        dx, dy = half * math.cos(angle), half * math.sin(angle)
        heights = -rng.uniform(1.0, 4.0), rng.uniform(1.0, 2.0)
        rows += [[x - dx, y - dy, x + dx, y + dy, *heights], [x + dx, y + dy, x - dx, y - dy, *heights]]
    return np.array(rows)


def distances(points: Floats, planes: Floats) -> Floats:
    """(P, N) distance of each point to each plane, seen from above."""
    start, along = planes[None, :, 0:2], (planes[:, 2:4] - planes[:, 0:2])[None]
    off = points[:, None] - start
    share = np.clip((off * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-9), 0.0, 1.0)
    return np.asarray(np.linalg.norm(off - share[..., None] * along, axis=-1))


def nearest(points: Floats, planes: Floats) -> Floats:
    """(P,) distance of each point to the nearest plane."""
    return distances(points, planes).min(axis=1) if len(planes) else np.full(len(points), np.inf)


def moved(model: FrameModel, angle_rad: float, offset: Floats) -> FrameModel:
    """The model in axes that are rotated, then shifted."""
    planes = model.planes.astype(np.float64)
    for k in (0, 2):
        planes[:, k : k + 2] = planes[:, k : k + 2] @ turn(angle_rad).T + offset
    edges = (model.free.azimuth_edges_rad + angle_rad).astype(np.float32)
    free = dataclasses.replace(model.free, azimuth_edges_rad=edges)
    return dataclasses.replace(model, planes=planes.astype(np.float32), free=free)


def only(model: FrameModel, kept: NDArray[np.bool_], unmeasured: NDArray[np.bool_]) -> FrameModel:
    """The model with some of its planes, and without a measurement in some directions."""
    free = model.free
    far, end = free.free_to_m.copy(), free.end.copy()
    far[unmeasured], end[unmeasured] = free.free_from_m[unmeasured], int(FreeEnd.UNKNOWN)
    columns = {name: getattr(model, name)[kept] for name in ("planes", "support_px", "margin_m", "flags", "cluster")}
    return dataclasses.replace(model, **columns, free=dataclasses.replace(free, free_to_m=far, end=end))


@dataclass(slots=True, eq=False)
class Flight:
    """A camera in a scene, and the estimate of its pose: estimated = turn(psi_rad) @ true + offset."""

    rng: np.random.Generator
    walls: Floats
    speed_m_s: float
    t_ns: int = 100 * NS
    at: Floats = field(default_factory=lambda: np.zeros(2))
    heading_rad: float = 0.0
    psi_rad: float = 0.0
    offset: Floats = field(default_factory=lambda: np.zeros(2))
    positioned: bool = True
    resets: int = 0
    jumps: tuple[tuple[int, float], ...] = ()

    def step(self, event: str) -> float:
        """Flies on to the next exposure, with an event; returns the seconds that have passed for the tracker."""
        frames = int(self.rng.integers(5, 30)) if event == "gap" else 1
        self.t_ns += frames * STEP
        seconds = frames * STEP / NS
        self.heading_rad += self.rng.uniform(-0.3, 0.3) * seconds
        ahead = np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])
        self.at = self.at + self.speed_m_s * seconds * ahead
        if event == "reset":
            self.offset = self.offset + self.rng.uniform(-20.0, 20.0, 2)
            self.resets += 1
        elif event == "yaw":
            place, jump = self.estimated(), self.rng.uniform(-2.0, 2.0)
            self.psi_rad += jump
            self.offset = place - turn(self.psi_rad) @ self.at
            self.jumps = (*self.jumps, (self.t_ns, jump))
        elif event == "position":
            self.positioned = not self.positioned
        elif event == "clock":
            back = int(self.rng.integers(2, 20)) * NS
            self.t_ns -= back
            self.jumps = tuple((at_ns - back, jump) for at_ns, jump in self.jumps)
            seconds += 1.0
        return seconds

    def estimated(self) -> Floats:
        return turn(self.psi_rad) @ self.at + self.offset

    def observed(self, event: str) -> FrameModel:
        """The model of the frame in true axes."""
        if event == "invalid":
            return blind(self.t_ns).model
        model = seen(
            self.walls, (float(self.at[0]), float(self.at[1])), self.heading_rad, self.t_ns, noise=self.rng
        ).model
        planes, edges = model.planes.astype(np.float64), model.free.azimuth_edges_rad.astype(np.float64)
        middle = 0.5 * (edges[1:] + edges[:-1])
        # where the nearest wall has no plane in this frame, nothing was measured
        reach = model.free.free_to_m[:, :1] + 0.05
        met = self.at + reach * np.stack([np.cos(middle), np.sin(middle)], axis=1)
        unmeasured = (model.free.end[:, 0] == int(FreeEnd.OBSTACLE)) & (nearest(met, planes) > 0.3)
        kept = np.linalg.norm(planes[:, 2:4] - planes[:, 0:2], axis=1) >= 1e-3
        if event == "masked":
            first = self.rng.uniform(edges[0], edges[-1])
            hidden = (middle > first) & (middle < first + 0.4)
            azimuths = np.stack([np.arctan2(planes[:, k + 1] - self.at[1], planes[:, k] - self.at[0]) for k in (0, 2)])
            azimuths = np.remainder(azimuths - self.heading_rad + math.pi, math.tau) - math.pi + self.heading_rad
            kept &= (azimuths.max(axis=0) <= first) | (azimuths.min(axis=0) >= first + 0.4)
            unmeasured = unmeasured | hidden
        return only(model, kept, unmeasured)

    def given(self, model: FrameModel) -> TrackingFrame:
        """The frame as the tracker receives it."""
        x, y = self.estimated() if self.positioned else (0.0, 0.0)
        if model.valid:
            offset = self.offset if self.positioned else -turn(self.psi_rad) @ self.at
            model = moved(model, self.psi_rad, offset)
        at = (float(x), float(y), 0.0)
        return TrackingFrame(
            model=model,
            camera_m=at,
            t_ns=self.t_ns,
            positioned=self.positioned,
            origin_m=at,
            reset_counter=self.resets,
            heading_jumps=self.jumps[-4:],
        )

    def true_planes(self, planes: NDArray[np.float32]) -> Floats:
        """Planes of the tracker's frame in true axes."""
        out, origin = planes.astype(np.float64), self.estimated() if self.positioned else np.zeros(2)
        for k in (0, 2):
            out[:, k : k + 2] = (out[:, k : k + 2] - origin) @ turn(self.psi_rad) + self.at
        return out


@pytest.mark.parametrize("seed", range(6))
def test_random_flights_with_faults(seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    flight = Flight(rng, random_walls(rng), rng.uniform(0.0, 3.0))
    tracker = Tracker(SMALL)
    starts, ends = flight.walls[:, None, 0:2], flight.walls[:, None, 2:4]
    places = (starts + np.linspace(0.1, 0.9, 5)[None, :, None] * (ends - starts)).reshape(-1, 2)
    hits, unseen_s, lost_s = np.zeros(len(places)), np.zeros(len(places)), np.zeros(len(places))
    for k in range(60):
        event = str(rng.choice(EVENTS)) if rng.random() < 0.25 else ""
        passed_s = flight.step(event)
        unseen_s += passed_s
        lost_s += 0.0 if flight.positioned else passed_s
        if event == "dropped":
            continue
        model = flight.observed(event)
        s = tracker.observe(flight.given(model))
        planes, detected = flight.true_planes(s.planes), model.planes.astype(np.float64)
        if len(detected):  # every detection is represented
            middles = 0.5 * (detected[:, 0:2] + detected[:, 2:4])
            assert nearest(middles, planes).max() < REACH_M, (k, event)
        found = nearest(places, detected) < 0.12
        hits[lost_s > 1.0] = 0.0  # ids change without a position, also where this frame finds the place again
        hits[found] += 1.0 if flight.positioned else 0.0
        unseen_s[found], lost_s[found] = 0.0, 0.0
        kept = (hits >= STEADY) & (unseen_s < MEMORY_S) & (lost_s < LOST_MEMORY_S)
        reach = REACH_M + (0.0 if flight.positioned else 0.6) + SMALL.speed_error_m_s * lost_s
        missing = kept & (nearest(places, planes) > reach)
        assert not missing.any(), (k, event, places[missing].tolist())
        if flight.positioned and len(planes):
            middles = 0.5 * (planes[:, 0:2] + planes[:, 2:4])
            assert (nearest(middles, flight.walls) - s.margin_m).max() < REACH_M, (k, event)
