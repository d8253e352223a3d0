"""One column of a levelled view, ready for the kernels of strips.py."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from core import strips as s
from core.irregular import irregular_rest
from core.level import ViewGeometry
from core.params import Params
from core.settings import float_settings, int_settings

F, QUANTUM = 100.0, 64.0
ROWS = 100


def view(rows: int = ROWS, cols: int = 1, f: float = F) -> ViewGeometry:
    """A level camera whose horizon is the middle row."""
    cu, cv = (cols - 1) / 2, (rows - 1) / 2
    edges = ((np.arange(rows + 1) - 0.5 - cv) / f).astype(np.float32)
    return ViewGeometry(
        cols=cols, rows=rows, f_px=f, cu=cu, cv=cv, quantum=QUANTUM, tan_edge=edges, lateral=np.ones(rows, np.float32),
        H=np.eye(3),
    )  # fmt: skip


def code(x_m: np.ndarray | float) -> np.ndarray:
    """Codes of forward distances, uint16; not finite: far."""
    x = np.atleast_1d(np.asarray(x_m, float))
    far = ~np.isfinite(x)
    return np.where(far, 1, np.rint(F * QUANTUM / np.where(far, 1.0, x))).astype(np.uint16)


@dataclass
class Column:
    """Distances of the rows of one column with the kernels' scratch memory; nan: unknown, inf: far."""

    x_m: np.ndarray
    sigma_d_px: float = 0.1
    params: Params = field(default_factory=Params)

    def __post_init__(self) -> None:
        rows = len(self.x_m)
        self.line = np.where(np.isnan(self.x_m), 0, code(np.where(np.isnan(self.x_m), 1.0, self.x_m))).astype(np.uint16)
        self.state = np.full(rows, s.FREE_PX, np.uint8)
        self.state[self.line == 0] = s.NONE_PX
        self.state[self.line == 1] = s.FAR_PX
        self.member = np.zeros(rows, np.uint8)
        self.scratch = np.zeros(rows, np.float32)
        self.blocks = np.zeros((3, rows + 2), np.int64)
        self.cuts = np.zeros(64, np.int32)
        self.ints = np.full((256, 9), -77, np.int32)
        self.floats = np.full((256, 3), np.nan, np.float32)
        g = view(rows)
        self.H = g.H
        self.fs = float_settings(g, self.sigma_d_px / F, self.sigma_d_px, self.params)
        self.si = int_settings(self.params)

    @property
    def disparity(self) -> np.ndarray:
        return self.line / QUANTUM

    def ends(self, n: int) -> list[tuple[int, int]]:
        """(top, bottom) of the strips written so far."""
        return [(int(r[s.TOP]), int(r[s.BOTTOM])) for r in self.ints[:n]]

    def windows(self, low_code: float, high_code: float, d: float, rough: bool = False) -> int:
        """slide_windows for label 0; returns the number of strips."""
        return int(
            s.slide_windows(
                self.line, self.state, self.member, 0, d, low_code, high_code, rough, 0, self.H, self.fs, self.si,
                self.scratch, self.blocks, self.cuts, self.ints, self.floats, 0,
            )
        )  # fmt: skip

    def rest(self) -> int:
        """irregular_rest; returns the number of strips."""
        return int(
            irregular_rest(
                self.line, self.state, self.member, 0, self.H, self.fs, self.si, self.scratch, self.ints, self.floats,
                0,
            )
        )  # fmt: skip
