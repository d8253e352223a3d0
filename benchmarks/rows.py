"""What one case of the fidelity run is, and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.metrics import Recall, Score
from benchmarks.openings import OpeningSize


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One frame to be modelled. told_per_m: the noise that the method is told; faults: holes and mismatches
    too."""

    scene: str
    roll_deg: float
    pitch_deg: float
    ke_per_m: float
    told_per_m: float
    height_m: float
    seed: int
    faults: bool = True
    width: int = 640


@dataclass(frozen=True, slots=True, kw_only=True)
class GridScore:
    """The grid baseline on the same frame: storage, and error of the model from noisy and from perfect
    depth."""

    cell_m: float
    planes: int
    bytes: int
    mean_m: float
    perfect_mean_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """All figures of one case. bytes: of the prisms, 8 a vertex and 8 a prism, as the grid's polygons are
    counted; plane_bytes: of the planes alone."""

    case: Case
    family: str
    valid: bool
    score: Score
    bytes: int
    plane_bytes: int
    prisms: int
    ground_height_m: float
    ke_estimate_per_m: float
    grids: list[GridScore]
    openings: list[OpeningSize]
    recall: list[Recall]
