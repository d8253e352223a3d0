"""One column of a levelled view, ready for the kernels of strips.py."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from core.params import Params
from core.stages import strips as s
from core.stages.irregular import irregular_rest
from core.stages.row_mask import CLOSED, NO_PEAK, gather_rows, mask_remaining_rows
from core.stages.settings import view_settings
from core.stages.view_geometry import ViewGeometry, homography_area
from core.stages.windows import Peak, WindowBuffers, slide_windows

F, QUANTUM = 100.0, 64.0
ROWS = 100


def view(rows: int = ROWS, cols: int = 1, f: float = F) -> ViewGeometry:
    """A level camera whose horizon is the middle row."""
    cu, cv = (cols - 1) / 2, (rows - 1) / 2
    edges = ((np.arange(rows + 1) - 0.5 - cv) / f).astype(np.float32)
    return ViewGeometry(
        cols=cols,
        rows=rows,
        f_px=f,
        cu=cu,
        cv=cv,
        lsb_per_px=QUANTUM,
        tan_edge=edges,
        tan_mid=np.float32(0.5) * (edges[1:] + edges[:-1]),
        lateral=np.ones(rows, np.float32),
        H=np.eye(3),
    )


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
        self.mark = np.full((rows + 7) // 8 * 8, CLOSED, np.uint8)
        self.mark[:rows][self.line > 1] = 0
        self.px = np.zeros((2, rows + 8), np.int32)
        self.buffers = WindowBuffers(
            np.full(rows + 1, -7, np.int64),
            np.full(rows + 1, -7, np.int64),
            np.full(rows, -7, np.int32),
            np.full((3, rows // self.params.band_rows + 2), -7, np.int64),
        )
        self.strips = np.zeros(256, s.STRIP)
        self.strips["support"] = -77
        self.counts = np.zeros(1, s.COUNTS)
        g = view(rows)
        settings = view_settings(g, self.sigma_d_px / F, self.params)
        settings["sigma_d_px"] = self.sigma_d_px  # below min_sigma_px, too
        self.settings = settings[0]
        self.column = s.Column(0, self.line, self.mark, g.H, homography_area(g.H))

    @property
    def out(self) -> s.StripOutput:
        return s.StripOutput(self.strips, self.counts[0])

    @property
    def open(self) -> np.ndarray:
        """(V,) bool: rows with a measurement that no strip has."""
        return self.mark[: len(self.line)] <= NO_PEAK

    def members(self, which: np.ndarray) -> None:
        """Gives the open rows that are True to peak 0, the others to none."""
        self.mark[: len(self.line)] = np.where(self.open, np.where(which, 0, NO_PEAK), self.mark[: len(self.line)])

    @property
    def is_member(self) -> np.ndarray:
        """(V,) bool: rows of peak 0."""
        return self.mark[: len(self.line)] == 0

    @property
    def disparity(self) -> np.ndarray:
        return self.line / QUANTUM

    def ends(self, n: int) -> list[tuple[int, int]]:
        """(top, bottom) of the strips written so far."""
        return [(int(r["top_row"]), int(r["bottom_row"])) for r in self.strips[:n]]

    def windows(self, low_code: float, high_code: float, d: float, rough: bool = False) -> int:
        """slide_windows for label 0; returns the number of strips."""
        self.counts[:] = np.zeros(1, s.COUNTS)
        peak = Peak(0, d, float(low_code), float(high_code), rough)
        slide_windows(self.column, peak, 0, len(self.line) - 1, self.settings, self.buffers, self.out)
        return int(self.counts["strips"][0])

    def gather(self) -> int:
        """Lists the open rows in px; returns their number."""
        mask = np.zeros_like(self.mark)
        mask_remaining_rows(self.mark[: len(self.line)], mask)
        return int(gather_rows(self.line, mask, self.px))

    def rest(self) -> int:
        """irregular_rest; returns the number of strips."""
        self.counts[:] = np.zeros(1, s.COUNTS)
        irregular_rest(self.px, self.gather(), self.column, self.settings, self.out)
        return int(self.counts["strips"][0])
