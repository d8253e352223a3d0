"""What differs between two datasets of the same flights, such as those of two versions.

No dataset is the truth. A missed obstacle is one that A has and B has not (or much farther); a phantom is the reverse."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.segment_distance import segment_distance_m
from drivers.base import DeviceNotFound

from .dataset import open_table, read_rows
from .parquet_table import arrow_module

FARTHER_M: Final = 0.5
FARTHER_SHARE: Final = 0.1
"""The nearest plane counts as another where its distance differs by more than the larger of both."""
SAME_PLACE_M: Final = 0.5
"""A plane has a counterpart where its middle is as near as this to a plane of the other dataset that overlaps in height."""
_COLUMNS: Final = (
    "file",
    "camera",
    "sequence",
    "t_exposure_ns",
    "valid",
    "cause",
    "armed",
    "planes",
    "nearest_m",
    "digest",
)
_PLANE_COLUMNS: Final = ("camera", "t_exposure_ns", "a_x_m", "a_y_m", "b_x_m", "b_y_m", "top_m", "bottom_m")

Name = tuple[str, str]
"""Vehicle and flight."""
Floats = NDArray[np.float64]


@dataclass(slots=True)
class FlightDifference:
    """The differences of one flight. Counts are frames unless named otherwise; mean planes are per valid frame."""

    vehicle: str
    flight: str
    frames: int = 0
    only_a: int = 0
    only_b: int = 0
    changed: int = 0
    newly_blind: int = 0
    newly_valid: int = 0
    missed: int = 0  # valid in both, and the nearest plane of A is missing or farther in B
    phantom: int = 0  # the reverse of missed
    planes_a: int = 0
    planes_b: int = 0
    valid_a: int = 0
    valid_b: int = 0
    blind_s_a: float = 0.0
    blind_s_b: float = 0.0
    # missed_planes, phantom_planes: planes of A without counterpart in B, and the reverse; None: a dataset has no table
    # of planes
    missed_planes: int | None = None
    phantom_planes: int | None = None

    @property
    def score(self) -> float:
        """Rank of the flights to look at: share of frames that lost an obstacle or the view, plus a tenth of the share of
        the other changes. A lost obstacle is the more dangerous."""
        lost = self.missed + self.newly_blind + self.only_a
        other = self.phantom + self.newly_valid + self.only_b + self.changed
        return (lost + 0.1 * other) / max(1, self.frames + self.only_a + self.only_b)

    def as_row(self) -> dict[str, Any]:
        """The values by name, with the score."""
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"score": round(self.score, 6)}


@dataclass(slots=True)
class DatasetDifference:
    """All flights of both datasets."""

    flights: list[FlightDifference] = field(default_factory=list)
    # only_a, only_b: flights of one dataset
    only_a: list[Name] = field(default_factory=list)
    only_b: list[Name] = field(default_factory=list)

    @property
    def worst(self) -> list[FlightDifference]:
        """The flights with a difference, the highest score first."""
        ordered = sorted(self.flights, key=lambda f: (-f.score, f.vehicle, f.flight))
        return [flight for flight in ordered if flight.score > 0.0]


@dataclass(frozen=True, slots=True)
class PairedFrames:
    """The frames of one flight that both datasets have, in order of time."""

    a: list[dict[str, Any]]
    b: list[dict[str, Any]]
    kinds: list[str]  # what differs, "" for nothing, or "changed", "missed", "phantom", "newly_blind", "newly_valid"


class Dataset:
    """Reads the tables of a dataset flight by flight."""

    def __init__(self, location: str) -> None:
        self.location = location
        self._fragments = {table: self._by_flight(table) for table in ("frames", "flights")}
        try:
            self._fragments["planes"] = self._by_flight("planes")
        except DeviceNotFound:
            self._fragments["planes"] = {}

    def _by_flight(self, table: str) -> dict[Name, Any]:
        keys = arrow_module("pyarrow.dataset").get_partition_keys
        found = {}
        for fragment in open_table(self.location, table).get_fragments():
            flight = fragment.path.rpartition("/")[2].removesuffix(".parquet")
            found[keys(fragment.partition_expression)["vehicle"], flight] = fragment
        return found

    @property
    def names(self) -> set[Name]:
        """The complete flights."""
        return set(self._fragments["flights"])

    def rows(self, table: str, name: Name, columns: tuple[str, ...]) -> list[dict[str, Any]]:
        """The rows of a flight."""
        fragment = self._fragments[table].get(name)
        return [] if fragment is None else read_rows(fragment, f"{self.location}/{table}", columns)

    def has_planes(self, name: Name) -> bool:
        """Whether the planes of a flight were written."""
        return name in self._fragments["planes"]


def paired_frames(a: Dataset, b: Dataset, name: Name) -> tuple[PairedFrames, int, int]:
    """(frames that both have, number of those that only A has, and only B)."""
    of_a, of_b = ({(r["camera"], r["t_exposure_ns"]): r for r in d.rows("frames", name, _COLUMNS)} for d in (a, b))
    both = sorted(of_a.keys() & of_b.keys(), key=lambda key: (key[1], key[0]))
    pairs = [(of_a[key], of_b[key]) for key in both]
    frames = PairedFrames([p for p, _ in pairs], [q for _, q in pairs], [difference_kind(p, q) for p, q in pairs])
    return frames, len(of_a) - len(both), len(of_b) - len(both)


def difference_kind(a: dict[str, Any], b: dict[str, Any]) -> str:
    """What differs between two rows of the same frame."""
    if a["digest"] == b["digest"]:
        return ""
    if a["valid"] != b["valid"]:
        return "newly_blind" if a["valid"] else "newly_valid"
    if _much_farther(b["nearest_m"], a["nearest_m"]):
        return "missed"
    if _much_farther(a["nearest_m"], b["nearest_m"]):
        return "phantom"
    return "changed"


def _much_farther(far_m: float | None, near_m: float | None) -> bool:
    if near_m is None:
        return False
    return far_m is None or far_m - near_m > max(FARTHER_M, FARTHER_SHARE * near_m)


def compare_flight(a: Dataset, b: Dataset, name: Name) -> FlightDifference:
    """The differences of one flight."""
    frames, only_a, only_b = paired_frames(a, b, name)
    found = FlightDifference(*name, frames=len(frames.kinds), only_a=only_a, only_b=only_b)
    for kind in ("missed", "phantom", "newly_blind", "newly_valid"):
        setattr(found, kind, frames.kinds.count(kind))
    found.changed = sum(kind != "" for kind in frames.kinds)
    found.planes_a, found.planes_b = (sum(r["planes"] for r in rows) for rows in (frames.a, frames.b))
    found.valid_a, found.valid_b = (sum(r["valid"] for r in rows) for rows in (frames.a, frames.b))
    (row_a,), (row_b,) = (d.rows("flights", name, ("blind_s",)) for d in (a, b))
    found.blind_s_a, found.blind_s_b = row_a["blind_s"], row_b["blind_s"]
    if a.has_planes(name) and b.has_planes(name):
        found.missed_planes, found.phantom_planes = _unmatched_planes(a, b, name, frames)
    return found


def _unmatched_planes(a: Dataset, b: Dataset, name: Name, frames: PairedFrames) -> tuple[int, int]:
    """Planes without counterpart in the frames that differ and are valid in both."""
    of_a, of_b = (_planes_by_frame(d.rows("planes", name, _PLANE_COLUMNS)) for d in (a, b))
    none = np.zeros((0, 6))
    missed = phantom = 0
    for row, kind in zip(frames.a, frames.kinds, strict=True):
        if kind in ("changed", "missed", "phantom"):
            key = row["camera"], row["t_exposure_ns"]
            planes_a, planes_b = of_a.get(key, none), of_b.get(key, none)
            missed += unmatched(planes_a, planes_b)
            phantom += unmatched(planes_b, planes_a)
    return missed, phantom


def _planes_by_frame(rows: list[dict[str, Any]]) -> dict[tuple[str, int], Floats]:
    frames: dict[tuple[str, int], list[list[float]]] = {}
    for row in rows:
        frames.setdefault((row["camera"], row["t_exposure_ns"]), []).append([row[c] for c in _PLANE_COLUMNS[2:]])
    return {key: np.array(planes) for key, planes in frames.items()}


def unmatched(planes: Floats, others: Floats) -> int:
    """The number of planes without counterpart. Both (N, 6): a_x, a_y, b_x, b_y, top, bottom."""
    if not len(planes) or not len(others):
        return len(planes)
    middle = 0.5 * (planes[:, None, 0:2] + planes[:, None, 2:4])
    distance_m = segment_distance_m(middle, others[None, :, 0:2], others[None, :, 2:4])
    overlaps = (planes[:, None, 4] < others[None, :, 5]) & (others[None, :, 4] < planes[:, None, 5])
    return int((~((distance_m <= SAME_PLACE_M) & overlaps).any(axis=1)).sum())
