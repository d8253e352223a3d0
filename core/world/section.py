"""A section of the merged world: what was observed between two jumps of the position, and its planes as they are saved."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..free_view import FreeView
from .free_grid import FreeTables
from .plane_index import BOX, MOMENTS, Tables, columns
from .serialize import SavedSection
from .update import SAVED_PLANE

NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class RecentFrame:
    """What a frame took from the free space, and its ground."""

    t_ns: int
    observations: NDArray[Any]  # (N,) OBSERVATION
    arrived: NDArray[np.bool_]  # (N,), see free_removal.py
    view: FreeView
    ground: tuple[NDArray[np.float64], NDArray[np.float64]] | None  # ranges from and to which it measured the ground, m


@dataclass(slots=True, kw_only=True)
class Section:
    """Planes and free space observed between two jumps of the position."""

    number: int  # counts up through the sections of this world
    tables: Tables  # planes
    free: FreeTables  # free space
    begun_ns: int  # first frame
    reset_counter: int  # of the position estimate
    newest_ns: int  # newest frame
    place_m: tuple[float, float, float]  # place of the newest frame's camera
    vouched: bool = False  # the section begins with saved planes, and the next frame belongs to it at any position
    estimate: tuple[int, ...] = ()  # that of its frames
    recent: list[RecentFrame] = field(default_factory=list)  # those that may be newer than one that comes late

    @property
    def used_slots(self) -> NDArray[Any]:
        """The slots that were ever in use, SLOT, including empty ones."""
        return self.tables.planes[: int(self.tables.state["used"][0])]

    @property
    def planes(self) -> int:
        """Number of planes."""
        return int(self.tables.state["live"][0])


def saved_section(section: Section) -> SavedSection:
    """Returns the planes of a section, with moments about the middle of each."""
    planes = section.used_slots
    planes = planes[planes["hits"] > 0]
    rows = columns(planes, BOX).astype(np.float64)
    # rounded to centimetres as in the file, so that the moments are about the middle that will be read
    middle = 0.01 * np.rint(50.0 * (rows[:, 0:2] + rows[:, 2:4]))
    ox, oy = (columns(planes, ("anchor_x_m", "anchor_y_m")).astype(np.float64) - middle).T
    w, x, y, xx, xy, yy = (planes[name] for name in MOMENTS)
    moved = (
        w,
        x + w * ox,
        y + w * oy,
        xx + 2 * ox * x + w * ox * ox,
        xy + ox * y + oy * x + w * ox * oy,
        yy + 2 * oy * y + w * oy * oy,
    )
    return SavedSection(
        number=section.number,
        reset_counter=section.reset_counter,
        begun_ns=section.begun_ns,
        newest_ns=section.newest_ns,
        box=rows,
        moments=np.column_stack(moved),
        margin_m=planes["margin_m"].astype(np.float64),
        flags=planes["plane_flags"].astype(np.uint8),
        hits=planes["hits"].copy(),  # a view would keep the whole table
        age_s=(section.newest_ns - planes["seen_ns"]) / NS,
    )


def planes_to_load(section: SavedSection) -> NDArray[Any]:
    """Returns (N,) SAVED_PLANE, the oldest first, with stamps before the first frame."""
    order = np.argsort(-section.age_s, kind="stable")
    out = np.zeros(len(order), SAVED_PLANE)
    for k, name in enumerate(MOMENTS):
        out[name] = section.moments[order, k]
    for k, name in enumerate(BOX):
        out[name] = section.box[order, k]
    out["margin_m"], out["hits"], out["plane_flags"] = (
        section.margin_m[order],
        section.hits[order],
        section.flags[order],
    )
    out["seen_ns"] = np.rint(-section.age_s[order] * NS).astype(np.int64)
    return out
