"""Settings of the kernels from tracks to planes, as a record with named fields."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit import record, record_of
from ..params import Params

_FOOTPRINT_PX = 0.5
"""Extension of the end columns and rows of a plane on either side."""
_SMEAR_FOOTPRINT_PX = 2.0
"""Where ramps are removed, planes are extended by this, because the near side of a ramp is lost."""
_HIDDEN_DEPTH_M = 1.0
"""Greatest distance behind a plane at which it hides others."""

PLANE_SETTINGS = record(
    ("half_column_t", np.float64),  # tangent by which a plane extends beyond the middle of its last column
    ("footprint_t", np.float64),  # tangent by which a strip extends beyond its rows
    ("height_step_m", np.float64),
    ("line_tolerance_m", np.float64),
    ("link_slope_px", np.float64),
    ("safe_distance_m", np.float64),
    ("safe_along_m", np.float64),
    ("rough_near_sigmas", np.float64),
    ("min_plane_distance_m", np.float64),
    ("stand_out_share", np.float64),
    ("stand_out_m", np.float64),
    ("stand_out_spreads", np.float64),
    ("reach_t", np.float64),  # tangent of `meet_columns`
    ("passable_width_m", np.float64),
    ("pocket_behind_m", np.float64),
    ("hidden_depth_m", np.float64),  # _HIDDEN_DEPTH_M, at most Ws
    ("hidden_t", np.float64),  # tangent of `covered_px`
    ("smear_t", np.float64),  # tangent by which planes are extended if ramps were removed (smeared_edges.py), else 0
    ("link_gap_px", np.int64),
    ("merge_rounds", np.int64),
    ("merge_candidates", np.int64),
    ("merge_partners", np.int64),
)
"""Settings of the plane stages. Fields without a comment are the parameters of the same names."""


def plane_settings(f_px: float, column_px: float, p: Params, smeared: bool = False) -> NDArray[Any]:
    """Returns (1,) PLANE_SETTINGS for a view.

    Args:
        f_px: focal length of the view.
        column_px: width of a column in pixels of that focal length.
        p: parameters.
        smeared: True if ramps were removed (smeared_edges.py)."""
    column_t = column_px / f_px
    return record_of(
        PLANE_SETTINGS,
        p,
        half_column_t=(0.5 + _FOOTPRINT_PX) * column_t,
        footprint_t=_FOOTPRINT_PX / f_px,
        reach_t=p.meet_columns * column_t,
        hidden_depth_m=min(_HIDDEN_DEPTH_M, p.passable_width_m),
        hidden_t=p.covered_px * column_t,
        smear_t=_SMEAR_FOOTPRINT_PX / f_px if smeared else 0.0,
    )
