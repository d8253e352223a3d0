"""Planes of two vehicles in the same scene, to align their frames."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.sharing.alignment import FitResult, fit
from core.sharing.placement import Placement

Floats = NDArray[np.float64]


def street(rng: np.random.Generator, begin_m: float, end_m: float) -> Floats:
    """Planes (N, 6) of facades on both sides with gaps, house corners and masts, cut to a part of the street."""
    world = np.random.Generator(np.random.PCG64(5))
    rows = []
    for side in (-1.0, 1.0):
        x = -20.0
        while x < 80.0:
            length, depth, y = world.uniform(5.0, 13.0), world.uniform(3.0, 8.0), side * world.uniform(6.0, 8.0)
            top = -world.uniform(5.0, 12.0)
            ends = [(x, y), (x + length, y)] if side > 0 else [(x + length, y), (x, y)]
            rows.append((*ends[0], *ends[1], top, 0.0))
            rows.append((x, y + side * depth, x, y, top, 0.0) if side > 0 else (x, y, x, y + side * depth, top, 0.0))
            x += length + world.uniform(1.5, 4.0)
    box = np.array(rows)
    middle = 0.5 * (box[:, 0] + box[:, 2])
    box = box[(middle > begin_m) & (middle < end_m)]
    noise = rng.normal(0.0, 0.05, (len(box), 6))
    return np.asarray(box + noise)


def other_of(true: Placement, box: Floats) -> Floats:
    """Planes of the own frame as the other vehicle has them."""
    back = Placement(
        yaw_rad=-true.yaw_rad, pivot_m=true.at_m, at_m=true.pivot_m, sigma_m=0.0, sigma_z_m=0.0, sigma_yaw_rad=0.0
    )
    return back.boxes(box)


def placed(x: float, y: float, z: float, yaw_rad: float, **sigma: float) -> Placement:
    return Placement(
        yaw_rad=yaw_rad,
        pivot_m=(30.0, 5.0, -3.0),
        at_m=(x, y, z),
        sigma_m=sigma.get("m", 2.1),
        sigma_z_m=sigma.get("z", 2.8),
        sigma_yaw_rad=sigma.get("yaw", 0.05),
    )


def refused(other: Floats, own: Floats, prior: Placement) -> FitResult:
    found = fit(other, own, prior)
    assert found.placement == prior
    return found.result


def one_way(seed: int, ahead: float) -> Floats:
    """Planes (N, 6) of a street with cars, flown along x (ahead = 1) or against it (-1): facades that end where the
    view ends, the sides of cars towards the street, and of their ends those that face the vehicle."""
    world = np.random.Generator(np.random.PCG64([seed, 1]))
    rng = np.random.Generator(np.random.PCG64([seed, 2 + int(ahead)]))
    rows: list[tuple[float, ...]] = []
    for side in (-1.0, 1.0):
        for k in range(5):
            begin, length, y = 10.0 * k - 5.0, world.uniform(6.0, 9.5), side * world.uniform(6.5, 8.0)
            cut = rng.uniform(0.0, 2.0, 2)
            rows.append((begin + cut[0], y, begin + length - cut[1], y, -8.0, 0.0))
    for _ in range(6):
        x, y = world.uniform(0.0, 40.0), world.choice([-1.0, 1.0]) * world.uniform(3.5, 4.8)
        street = y - math.copysign(0.9, y)
        end = x - 2.1 * ahead
        rows += [(x - 2.1, street, x + 2.1, street, -1.5, 0.0), (end, y - 0.9, end, y + 0.9, -1.5, 0.0)]
    box = np.array(rows)
    return np.asarray(box + rng.normal(0.0, 0.05, box.shape))
