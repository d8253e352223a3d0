"""Settings of the kernels from density to planes, as a record with named fields.

Input: the parameters, the noise and the levelled view. Output: `Settings`. They change only with the noise and the
scale of the view, and are reused from frame to frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit import parameter_record, record_of
from ..params import Params
from .density import BinTable, bin_table
from .strips import PX
from .view_geometry import ViewGeometry

_FOOTPRINT_PX = 0.5
"""Extension of the end columns and rows of a plane on either side."""
_SMEAR_FOOTPRINT_PX = 2.0
"""Where ramps are removed, planes are extended by this, because the near side of a ramp is lost."""
_HIDDEN_DEPTH_M = 1.0
"""Greatest distance behind a plane at which it hides others."""
_LONG_WS = 0.5
"""Planes that are both longer than this are merged within plane_angle_deg only, in Ws."""
_GAP_SHARE = 0.9
"""Greatest side of an empty square that a merged plane covers, as a share of Ws or Hs."""
_SMEARED_GAP_M, _SMEARED_NOISE_CAP = 0.9, 8.0
"""join_gap_m and merge_noise_cap of a camera that smears edges."""

VIEW_SETTINGS = parameter_record(
    Params,
    # of the view and its noise
    ("f_px", np.float64),  # focal length
    ("lsb_per_px", np.float64),  # quantised disparity per pixel of disparity
    ("ke_per_m", np.float64),  # noise coefficient
    ("sigma_d_px", np.float64),  # noise of disparity, 1 sigma
    ("column_t", np.float64),  # tangent of a column
    # of strips
    ("noise_alike_px", np.float64),  # of the parameters
    ("support_per_px", np.float64),  # least support in 1/PX source pixels, per pixel of disparity
    # of planes
    ("slope_prior", np.float64),  # weight of a slope of 0
    ("half_column_t", np.float64),  # tangent by which a plane extends beyond the middle of its last column
    ("footprint_t", np.float64),  # tangent by which a strip extends beyond its rows
    ("reach_t", np.float64),  # tangent of `meet_columns`
    ("hidden_depth_m", np.float64),  # _HIDDEN_DEPTH_M, at most Ws
    ("hidden_t", np.float64),  # tangent of `covered_px`
    ("smear_t", np.float64),  # tangent by which planes are extended if ramps were removed (smeared_edges.py), else 0
    # of the merge
    ("noise_cap", np.float64),  # greatest noise allowed, over merge_distance_m
    ("turn", np.float64),  # tangent of the greatest angle between two long pieces
    ("long_m", np.float64),  # length of a long piece
    ("gap_m", np.float64),  # greatest gap between two pieces
    ("sigma_s", np.float64),  # noise of 1/x of a strip with the least support, 1/m
    ("smear_s", np.float64),  # error of 1/x that all pixels of a surface share, for a camera that smears edges, 1/m
)
"""All parameters, and what follows from them for one view and its noise."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Settings:
    """Settings of all kernels for one view."""

    valid_for: tuple[float, ...]  # the values from which the settings were computed
    view: NDArray[Any]  # (1,) VIEW_SETTINGS
    bins: BinTable  # bins of disparity


def settings_of(
    view: ViewGeometry, ke_per_m: float, p: Params, last: Settings | None, smeared: bool = False
) -> Settings:
    """Returns the settings of a view. If `last` is valid for it, returns that.

    Args:
        view: geometry of the levelled view, with pooled columns.
        last: settings of an earlier frame.
        smeared: True if the camera smears its edges and ramps were removed (smeared_edges.py)."""
    key = (view.f_px, view.lsb_per_px, float(view.lateral[0]), ke_per_m, float(smeared))
    if last is not None and last.valid_for == key:
        return last
    settings = view_settings(view, ke_per_m, p, smeared)
    bins = bin_table(view.f_px, view.lsb_per_px, float(settings["sigma_d_px"][0]), p)
    return Settings(valid_for=key, view=settings, bins=bins)


def view_settings(view: ViewGeometry, ke_per_m: float, p: Params, smeared: bool = False) -> NDArray[Any]:
    """Returns (1,) VIEW_SETTINGS; arguments: see `settings_of`."""
    f, column_t = view.f_px, float(view.lateral[0]) / view.f_px
    gap_m = _SMEARED_GAP_M if smeared else p.join_gap_m
    return record_of(
        VIEW_SETTINGS,
        p,
        f_px=f,
        lsb_per_px=view.lsb_per_px,
        ke_per_m=ke_per_m,
        sigma_d_px=max(ke_per_m * f, p.min_sigma_px),
        column_t=column_t,
        support_per_px=PX * p.min_support_m,
        slope_prior=1.0 / (p.link_slope_px * p.link_slope_px),
        half_column_t=(0.5 + _FOOTPRINT_PX) * column_t,
        footprint_t=_FOOTPRINT_PX / f,
        reach_t=p.meet_columns * column_t,
        hidden_depth_m=min(_HIDDEN_DEPTH_M, p.passable_width_m),
        hidden_t=p.covered_px * column_t,
        smear_t=_SMEAR_FOOTPRINT_PX / f if smeared else 0.0,
        noise_cap=_SMEARED_NOISE_CAP if smeared else p.merge_noise_cap,
        turn=math.tan(math.radians(p.plane_angle_deg)),
        long_m=_LONG_WS * p.passable_width_m,
        gap_m=min(gap_m, _GAP_SHARE * p.passable_width_m, _GAP_SHARE * p.passable_height_m),
        sigma_s=max(ke_per_m, p.min_sigma_px / f) / math.sqrt(p.min_support_px),
        smear_s=p.smear_merge_sigmas * ke_per_m if smeared else 0.0,
    )
