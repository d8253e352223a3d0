"""Random flights with faults of a vehicle with two cameras, for `random_judge`."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from companion.pipeline.position_sections import PositionSections
from companion.pipeline.transform import LevelTransform, transform_model
from core.types import FrameModel, PoseSample
from core.world.world import Observation

from .random_scene import (
    Box,
    Floats,
    Look,
    look_at,
    model_of,
    turn,
)

NS = 1_000_000_000
STEP_S = 0.1
HEADINGS_RAD = (0.0, 1.1)
MASKS_RAD = ((2.0, 2.0), (-0.3, 0.1))
"""Masked azimuths of the two cameras."""
FAULTS = ("yaw", "position", "gap", "invalid", "late", "repeated")
FAULT_SHARE = 0.05
LATE_FAULTS, LATE_SHARE = ("late", "late", "late", "repeated", "gap", "invalid"), 0.15
"""Of flights among vehicles."""
_ROOM_M = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A frame as it was delivered. p_world = turn(psi_rad) @ p_true + offset_m."""

    look: Look
    model: FrameModel
    psi_rad: float
    offset_m: Floats
    counter: int
    section: int
    t_ns: int
    arrived: list[Floats] = field(default_factory=list)  # planes (6,) in the world that stood in what was free before

    def to_true(self, points: Floats) -> Floats:
        """Returns points (P, 2) of the world in true axes."""
        return np.asarray((points - self.offset_m) @ turn(self.psi_rad))

    def observation(self) -> Observation:
        """Returns what the world receives."""
        x, y = turn(self.psi_rad) @ self.look.at_m + self.offset_m
        model, place = self.model, (float(x), float(y), 0.0)
        if model.valid:
            shift = float(self.offset_m[0]), float(self.offset_m[1]), 0.0
            model = transform_model(model, LevelTransform(self.psi_rad, shift))
        return Observation(model=model, place_m=place, t_ns=self.t_ns, estimate=(self.counter, self.section))


@dataclass(slots=True, eq=False)
class Flight:
    """A vehicle in a scene, and the estimate of its pose."""

    rng: np.random.Generator
    boxes: list[Box]
    duration_s: float
    faults: tuple[str, ...] = FAULTS
    fault_share: float = FAULT_SHARE
    at_m: Floats = field(default_factory=lambda: np.zeros(2))
    heading_rad: float = 0.0
    psi_rad: float = 0.0
    offset_m: Floats = field(default_factory=lambda: np.zeros(2))
    counter: int = 0
    sections: PositionSections = field(default_factory=PositionSections)

    def delivered(self) -> Iterator[tuple[float, Seen]]:
        """Yields (time, frame) in the order of delivery."""
        waiting: list[tuple[float, int, Seen]] = []
        speed, drift_away = self.rng.uniform(0.5, 4.0), self.rng.uniform(0.0, math.tau)
        drift = 0.01 * np.array([math.cos(drift_away), math.sin(drift_away)]) * (self.rng.random() < 0.5)
        bias, rate = self.rng.uniform(-0.01, 0.01), self.rng.uniform(-0.5, 0.5)
        gap_s = late_s = repeated_s = 0.0
        repeated = np.zeros(2)
        number = 0
        for k in range(round(self.duration_s / STEP_S)):
            t_s = k * STEP_S
            if k % 20 == 0:
                rate = self.rng.uniform(-0.6, 0.6)
            step = self._move(t_s, speed, rate)
            self.offset_m = self.offset_m + drift * np.hypot(*step)
            fault = str(self.rng.choice(self.faults)) if k > 10 and self.rng.random() < self.fault_share else ""
            if fault == "yaw":
                place = turn(self.psi_rad) @ self.at_m + self.offset_m
                self.psi_rad += self.rng.choice([-1.0, 1.0]) * self.rng.uniform(0.1, 2.0)
                self.offset_m = place - turn(self.psi_rad) @ self.at_m
                self.counter += 1
            elif fault == "position":
                self.offset_m = self.offset_m + self.rng.uniform(-8.0, 8.0, 2)
            gap_s = t_s + self.rng.uniform(0.3, 5.5) if fault == "gap" else gap_s
            late_s = t_s + self.rng.uniform(0.5, 3.0) if fault == "late" else late_s
            estimated = turn(self.psi_rad) @ self.at_m + self.offset_m
            if fault == "repeated":
                repeated_s, repeated = t_s + self.rng.uniform(0.3, 2.0), estimated
            given = repeated if t_s < repeated_s else estimated
            velocity = turn(self.psi_rad) @ step / STEP_S
            self._position(t_s, given, velocity)
            for camera in (0, 1):
                if t_s < gap_s:
                    continue
                shift = given - estimated + self.rng.normal(0.0, 0.03, 2)
                seen = self._seen(camera, t_s, bias, fault == "invalid", shift)
                late = self.rng.uniform(0.1, 0.9) if camera == 1 and t_s < late_s else 0.02 + 0.03 * camera
                number += 1
                heapq.heappush(waiting, (t_s + late, number, seen))
            while waiting and waiting[0][0] <= t_s:
                due_s, _, seen = heapq.heappop(waiting)
                yield due_s, seen

    def _move(self, t_s: float, speed: float, rate: float) -> Floats:
        self.heading_rad += rate * STEP_S
        for bearing in self.heading_rad + np.array([0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, math.pi]):
            step = speed * STEP_S * np.array([math.cos(bearing), math.sin(bearing)])
            to = (self.at_m + step)[None]
            if np.abs(to).max() < 18.0 and all(b.depth(to, t_s)[0] < -_ROOM_M for b in self.boxes):
                self.at_m = self.at_m + step
                return np.asarray(step)
        return np.zeros(2)

    def _position(self, t_s: float, at_m: Floats, velocity: Floats) -> None:
        place, speed = (float(at_m[0]), float(at_m[1]), 0.0), (float(velocity[0]), float(velocity[1]), 0.0)
        t_ns = round((100.0 + t_s) * NS)
        self.sections.take(PoseSample(t_ns=t_ns, t_arrival_ns=t_ns, position_ned_m=place, velocity_ned_m_s=speed))

    def _seen(self, camera: int, t_s: float, bias: float, invalid: bool, shift_m: Floats) -> Seen:
        heading = self.heading_rad + HEADINGS_RAD[camera]
        look = look_at(self.boxes, self.at_m, heading, t_s, MASKS_RAD[camera])
        model = replace(model_of(look, self.boxes, self.rng, bias), valid=not invalid)
        t_ns = round((100.0 + t_s) * NS) + camera * NS // 1000
        return Seen(look, model, self.psi_rad, self.offset_m + shift_m, self.counter, self.sections.number, t_ns)
