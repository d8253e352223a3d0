"""The search for the place of a neighbour's frame: scores on grids around the place by position, and probabilities."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .correlation import Floats, Grid, Scores, scores, thinned, turned
from .placement import Placement
from .samples import PRIOR_SIGMAS, SAMPLE_M, SamplePair

COARSE = Grid(0.4, math.radians(1.0), 0.3)
EVIDENCE_PER_M = 0.5
"""Logarithm of the likelihood per metre of matched samples. Neighbouring samples are not independent: with this value
errors of simulated fits were 0.3 to 0.7 of the computed standard deviation."""


def searched(
    pairs: tuple[SamplePair, ...],
    centre: Floats,
    prior: Placement,
    grid: Grid,
    reach_m: float,
    off: tuple[float, float] = (0.0, 0.0),
) -> Scores:
    """Returns the scores around the place by position, shifted by `off`, in metres of matched samples."""
    turn_rad = turns(prior, grid)
    return scored(pairs, centres(centre, turn_rad, prior) + np.array(off), turn_rad, grid, reach_m)


def scored(pairs: tuple[SamplePair, ...], at: Floats, turn_rad: Floats, grid: Grid, reach_m: float) -> Scores:
    """Returns the scores around places of the centre, (K, 2), each with its rotation, in metres of matched samples."""
    cell_m = max(SAMPLE_M, grid.cell_m)
    found = [scores(p.points[thinned(p.points, cell_m)], at, turn_rad, reach_m, p.own, grid) for p in pairs]
    return replace(found[0], value=cell_m * np.sum([f.value for f in found], axis=0))


def turns(prior: Placement, grid: Grid) -> Floats:
    """Returns the rotations that are searched, (K,)."""
    steps = math.ceil(PRIOR_SIGMAS * prior.sigma_yaw_rad / grid.turn_rad)
    return np.asarray(prior.yaw_rad + np.arange(-steps, steps + 1) * grid.turn_rad, np.float64)


def centres(centre: Floats, turn_rad: Floats, prior: Placement) -> Floats:
    """Returns the place of the centre by position for each rotation, (K, 2)."""
    return np.stack([turned(centre[None], yaw)[0] for yaw in turn_rad.tolist()]) + np.array(prior.at_m[:2])


def log_probability(found: Scores, prior: Placement, off: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Returns the logarithm of the probability of each place, without its constant."""
    x, y = found.shift_m + off[0], found.shift_m + off[1]
    moved = (x[:, None] ** 2 + y[None] ** 2) / prior.sigma_m**2
    rotated = ((found.turn_rad - prior.yaw_rad) / prior.sigma_yaw_rad) ** 2
    return np.asarray(EVIDENCE_PER_M * found.value - 0.5 * moved - 0.5 * rotated[:, None, None])
