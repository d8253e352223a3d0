"""Settings of the kernels from density to planes, as records with named fields.

Input: the parameters, the noise and the levelled view. Output: `Settings`. They change only with the noise and the
scale of the view, and are reused from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit import record, record_of
from ..params import Params
from .density import BinTable, bin_table
from .merge_cost import merge_rules
from .model import publish_settings
from .plane_settings import plane_settings
from .strips import PX
from .view_geometry import ViewGeometry

STRIP_SETTINGS = record(
    ("sigma_d_px", np.float64),  # noise of disparity, 1 sigma
    ("f_px", np.float64),  # focal length of the view
    ("lsb_per_px", np.float64),  # quantised disparity per pixel of disparity
    ("depth_noise_coeff", np.float64),  # ke, 1/m
    ("noise_alike_px", np.float64),
    ("support_per_px", np.float64),  # least support in 1/PX source pixels, per pixel of disparity
    ("most_per_column", np.float64),  # `max_strips_per_column`
    ("passable_height_m", np.float64),
    ("passable_width_m", np.float64),
    ("safe_distance_m", np.float64),
    ("segment_height_m", np.float64),
    ("peak_alpha", np.float64),
    ("peak_valley", np.float64),
    ("window_majority", np.float64),
    ("window_take_sigmas", np.float64),
    ("near_sigmas", np.float64),
    ("near_edge_share", np.float64),
    ("band_step_m", np.float64),
    ("band_sigmas", np.float64),
    ("irregular_depth_m", np.float64),
    ("irregular_sigmas", np.float64),
    ("support_sigmas", np.float64),
    ("support_relative", np.float64),
    ("support_tail_sigmas", np.float64),
    ("window_min_px", np.int64),
    ("window_members", np.int64),
    ("band_rows", np.int64),
    ("irregular_gap_px", np.int64),
    ("min_support_px", np.int64),
    ("support_columns", np.int64),
    ("support_rows", np.int64),
    ("support_large", np.int64),
    ("cut_rows", np.int64),
    ("max_column_strips", np.int64),
    ("link_gap_px", np.int64),
)
"""Settings of the strip stages. Fields without a comment are the parameters of the same names."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Settings:
    """Settings of all kernels for one view.

    Attributes:
        valid_for: the values from which the settings were computed.
        strips: (1,) STRIP_SETTINGS.
        bins: bins of disparity.
        planes: (1,) PLANE_SETTINGS.
        merge: (1,) MERGE_RULES.
        publish: (1,) PUBLISH_SETTINGS. Its ground and borders are set for each frame."""

    valid_for: tuple[float, ...]
    strips: NDArray[Any]
    bins: BinTable
    planes: NDArray[Any]
    merge: NDArray[Any]
    publish: NDArray[Any]


def settings_of(
    view: ViewGeometry, ke_per_m: float, p: Params, last: Settings | None, smeared: bool = False
) -> Settings:
    """Returns the settings of a view. If `last` is valid for it, returns that.

    Args:
        view: geometry of the levelled view, with pooled columns.
        ke_per_m: noise coefficient.
        p: parameters.
        last: settings of an earlier frame.
        smeared: True if the camera smears its edges and ramps were removed (smeared_edges.py)."""
    column_px = float(view.lateral[0])
    key = (view.f_px, view.lsb_per_px, column_px, ke_per_m, float(smeared))
    if last is not None and last.valid_for == key:
        return last
    sigma_d_px = max(ke_per_m * view.f_px, p.min_sigma_px)
    return Settings(
        valid_for=key,
        strips=strip_settings(view, ke_per_m, sigma_d_px, p),
        bins=bin_table(view.f_px, view.lsb_per_px, sigma_d_px, p),
        planes=plane_settings(view.f_px, column_px, p, smeared),
        merge=merge_rules(view, ke_per_m, p, smeared),
        publish=publish_settings(column_px / view.f_px, p),
    )


def strip_settings(view: ViewGeometry, ke_per_m: float, sigma_d_px: float, p: Params) -> NDArray[Any]:
    """Returns (1,) STRIP_SETTINGS. sigma_d_px: noise of disparity."""
    return record_of(
        STRIP_SETTINGS,
        p,
        sigma_d_px=sigma_d_px,
        f_px=view.f_px,
        lsb_per_px=view.lsb_per_px,
        depth_noise_coeff=ke_per_m,
        support_per_px=PX * p.min_support_m,
        most_per_column=p.max_strips_per_column,
    )
