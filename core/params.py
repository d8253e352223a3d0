"""The parameters of the extractor: a name, a default, a range, a unit and what it means.

Symbols in brackets are the paper's. Constants that no configuration, test or benchmark varies are in the module that
uses them."""

from __future__ import annotations

from dataclasses import dataclass

from .image_params import ImageParams
from .param_field import critical, number


@dataclass(frozen=True, slots=True, kw_only=True)
class Params(ImageParams):
    """Parameters of the extractor: those of ImageParams, of the strips, of the planes and of what is published. Raises
    ValueError naming the field, its value and its range."""

    # Density and peaks
    bin_per_sigma: float = number(1.25, 0.5, 4.0, "", "bins per sigma of disparity noise; larger: finer and slower")
    bin_depth_m: float = number(0.03, 0.0, 0.5, "m", "least thickness of a bin in depth (0: uniform bins)")
    kernel_sigma_bins: float = number(
        1.25, 0.5, 3.0, "bins", "width of the Gaussian kernel; larger: smoother density [sigma]"
    )
    kernel_half_bins: int = number(3, 1, 7, "bins", "half-width of the kernel: it covers 2 x this + 1 bins [h]")
    density_share: float = critical(
        0.7, 0.2, 1.0, "", "least soft count of a peak, as a share of that of an object Hm high; smaller: more peaks"
    )
    density_min_px: float = critical(4.0, 1.0, 50.0, "px", "least soft count of a peak")
    peak_alpha: float = critical(0.3, 0.05, 0.9, "", "the interval of a peak ends at this share of its height [alpha]")
    peak_valley: float = critical(
        0.8, 0.3, 1.0, "", "two peaks are one when the valley between them is above this share of the smaller peak"
    )

    # Windows and strips
    window_majority: float = critical(
        0.5, 0.3, 0.95, "", "least share of the valid pixels of a window that belong to the peak"
    )
    window_min_px: int = critical(4, 2, 50, "px", "least length of a window [least delta v]")
    window_members: int = critical(3, 1, 20, "px", "least number of pixels of the peak in a window")
    window_take_sigmas: float = number(
        1.0, 0.0, 5.0, "sigma", "pixels in a segment's rows that are nearer than its peak by at most this are added"
    )
    near_sigmas: float = critical(
        2.0, 0.0, 6.0, "sigma", "noise by which the k-th closest pixel is expected to be too near, and which is removed"
    )
    near_edge_share: float = critical(
        0.5, 0.1, 1.0, "", "least share of a strip's disparity that its near edge keeps after the noise is removed"
    )
    band_rows: int = number(5, 2, 50, "px", "number of rows of a band, when a strip is checked for steps in depth")
    band_step_m: float = number(0.2, 0.02, 2.0, "m", "a band that differs by this in depth begins a new strip")
    band_sigmas: float = number(
        3.0, 1.0, 8.0, "sigma", "a band that begins a new strip differs by this much noise as well"
    )
    irregular_gap_px: int = number(3, 1, 50, "px", "number of rows without pixels that ends an irregular segment")
    irregular_depth_m: float = number(0.5, 0.1, 5.0, "m", "greatest extent in depth of one irregular segment")
    irregular_sigmas: float = number(
        4.0, 1.0, 10.0, "sigma", "differences up to this much noise count neither as a step nor as depth"
    )
    min_support_px: int = critical(
        7, 1, 100, "px", "least source pixels of a strip with its neighbours; larger: fewer false and thin obstacles"
    )
    min_support_m: float = critical(
        0.02,
        0.0,
        0.2,
        "m",
        "least support of a strip as a length: near objects need more pixels, which false matches do not have",
    )
    max_column_strips: int = critical(
        128, 8, 1024, "", "most strips of one column; others are merged into the last one, at the nearest distance"
    )
    max_strips_per_column: float = critical(
        24.0, 4.0, 1024.0, "", "greatest mean number of strips per column; with more the frame is invalid"
    )
    support_columns: int = number(6, 0, 16, "px", "number of columns on either side whose strips may support a strip")
    support_rows: int = number(
        2, 0, 16, "px", "rows that may lie between a strip and its support; one more for each column of distance"
    )
    support_sigmas: float = number(
        4.0, 1.0, 10.0, "sigma", "greatest difference in disparity to a supporting strip, in noise of a pixel"
    )
    support_relative: float = number(
        0.05, 0.0, 0.5, "", "greatest difference in disparity to a supporting strip, as a share; the larger limit holds"
    )
    support_large: int = critical(4, 1, 50, "", "a strip with this many times the necessary support is large")
    support_tail_sigmas: float = number(
        4.5, 1.0, 10.0, "sigma", "strips within this of a large strip beside them are noise of that strip"
    )
    cut_rows: int = number(2, 1, 20, "px", "a strip that ends this close to the border of the image is cut by it")

    # Straight pieces and planes
    height_step_m: float = number(
        0.3, 0.05, 3.0, "m", "tops or bottoms of the strips of one straight piece differ by at most this"
    )
    line_tolerance_m: float = number(
        0.12, 0.02, 1.0, "m", "greatest misfit of a straight piece; larger: fewer and coarser planes [eps_l]"
    )
    link_slope_px: float = number(
        1.2, 0.1, 10.0, "px", "greatest change of disparity from one column to the next on one surface"
    )
    link_gap_px: int = number(4, 1, 64, "px", "number of columns that one surface may miss; larger: gaps are bridged")
    plane_angle_deg: float = number(20.0, 1.0, 60.0, "deg", "adjacent planes within this angle are merged [phi0]")
    merge_distance_m: float = number(
        0.3, 0.01, 2.0, "m", "greatest distance (rms) of a merged plane from its strips; larger: fewer, coarser planes"
    )
    merge_noise_cap: float = number(2.0, 0.0, 10.0, "", "noise extends that distance by at most this many times")
    merge_spread_m: float = number(
        0.2, 0.02, 2.0, "m", "greatest spread of the strips about a merged plane, root mean square, without noise"
    )
    merge_shift_m: float = critical(
        0.3, 0.01, 2.0, "m", "greatest shift of a plane towards the camera by a merge, without noise"
    )
    merge_candidates: int = number(
        48, 2, 5000, "", "greatest number of merge candidates of a plane in one round; larger: slower"
    )
    merge_partners: int = number(8, 1, 64, "", "number of the best candidates that a plane may be merged with")
    merge_empty_share: float = number(0.25, 0.0, 1.0, "", "greatest empty share of the rectangle of a merged plane")
    merge_rounds: int = number(12, 1, 50, "", "greatest number of rounds of merging")
    join_gap_m: float = number(
        0.5, 0.1, 3.0, "m", "greatest side of an empty square, and greatest gap, that a merged plane covers"
    )
    opening_slack_m: float = critical(
        0.1, 0.0, 0.5, "m", "greatest distance from measurements that a merged plane covers inside an opening"
    )
    safe_along_m: float = critical(
        0.4, 0.05, 2.0, "m", "greatest distance of a plane behind the near edge along the viewing ray"
    )
    rough_near_sigmas: float = critical(
        2.0, 0.0, 8.0, "sigma", "greatest distance of the near edge of a rough strip behind the strip itself, in noise"
    )
    stand_out_share: float = number(
        0.02, 0.0, 1.0, "", "greatest share of a plane's support that is split off for standing out towards the camera"
    )
    stand_out_m: float = number(0.05, 0.0, 2.0, "m", "least shift towards the camera that such a split avoids")
    stand_out_spreads: float = number(
        2.0, 0.0, 10.0, "", "least shift that such a split avoids, in spreads of the strips about the plane"
    )
    min_plane_distance_m: float = critical(0.05, 0.01, 0.5, "m", "least distance of a plane from the camera")
    margin_sigmas: float = critical(
        2.0, 0.0, 6.0, "sigma", "noise of the distance of a plane that is part of the published margin"
    )

    # Neighbours and pockets
    meet_columns: int = number(
        40, 1, 500, "px", "greatest number of columns over which neighbouring planes are extended"
    )
    pocket_behind_m: float = number(
        0.3, 0.0, 2.0, "m", "a plane at most this far behind the open side of a concavity closes it already"
    )
    covered_px: float = number(
        0.5, 0.0, 10.0, "px", "what extends beside a plane by at most this counts as hidden by it"
    )

    # Layers and the free-range profile
    layer_join_m: float = number(
        0.25, 0.0, 2.0, "m", "tops and bottoms of planes closer than this are one border; larger: fewer layers"
    )
    profile_join_m: float = number(0.01, 0.0, 0.5, "m", "ends of planes closer than this become one vertex of a prism")
    profile_step_deg: float = number(
        2.5, 0.5, 15.0, "deg", "width of a direction of the free-range profile; smaller: finer and slower"
    )
    profile_layer_m: float = number(
        0.5, 0.2, 10.0, "m", "height of an inner layer of the free-range profile; a layer is free only as a whole"
    )
    profile_layers: int = number(
        9, 1, 31, "", "number of inner layers around the height of the camera; an odd number centres one on it"
    )
    profile_reach_m: float = number(7.0, 0.5, 50.0, "m", "height above and below the camera that the profile covers")
    profile_outer_layers: int = number(
        3, 0, 15, "", "number of outer layers of equal height above the inner ones, and below them (0: none)"
    )
    profile_ring_m: float = number(
        0.5, 0.1, 5.0, "m", "step of the free range, the nearest 8 steps are halved; smaller: finer and slower"
    )
    free_share: float = critical(
        0.8, 0.5, 1.0, "", "least share of a free cell's pixels that see through it; larger: less free space"
    )
    profile_block_px: int = critical(
        4, 2, 64, "px", "rows that are counted together (odd: one more); the rows of a layer are rounded outwards"
    )
    profile_sigmas: float = critical(
        2.0,
        0.0,
        8.0,
        "sigma",
        "a pixel sees through what lies this much noise before its measurement; larger: less free space",
    )
    profile_noise_cap: float = critical(0.3, 0.0, 0.5, "", "upper bound of that noise, as a share of the distance")
    profile_blank_m: float = critical(
        0.3,
        0.02,
        2.0,
        "m",
        "a region without a measurement of about this width and height may hide an object; smaller: less free space",
    )
