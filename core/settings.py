"""The parameters as plain arrays for the kernels of strips.py, by its S_ and I_ indices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import strips as s
from .level import ViewGeometry
from .params import Params


def float_settings(view: ViewGeometry, ke_per_m: float, sigma_d_px: float, p: Params) -> NDArray[np.float64]:
    """(19,) float64."""
    out = np.zeros(19)
    for index, value in (
        (s.S_SIGMA_D, sigma_d_px), (s.S_F, view.f_px), (s.S_HS, p.passable_height_m), (s.S_HD, p.segment_height_m),
        (s.S_ALPHA, p.peak_alpha), (s.S_VALLEY, p.peak_valley), (s.S_MAJORITY, p.window_majority),
        (s.S_ROUGH, 1.0 if p.paper else p.rough_factor), (s.S_QUANTILE, p.near_quantile),
        (s.S_BAND_STEP, p.band_step_m), (s.S_BAND_SIGMAS, p.band_sigmas), (s.S_DEPTH, p.irregular_depth_m),
        (s.S_SAFE, p.safe_distance_m), (s.S_KE, ke_per_m), (s.S_CORRELATION, p.horizontal_correlation),
        (s.S_CENTRE, p.horizontal_centre_px), (s.S_HORIZON, view.cv), (s.S_QUANTUM, view.quantum), (s.S_JUMP, p.irregular_jump),
    ):  # fmt: skip
        out[index] = value
    return out


def int_settings(p: Params) -> NDArray[np.int64]:
    """(7,) int64."""
    out = np.zeros(7, np.int64)
    for index, value in (
        (s.I_WINDOW_MIN, p.window_min_px), (s.I_RANK, p.near_rank), (s.I_BAND_ROWS, p.band_rows),
        (s.I_GAP, p.irregular_gap_px), (s.I_PAPER, int(p.paper)), (s.I_SUPPORT, p.min_support_px),
        (s.I_SUPPORT_COLUMNS, p.support_columns),
    ):  # fmt: skip
        out[index] = value
    return out
