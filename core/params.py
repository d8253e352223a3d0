"""Every constant of the algorithm: a name, a default, a range, a unit and what it means.

Symbols in brackets are the paper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .param_field import check, critical, number, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class Params:
    """Parameters of the extractor. Raises ValueError naming the field, its value and its range."""

    # The vehicle and what counts as an obstacle
    min_obstacle_height_m: float = critical(0.6, 0.05, 3.0, "m", "least height of an obstacle [Hm]")
    passable_height_m: float = critical(1.0, 0.2, 10.0, "m", "least height the vehicle passes [Hs]")
    passable_width_m: float = critical(2.0, 0.2, 20.0, "m", "least width the vehicle passes [Ws]")
    segment_height_m: float = number(2.0, 0.2, 10.0, "m", "height of segments of irregular things [Hd]")
    safe_distance_m: float = critical(
        0.28, 0.05, 1.0, "m", "most that a plane may lie behind the near edge of what it stands for"
    )

    # Noise: sigma_Z = ke * Z^2, constant in disparity
    estimate_noise: bool = switch(
        True, "measure the noise from each frame; the camera's ke is then a prior", safety=True
    )
    noise_prior_span: float = critical(4.0, 1.0, 10.0, "", "the measured ke stays within prior/span .. prior*span")
    noise_memory: float = critical(0.7, 0.0, 0.99, "", "share of the previous estimate kept at each frame")
    min_sigma_px: float = critical(0.1, 0.01, 2.0, "px", "disparity noise is never taken for less")
    noise_tiles_down: int = number(6, 1, 32, "", "rows of tiles of the picture, each with a noise of its own")
    noise_tiles_across: int = number(8, 1, 32, "", "and columns of them")
    noise_short_step_px: int = number(
        8, 1, 64, "px", "step of the second difference that detects motion, at 640 columns"
    )
    noise_step_px: int = number(
        16, 1, 64, "px", "step of the second difference whose median is a tile's noise, at 640 columns"
    )
    noise_row_step: int = number(6, 1, 32, "px", "rows from one to the next that is looked at")
    noise_min_samples: int = number(120, 10, 10000, "", "differences that a tile needs to count")
    noise_min_tiles: int = number(3, 1, 1024, "", "least number of tiles for a noise estimate")
    noise_min_depth_m: float = number(
        1.5, 0.0, 20.0, "m", "pixels closer than this do not count: millimetre steps outweigh their noise"
    )
    noise_quantile: float = number(0.25, 0.0, 1.0, "", "quantile of the tiles that is the picture's noise")
    noise_agree_share: float = number(
        0.2,
        0.0,
        1.0,
        "",
        "the noise goes up only where so many of all tiles agree with that: leaves do not, surfaces do",
    )
    noise_agree_ratio: float = number(1.25, 1.01, 3.0, "", "which is to be at most this much greater or less")
    noise_prior_share: float = critical(
        0.6, 0.05, 1.0, "", "least share of the camera's ke in use before the noise has been measured over time"
    )
    noise_time_frames: int = critical(3, 1, 100, "", "frames between two whose difference over time is measured")
    noise_time_min_samples: int = critical(24, 2, 64, "", "sampled pixels that a tile needs for that, of 64")
    noise_time_quantile: float = critical(0.5, 0.0, 1.0, "", "quantile of the tiles that is the noise over time")
    noise_still_errors: float = critical(
        4.0, 1.0, 20.0, "", "a tile is still where its median differs by at most this many standard errors"
    )
    noise_still_ratio: float = critical(
        2.0, 1.0, 10.0, "", "noise over time above this times that of the short step in the image is motion"
    )
    noise_still_share: float = critical(
        0.75, 0.0, 1.0, "", "the camera stands still where this share of the tiles is still"
    )
    noise_grid: float = number(0.05, 0.001, 0.5, "", "the noise in use moves in steps of this share")
    noise_hold: float = number(0.75, 0.5, 2.0, "", "and stays while the estimate is within this much of a step")
    noise_length_px: float = critical(
        9.0, 0.0, 64.0, "px", "distance over which the correlation of the noise falls to 1/e (0: independent pixels)"
    )
    clear_sigmas: float = critical(
        3.0, 0.0, 8.0, "sigma", "what measures closer to the range clip than this is far; far is free up to there only"
    )

    # Levelling
    max_tilt_deg: float = critical(
        60.0,
        10.0,
        75.0,
        "deg",
        "greatest angle of the optical axis from the horizontal; beyond it the frame is invalid",
    )
    max_elevation_deg: float = critical(
        74.0, 30.0, 80.0, "deg", "rays steeper than this have no column and are unknown"
    )
    max_view_ratio: float = number(2.0, 1.0, 4.0, "", "cells of the levelled view per source pixel, at most")
    column_step: int = critical(1, 1, 16, "", "columns pooled into one [sampling interval]")
    column_agree_sigmas: float = critical(
        2.0,
        0.0,
        10.0,
        "sigma",
        "pooled columns that differ by less are one surface: their mean counts, else the nearest",
    )
    min_measured_share: float = critical(
        0.02, 0.0, 0.5, "", "least share of measured or far pixels; with fewer the frame is invalid"
    )

    # Flying pixels: strictly between two neighbours in disparity, far from both
    flying_relative: float = critical(0.08, 0.01, 0.5, "", "least step to both neighbours, as a share of the disparity")
    max_flying_share: float = critical(
        0.03, 0.005, 1.0, "", "with more of the measured pixels flying the image is noise, no measurement"
    )
    flying_sigmas: float = critical(5.0, 1.0, 20.0, "sigma", "and least step in noise")

    # Smeared edges: ramps of disparity between a near and a far surface, of a camera whose edges are all like that
    smear_span_px: int = number(
        4, 1, 32, "px", "a pixel of a ramp lies between those this far to either side, at 640 columns"
    )
    smear_reach_px: int = number(
        24, 2, 128, "px", "a ramp ends within this towards its near side, at 640 columns; a surface at a slant goes on"
    )
    smear_straight_share: float = number(
        0.67, 0.1, 1.0, "", "over that reach a ramp keeps at most this share of its slope"
    )
    smear_passing_m: float = critical(
        1.0, 0.1, 20.0, "m", "a ramp is so steep that it would pass the camera nearer than this if it went on"
    )
    smear_incidence_deg: float = critical(
        80.0, 45.0, 89.0, "deg", "and so steep that a surface would be seen at more than this from its normal"
    )
    smear_sigmas: float = number(2.0, 0.0, 10.0, "sigma", "and rises by more than this much noise on each side")
    smear_judged_sigmas: float = number(
        5.0,
        0.0,
        20.0,
        "sigma",
        "ramps by which it is judged whether the camera smears rise by more than this much noise",
    )
    smear_min_share: float = critical(
        0.7, 0.0, 1.0, "", "a camera smears where more than this share of its edges are ramps (1: never)"
    )
    smear_min_edges: float = number(
        60.0, 1.0, 10000.0, "", "a frame with fewer edges in every fourth row, at 480 rows, does not count for that"
    )
    smear_memory: float = number(0.9, 0.5, 0.999, "", "share of the judgement so far that is kept at each frame")
    smear_min_frames: int = number(
        5, 2, 30, "frames", "frames with enough edges by whose mean share of ramps a camera is judged"
    )
    smear_clear_share: float = critical(
        0.8, 0.0, 1.0, "", "in fewer frames a camera smears where more than this share of its edges are ramps"
    )
    smear_clear_edges: float = number(
        100.0, 1.0, 10000.0, "", "and the frame has at least so many edges in every fourth row, at 480 rows"
    )
    smear_footprint_px: float = number(
        2.0,
        0.0,
        10.0,
        "px",
        "what the ends of planes are extended by where ramps are taken out: the near side of each is lost",
    )
    smear_merge_sigmas: float = number(
        2.5, 0.0, 6.0, "sigma", "noise of one pixel that the merge grants besides where edges are smeared"
    )
    smear_noise_cap: float = number(
        8.0,
        0.0,
        20.0,
        "",
        "and there noise allows at most this many times merge_distance_m more, in place of merge_noise_cap",
    )
    smear_join_gap_m: float = number(
        0.9, 0.1, 3.0, "m", "and a joined plane covers no empty square of this side, in place of join_gap_m"
    )
    smear_empty_share: float = number(
        0.2, 0.0, 1.0, "", "and at most this share of it may be empty, in place of merge_empty_share"
    )

    # Noise in a part of the picture: pixels alone, unlike each of their neighbours
    noisy_look_share: float = critical(
        0.003, 0.0, 1.0, "", "with more of the measured pixels flying, noise is looked for"
    )
    noisy_tiles: int = critical(16, 1, 64, "", "in so many tiles across and down")
    noisy_judged_share: float = critical(
        0.25, 0.01, 1.0, "", "a tile counts with so many of its pixels amid measured ones"
    )
    noisy_alone_share: float = critical(
        0.25, 0.05, 1.0, "", "and is noise where more than this share of those are alone"
    )
    max_noisy_share: float = critical(
        0.04, 0.0, 1.0, "", "greatest share of tiles that are noise; with more the frame is invalid"
    )

    # Ground
    ground_tolerance_m: float = critical(0.25, 0.03, 1.0, "m", "least half-thickness of the ground")
    ground_sigmas: float = critical(4.0, 1.0, 8.0, "sigma", "half-thickness in noise of height, sigma_h = ke*X*h")
    ground_tolerance_cap: float = critical(
        0.9, 0.3, 1.0, "", "half-thickness is at most this share of the least obstacle height"
    )
    ground_stand_sigmas: float = critical(
        6.0,
        1.0,
        20.0,
        "sigma",
        "beyond that cap a strip must stand out of the ground's noise by this, all rows together",
    )
    ground_stand_m: float = critical(0.1, 0.0, 1.0, "m", "after this much error of the ground's height")
    ground_max_below_share: float = critical(
        0.05, 0.0, 0.3, "", "reject a ground with more of the measured pixels below it"
    )
    ground_min_share: float = critical(0.01, 0.001, 0.5, "", "least share of the sampled pixels that must vote for it")
    ground_max_slope: float = critical(0.06, 0.0, 0.3, "m/m", "steepest surface still called ground")
    ground_max_height_m: float = number(60.0, 1.0, 200.0, "m", "greatest height of the camera above ground considered")
    ground_min_height_m: float = number(0.04, 0.02, 1.0, "m", "and the least")
    ground_height_step: float = number(
        0.04, 0.005, 0.3, "", "heights are voted for in steps of this share: noise of height grows with height"
    )
    ground_column_step: int = number(5, 1, 64, "px", "columns from one sampled pixel to the next")
    ground_row_step: int = number(3, 1, 64, "px", "rows from one sampled pixel to the next")
    ground_max_samples: int = number(6000, 1000, 1000000, "", "larger pictures are sampled in larger steps than those")
    ground_min_samples: int = number(50, 10, 10000, "", "sampled pixels without which no ground is looked for")
    ground_pair_climb: float = number(
        0.2, 0.02, 1.0, "", "rows of a pair: a wall there would climb this share of the camera's height"
    )
    ground_pair_climb_min_m: float = number(0.08, 0.01, 1.0, "m", "but at least this much")
    ground_pair_climb_max_m: float = number(2.0, 0.1, 20.0, "m", "and at most this much")
    ground_pair_min_px: int = number(4, 1, 100, "px", "least rows of a pair")
    ground_pair_parts: int = number(3, 1, 20, "", "greatest rows of a pair: the picture's over this")
    ground_pair_flat: float = number(0.25, 0.0, 1.0, "", "a pair votes when it climbs less than this share of a wall's")
    ground_pair_sigmas: float = number(2.0, 0.0, 8.0, "sigma", "and this much of its noise of height")
    ground_pair_flat_cap: float = number(0.5, 0.0, 1.0, "", "which together are at most this share of a wall's climb")
    ground_pair_level: float = number(
        0.5, 0.0, 1.0, "", "its farther pixel lies at least this share as low as the other"
    )
    ground_seed_weight: float = number(1.5, 1.0, 10.0, "", "votes near the last frame's height count this much")
    ground_seed_steps: int = number(2, 0, 20, "", "steps of height on either side that are near it")
    ground_tries: int = number(6, 1, 50, "", "heights that are tried, from the most voted on")
    ground_fit_rounds: int = number(4, 1, 20, "", "rounds of the fit, each with the pixels near the one before")
    ground_fit_sigmas: float = number(
        2.0,
        1.0,
        4.0,
        "sigma",
        "where noise exceeds that cap, a fit takes pixels up to this far off, and those beyond are below",
    )
    ground_recede_share: float = number(
        0.2, 0.0, 1.0, "", "least of what ground recedes from row to row that its pixels must: those of a wall do not"
    )
    ground_recede_noise: float = number(
        0.1, 0.0, 1.0, "", "with noise of height below this share of what a wall would climb, a pair's vote is sure"
    )
    ground_fit_min_px: int = number(20, 3, 10000, "", "sampled pixels that a fit needs")
    ground_fit_floor_m: float = number(
        0.02, 0.001, 1.0, "m", "added to a pixel's noise in its weight: near pixels do not rule alone"
    )
    ground_slope_prior: float = number(
        0.0175, 0.001, 1.0, "m/m", "slope expected beforehand: a narrow patch of ground does not tilt the fit"
    )
    ground_below_m: float = number(
        0.1, 0.0, 1.0, "m", "below the ground is what lies lower than its tolerance and this"
    )
    ground_below_full_m: float = number(
        5.0, 0.1, 50.0, "m", "height of the camera at which half of that is granted; near the ground less is"
    )

    # Density and peaks
    bin_per_sigma: float = number(1.25, 0.5, 4.0, "", "bins per sigma of disparity noise")
    bin_depth_m: float = number(0.03, 0.0, 0.5, "m", "a bin is never thinner than this in depth (0: uniform bins)")
    kernel_sigma_bins: float = number(1.25, 0.5, 3.0, "bins", "width of the Gaussian kernel [sigma]")
    kernel_half_bins: int = number(3, 1, 7, "bins", "the kernel ends this far to either side: 2 x this + 1 bins [h]")
    density_share: float = critical(0.7, 0.2, 1.0, "", "share of Hm*x that a peak's soft count must reach")
    density_min_px: float = critical(4.0, 1.0, 50.0, "px", "least soft count of a peak")
    peak_alpha: float = critical(0.3, 0.05, 0.9, "", "a peak's interval ends at this share of its height [alpha]")
    peak_valley: float = critical(
        0.8, 0.3, 1.0, "", "two peaks are one when the valley is above this share of the smaller"
    )

    # Windows and strips
    window_majority: float = critical(
        0.5, 0.3, 0.95, "", "share of a window's valid pixels that must belong to the peak"
    )
    window_min_px: int = critical(4, 2, 50, "px", "shortest window [least delta v]")
    window_members: int = critical(3, 1, 20, "px", "and least pixels of the peak in it")
    window_take_sigmas: float = number(
        1.0, 0.0, 5.0, "sigma", "pixels of a segment's rows this much nearer than its peak are taken with it"
    )
    rough_factor: float = number(1.2, 0.5, 4.0, "", "a peak wider than this times e(x) is rough")
    near_quantile: float = critical(
        0.02, 0.0, 0.2, "", "near side of rough things: the k-th closest, k = max(3, this share)"
    )
    near_rank: int = critical(3, 1, 20, "px", "least k of the k-th closest")
    near_sigmas: float = critical(2.0, 0.0, 6.0, "sigma", "and noise that the k-th closest is expected to stand out by")
    near_edge_share: float = critical(
        0.5, 0.1, 1.0, "", "a near edge, less its noise, keeps at least this share of the strip's disparity"
    )
    band_rows: int = number(5, 2, 50, "px", "rows of one band when a strip is looked at for steps")
    band_step_m: float = number(0.2, 0.02, 2.0, "m", "a band this far off in depth begins a strip of its own")
    band_sigmas: float = number(3.0, 1.0, 8.0, "sigma", "and by this much of its noise")
    irregular_gap_px: int = number(3, 1, 50, "px", "rows without pixels that end an irregular segment")
    irregular_jump: float = number(0.08, 0.01, 0.5, "", "step of disparity between rows, as a share, that ends one")
    irregular_depth_m: float = number(0.5, 0.1, 5.0, "m", "greatest depth of one irregular segment")
    irregular_sigmas: float = number(4.0, 1.0, 10.0, "sigma", "and noise that is neither a jump nor depth")
    min_support_px: int = critical(
        7, 1, 100, "px", "source pixels, its own and its neighbours', that a strip must have"
    )
    min_support_m: float = critical(
        0.02, 0.0, 0.2, "m", "and source pixels per pixel of this length: near things are large, stray blobs are not"
    )
    max_column_strips: int = critical(
        128, 8, 1024, "", "strips of one column; what would be more is merged into its last, at the nearest distance"
    )
    max_strips_per_column: float = critical(
        24.0, 4.0, 1024.0, "", "with more strips a column, on average, the image is noise in blocks, no measurement"
    )
    support_columns: int = number(6, 0, 16, "px", "columns on either side that may support a strip")
    support_rows: int = number(
        2, 0, 16, "px", "rows that may lie between it and such a strip, one more for each column"
    )
    support_sigmas: float = number(4.0, 1.0, 10.0, "sigma", "and difference in disparity, at most, in noise of a pixel")
    support_relative: float = number(0.05, 0.0, 0.5, "", "or as a share of the disparity")
    support_large: int = critical(4, 1, 50, "", "a strip with this many times the support that is needed is large")
    support_tail_sigmas: float = number(
        4.5, 1.0, 10.0, "sigma", "what lies within this of a large strip beside it is that strip's noise"
    )
    cut_rows: int = number(2, 1, 20, "px", "an end this close to the border of the image is cut by it")
    smooth_relative: float = number(
        0.1, 0.0, 0.5, "", "strips of neighbouring columns share near edges within this part of the disparity"
    )
    smooth_sigmas: float = number(3.0, 0.0, 10.0, "sigma", "and this much of the strip's noise")
    horizontal_correlation: float = number(0.05, 0.001, 0.5, "", "1 - |r| below this: a horizontal surface [eps_r]")
    horizontal_centre_px: float = number(20.0, 1.0, 200.0, "px", "and vanishing row off by less than this [eps_v]")
    horizontal_min_px: int = number(6, 3, 100, "px", "least number of pixels of a horizontal surface")

    # Straight pieces and planes
    height_step_m: float = number(0.3, 0.05, 3.0, "m", "tops or bottoms of one straight piece differ by at most this")
    line_tolerance_m: float = number(0.12, 0.02, 1.0, "m", "greatest misfit of a straight piece [eps_l]")
    line_sigmas: float = number(3.0, 1.0, 8.0, "sigma", "and in noise of the strip")
    link_slope_px: float = number(
        1.2, 0.1, 10.0, "px", "change of disparity from one column to the next on one surface"
    )
    rough_slope_px: float = number(
        1.2, 0.1, 10.0, "px", "and in a piece with a rough strip, while it grows: that leaves scatter is no slope"
    )
    link_gap_px: int = number(4, 1, 64, "px", "columns that one surface may miss")
    roughness_m: float = number(
        0.02, 0.0, 0.2, "m", "roughness of surfaces, added to the noise so that near strips do not rule alone"
    )
    track_jump: float = number(0.1, 0.01, 0.5, "", "a step of disparity of this share, from one strip to the next,")
    track_jump_sigmas: float = number(3.0, 1.0, 8.0, "sigma", "and of this much noise, begins another piece")
    plane_angle_deg: float = number(20.0, 1.0, 60.0, "deg", "adjacent planes within this angle are merged [phi0]")
    merge_distance_m: float = number(
        0.3, 0.01, 2.0, "m", "a merged plane leaves the strips of what it replaces by no more, root mean square"
    )
    merge_noise_cap: float = number(2.0, 0.0, 10.0, "", "noise allows at most this many times merge_distance_m more")
    merge_spread_m: float = number(
        0.2, 0.02, 2.0, "m", "strips lie no farther than this from a merged plane, root mean square, noise apart"
    )
    merge_shift_m: float = critical(
        0.3, 0.01, 2.0, "m", "a join shifts neither plane by more than this towards the camera, noise apart"
    )
    merge_candidates: int = number(48, 2, 5000, "", "largest number of merge candidates of a plane in one round")
    merge_partners: int = number(8, 1, 64, "", "and how many of them, the cheapest, it may be merged with")
    merge_empty_weight: float = number(0.5, 0.0, 5.0, "", "cost of a join whose rectangle is all empty; 1 is too much")
    merge_empty_share: float = number(0.25, 0.0, 1.0, "", "and most of it that may be empty")
    merge_long_share: float = number(
        0.5, 0.05, 5.0, "Ws", "planes both longer than this are merged within plane_angle_deg only"
    )
    merge_rounds: int = number(12, 1, 50, "", "rounds of merging, at most")
    join_gap_m: float = number(
        0.5, 0.1, 3.0, "m", "a joined plane covers no empty square of this side, and no wider gap"
    )
    join_share: float = number(0.9, 0.1, 0.99, "", "and no square of this share of Ws or of Hs")
    evidence_cell_px: int = number(8, 1, 32, "px", "side of a cell in which evidence is looked for")
    evidence_behind_m: float = number(0.7, 0.05, 3.0, "m", "evidence for a plane lies at most this far behind it")
    opening_slack_m: float = critical(
        0.1, 0.0, 0.5, "m", "in an opening a join covers nothing farther than this from what was seen"
    )
    safe_along_m: float = critical(
        0.4, 0.05, 2.0, "m", "most that a plane may lie behind that near edge along the viewing ray"
    )
    rough_near_sigmas: float = critical(
        2.0,
        0.0,
        8.0,
        "sigma",
        "the near edge of a rough strip lies no farther than this behind the strip's own distance",
    )
    stand_out_share: float = number(
        0.02,
        0.0,
        1.0,
        "",
        "of a plane's support, the most that stands out by more and becomes planes of its own instead",
    )
    stand_out_m: float = number(
        0.05, 0.0, 2.0, "m", "where that spares it at least so much of a shift towards the camera"
    )
    stand_out_spreads: float = number(
        2.0,
        0.0,
        10.0,
        "",
        "and at least this many times the spread of its strips about it: leaves scatter, walls do not",
    )
    min_plane_distance_m: float = critical(0.05, 0.01, 0.5, "m", "no plane is shifted nearer to the camera than this")
    footprint_px: float = critical(
        0.5, 0.0, 4.0, "px", "what a plane's end columns and rows are extended by on either side"
    )
    cut_footprint_px: float = critical(
        1.0, 0.0, 10.0, "px", "and by this where the border of the image cuts the rows: they go on there"
    )
    min_plane_height_m: float = number(0.05, 0.001, 0.5, "m", "height kept of a plane that lies below the ground")
    margin_sigmas: float = critical(2.0, 0.0, 6.0, "sigma", "noise of a plane's distance inside the published margin")
    inferred_share: float = number(
        0.05, 0.0, 0.5, "", "a plane with more of its rows or columns filled is inferred; less is what pixels drop out"
    )
    inferred_columns: float = number(
        4.0, 0.0, 20.0, "px", "columns of a plane without a strip that are no gap: footprints, and where planes meet"
    )
    cut_columns: float = number(1.5, 0.5, 10.0, "px", "a plane that ends within so many columns of the border is cut")

    # Neighbours and pockets
    meet_share: float = number(0.25, 0.0, 1.0, "Ws", "neighbours are extended by at most this to meet")
    meet_columns: int = number(40, 1, 500, "px", "and over at most so many columns")
    meet_slack_m: float = number(0.05, 0.0, 0.5, "m", "heights equal within this are the same where planes meet")
    pocket_min_columns: float = number(2.0, 0.0, 20.0, "px", "no ray passes a narrower gap between neighbours")
    pocket_behind_m: float = number(
        0.3, 0.0, 2.0, "m", "a plane at most so far behind a pocket's mouth closes it already"
    )
    pocket_points: int = number(5, 1, 50, "", "points each way at which a pocket's mouth is looked at for openings")
    covered_px: float = number(
        2.0, 0.0, 10.0, "px", "what stands out beside a plane by no more than this is still hidden"
    )
    covered_depth_m: float = number(1.0, 0.0, 5.0, "m", "planes hide what stands at most so far behind them")

    # Openings: boxes of Ws x Hs seen to be free, which no plane may cover
    opening_cell_px: int = number(4, 3, 16, "px", "side of a cell in which free boxes are looked for")
    opening_first_m: float = number(0.5, 0.1, 5.0, "m", "first of the distances at which they are looked for")
    opening_ratio: float = number(1.42, 1.05, 2.0, "", "each such distance over the one before it")
    opening_edge_px: float = number(
        2.0, 0.0, 50.0, "px", "tops or bottoms that step by more beside an opening end a piece"
    )
    opening_unknown_share: float = critical(
        0.2, 0.0, 0.5, "", "most of a free box that may be unknown (dropped pixels)"
    )
    opening_behind_m: float = critical(
        0.5, 0.05, 5.0, "m", "what must be seen behind an opening from where Ws would reach beyond the maximum range"
    )

    # Layers and the free-range profile
    layer_join_m: float = number(0.25, 0.0, 2.0, "m", "tops and bottoms closer than this are one cut")
    profile_join_m: float = number(0.01, 0.0, 0.5, "m", "ends of planes closer than this are one vertex of a prism")
    profile_step_deg: float = number(2.5, 0.5, 15.0, "deg", "width of a direction of the free-range profile")
    profile_layer_m: float = number(
        0.5,
        0.2,
        10.0,
        "m",
        "height of an inner layer of the free-range profile: a body fits into layers that are all free",
    )
    profile_layers: int = number(
        9, 1, 31, "", "inner layers of the profile, around the height of the camera (odd: one is centred on it)"
    )
    profile_reach_m: float = number(
        7.0, 0.5, 50.0, "m", "height above and below the camera that the profile covers, by inner and outer layers"
    )
    profile_outer_layers: int = number(
        3, 0, 15, "", "outer layers of equal height above the inner ones, and as many below them (0: none)"
    )
    profile_ring_m: float = number(0.5, 0.1, 5.0, "m", "steps of range of the free-range profile")
    free_share: float = critical(
        0.8, 0.5, 1.0, "", "share of a cell's pixels that must be seen through to call it free"
    )
    profile_block_px: int = critical(
        4, 2, 64, "px", "rows that are counted together (odd: one more), a layer's rows rounded outwards"
    )
    profile_sigmas: float = critical(2.0, 0.0, 8.0, "sigma", "a pixel sees through what lies this much before it")
    profile_noise_cap: float = critical(0.3, 0.0, 0.5, "", "which is at most this share of its distance")
    profile_least_m: float = critical(0.1, 0.01, 2.0, "m", "a layer with less than this above the ground is not judged")

    def __post_init__(self) -> None:
        check("", self)

    @property
    def noise_alike_px(self) -> float:
        """Length of a run of neighbouring pixels whose mean is no better than one of them, px: the integral of a
        Gaussian correlation, at least 1; the paper takes pixels for independent."""
        return max(1.0, math.sqrt(math.pi) * self.noise_length_px)
