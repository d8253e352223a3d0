"""The parameters from tracks to planes as plain numbers for the kernels, by K_ indices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..params import Params

# tracks; ends and near sides of planes; the merge; what stands out; neighbours, pockets, what is hidden
(
    K_HEIGHT_STEP, K_LINE_M, K_LINE_SIGMAS, K_SLOPE, K_ROUGH_SLOPE, K_LINK, K_ROUGHNESS, K_JUMP, K_JUMP_SIGMAS, K_EDGE,
    K_END_T, K_FOOTPRINT_T, K_CUT_T, K_SAFE, K_ALONG, K_NEAR_SIGMAS, K_LEAST_M,
    K_CELL, K_ROUNDS, K_CANDIDATES, K_PARTNERS,
    K_OUT_SHARE, K_OUT_M, K_OUT_SPREADS,
    K_REACH, K_REACH_T, K_SLACK, K_POINTS, K_WS, K_GAP_T, K_GAP_HEIGHT, K_BEHIND, K_HIDDEN, K_HIDDEN_T,
) = range(34)  # fmt: skip


def plane_settings(f_px: float, column_px: float, p: Params) -> NDArray[np.float64]:
    """(34,) float64 for a view of this focal length, whose columns are column_px of its pixels wide."""
    out, column_t = np.zeros(34), column_px / f_px
    for index, value in (
        (K_HEIGHT_STEP, p.height_step_m), (K_LINE_M, p.line_tolerance_m), (K_LINE_SIGMAS, p.line_sigmas),
        (K_SLOPE, p.link_slope_px), (K_ROUGH_SLOPE, p.rough_slope_px), (K_LINK, p.link_gap_px), (K_ROUGHNESS, p.roughness_m),
        (K_JUMP, p.track_jump), (K_JUMP_SIGMAS, p.track_jump_sigmas), (K_EDGE, p.opening_edge_px),
        (K_END_T, (0.5 + p.footprint_px) * column_t), (K_FOOTPRINT_T, p.footprint_px / f_px),
        (K_CUT_T, p.cut_footprint_px / f_px), (K_SAFE, p.safe_distance_m), (K_ALONG, p.safe_along_m),
        (K_NEAR_SIGMAS, p.rough_near_sigmas), (K_LEAST_M, p.min_plane_distance_m),
        (K_CELL, p.evidence_cell_px), (K_ROUNDS, p.merge_rounds), (K_CANDIDATES, p.merge_candidates),
        (K_PARTNERS, p.merge_partners),
        (K_OUT_SHARE, p.stand_out_share), (K_OUT_M, p.stand_out_m), (K_OUT_SPREADS, p.stand_out_spreads),
        (K_REACH, p.meet_share * p.passable_width_m), (K_REACH_T, p.meet_columns * column_t), (K_SLACK, p.meet_slack_m),
        (K_POINTS, p.pocket_points), (K_WS, p.passable_width_m), (K_GAP_T, p.pocket_min_columns * column_t),
        (K_GAP_HEIGHT, p.ground_tolerance_m), (K_BEHIND, p.pocket_behind_m),
        (K_HIDDEN, min(p.covered_depth_m, p.passable_width_m)), (K_HIDDEN_T, p.covered_px * column_t),
    ):  # fmt: skip
        out[index] = value
    return out
