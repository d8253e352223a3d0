"""The parameters as plain arrays for the kernels.

They depend on the parameters, the noise and the view's scale, which seldom change from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..params import Params
from . import strips as s
from .density import BinTable, bin_table
from .merge_cost import merge_rules
from .plane_settings import plane_settings
from .view_geometry import ViewGeometry


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Settings:
    """What the kernels of one view need to know.

    holds_for: by what it was made. strip_floats, strip_ints: by the S_ and I_ indices of strips.py. bins: of disparity. planes, merge:
    by the K_ indices of plane_settings.py and the R_ indices of pairs.py."""

    holds_for: tuple[float, ...]
    strip_floats: NDArray[np.float64]
    strip_ints: NDArray[np.int64]
    bins: BinTable
    planes: NDArray[np.float64]
    merge: NDArray[np.float64]


def settings_of(view: ViewGeometry, ke_per_m: float, p: Params, last: Settings | None) -> Settings:
    """The settings of a view; `last` where they are the same, with only the horizon set anew."""
    column_px = float(view.lateral[0])
    key = (view.f_px, view.quantum, column_px, ke_per_m)
    if last is not None and last.holds_for == key:
        last.strip_floats[s.S_HORIZON] = view.cv
        return last
    sigma_d_px = max(ke_per_m * view.f_px, p.min_sigma_px)
    return Settings(
        holds_for=key, strip_floats=float_settings(view, ke_per_m, sigma_d_px, p), strip_ints=int_settings(p),
        bins=bin_table(view.f_px, view.quantum, sigma_d_px, p), planes=plane_settings(view.f_px, column_px, p),
        merge=merge_rules(view, ke_per_m, p),
    )  # fmt: skip


def float_settings(view: ViewGeometry, ke_per_m: float, sigma_d_px: float, p: Params) -> NDArray[np.float64]:
    """(32,) float64."""
    out = np.zeros(32)
    for index, value in (
        (s.S_SIGMA_D, sigma_d_px), (s.S_F, view.f_px), (s.S_HS, p.passable_height_m), (s.S_HD, p.segment_height_m),
        (s.S_ALPHA, p.peak_alpha), (s.S_VALLEY, p.peak_valley), (s.S_MAJORITY, p.window_majority),
        (s.S_ROUGH, p.rough_factor), (s.S_QUANTILE, p.near_quantile),
        (s.S_BAND_STEP, p.band_step_m), (s.S_BAND_SIGMAS, p.band_sigmas), (s.S_DEPTH, p.irregular_depth_m),
        (s.S_SAFE, p.safe_distance_m), (s.S_KE, ke_per_m), (s.S_CORRELATION, p.horizontal_correlation),
        (s.S_CENTRE, p.horizontal_centre_px), (s.S_HORIZON, view.cv), (s.S_QUANTUM, view.quantum), (s.S_JUMP, p.irregular_jump),
        (s.S_TAKE, p.window_take_sigmas), (s.S_NEAR_SIGMAS, p.near_sigmas), (s.S_NEAR_SHARE, p.near_edge_share),
        (s.S_REST_SIGMAS, p.irregular_sigmas), (s.S_SUPPORT_PER_PX, s.PX * p.min_support_m),
        (s.S_SUPPORT_SIGMAS, p.support_sigmas), (s.S_SUPPORT_RELATIVE, p.support_relative), (s.S_TAIL, p.support_tail_sigmas),
        (s.S_SMOOTH_RELATIVE, p.smooth_relative), (s.S_SMOOTH_SIGMAS, p.smooth_sigmas), (s.S_WS, p.passable_width_m),
        (s.S_LINE_SIGMAS, p.line_sigmas), (s.S_ALIKE_PX, p.noise_alike_px),
    ):  # fmt: skip
        out[index] = value
    return out


def int_settings(p: Params) -> NDArray[np.int64]:
    """(13,) int64."""
    out = np.zeros(13, np.int64)
    for index, value in (
        (s.I_WINDOW_MIN, p.window_min_px), (s.I_RANK, p.near_rank), (s.I_BAND_ROWS, p.band_rows),
        (s.I_GAP, p.irregular_gap_px), (s.I_SUPPORT, p.min_support_px),
        (s.I_SUPPORT_COLUMNS, p.support_columns), (s.I_SUPPORT_ROWS, p.support_rows), (s.I_LARGE, p.support_large),
        (s.I_MEMBERS, p.window_members), (s.I_CUT, p.cut_rows), (s.I_HORIZONTAL, p.horizontal_min_px),
        (s.I_ROOM, p.max_column_strips), (s.I_LINK, p.link_gap_px),
    ):  # fmt: skip
        out[index] = value
    return out
