"""A case of the fidelity run and its result."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.fidelity.metrics import RangeCounts, Recall, Score
from benchmarks.fidelity.openings import OpeningSize


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One frame to extract. configured_ke_per_m: the configured noise; faults: a name of
    benchmarks.fidelity.case.FAULTS."""

    scene: str
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    ke_per_m: float
    configured_ke_per_m: float
    height_m: float = 2.0
    seed: int
    faults: str = "all"
    width: int = 640

    @property
    def name(self) -> str:
        """The case as given to `python -m benchmarks.fidelity.run`."""
        configured = "" if self.configured_ke_per_m == self.ke_per_m else f" configured {self.configured_ke_per_m:g}"
        faults = "" if self.faults == "all" else f" faults {self.faults}"
        return (
            f"{self.scene} {self.roll_deg:+.0f}/{self.pitch_deg:+.0f} h {self.height_m:g} "
            f"ke {self.ke_per_m:g}{configured}{faults} seed {self.seed}"
        )


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
    """All figures of one case. bytes: of the prisms, 8 per vertex and 8 per prism, as for the grid's polygons;
    plane_bytes: of the planes alone; false_free: share of the obstacle rays whose truth lies in free space of the
    model."""

    case: Case
    family: str
    valid: bool
    score: Score
    by_range: RangeCounts
    false_free: float
    bytes: int
    plane_bytes: int
    prisms: int
    ground_seen: bool
    ground_height_m: float
    ke_estimate_per_m: float
    grids: list[GridScore]
    openings: list[OpeningSize]
    recall: list[Recall]
