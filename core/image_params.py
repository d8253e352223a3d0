"""Parameters of the stages that work on pixels, and the size of the vehicle.

Symbols in brackets are the paper's."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .param_field import check, critical, number, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageParams:
    """The first part of `Params`: vehicle, noise, levelling, classes of pixels, and ground. Raises ValueError naming the
    field, its value and its range."""

    # The vehicle and what counts as an obstacle
    min_obstacle_height_m: float = critical(
        0.6, 0.05, 3.0, "m", "least height of an obstacle; lower objects count as ground [Hm]"
    )
    passable_height_m: float = critical(
        1.0, 0.2, 10.0, "m", "least height of an opening that stays open for the vehicle; lower ones may be closed [Hs]"
    )
    passable_width_m: float = critical(
        2.0, 0.2, 20.0, "m", "least width of an opening that stays open for the vehicle; narrower may be closed [Ws]"
    )
    segment_height_m: float = number(
        2.0, 0.2, 10.0, "m", "height of segments of irregular objects such as trees; larger: fewer, coarser planes [Hd]"
    )
    safe_distance_m: float = critical(
        0.28, 0.05, 1.0, "m", "greatest distance of a plane behind the near edge of its surface; larger: coarser planes"
    )

    # Noise: sigma_Z = ke * Z^2, constant in disparity
    estimate_noise: bool = switch(
        True, "measure the depth noise in each frame; ke_per_m of the camera is then the start value", safety=True
    )
    noise_prior_span: float = critical(
        4.0, 1.0, 10.0, "", "the measured ke stays between ke_per_m / span and ke_per_m * span"
    )
    min_sigma_px: float = critical(0.1, 0.01, 2.0, "px", "lower bound of the estimated disparity noise")
    noise_tiles_down: int = number(
        6, 1, 32, "", "rows of tiles of the image; each tile has a noise estimate of its own"
    )
    noise_tiles_across: int = number(8, 1, 32, "", "columns of tiles of the image for the noise estimate")
    noise_min_depth_m: float = number(
        1.5,
        0.0,
        20.0,
        "m",
        "nearer pixels are left out of the noise estimate, because steps of a millimetre outweigh their noise",
    )
    noise_quantile: float = number(
        0.25, 0.0, 1.0, "", "quantile of the tiles that is the noise of the image; larger: more noise is assumed"
    )
    noise_time_frames: int = critical(
        3, 1, 100, "", "number of frames between the two images whose difference over time is measured"
    )
    noise_length_px: float = critical(
        9.0, 0.0, 64.0, "px", "distance over which the correlation of the noise falls to 1/e (0: independent pixels)"
    )
    clear_sigmas: float = critical(
        3.0, 0.0, 8.0, "sigma", "measurements within so many sigmas of max_range_m are far; free space ends before them"
    )

    # Levelling
    max_tilt_deg: float = critical(
        60.0, 10.0, 75.0, "deg", "greatest tilt of the optical axis from the horizontal; beyond it the frame is invalid"
    )
    max_view_ratio: float = number(
        2.0, 1.0, 4.0, "", "greatest number of cells of the levelled view per source pixel; larger: finer and slower"
    )
    column_step: int = critical(
        1, 1, 16, "", "image columns pooled into one; larger: faster, may lose thin objects [sampling interval]"
    )
    min_measured_share: float = critical(
        0.02, 0.0, 0.5, "", "a frame whose share of measured or far pixels is not greater is invalid"
    )

    # Flying pixels: strictly between two neighbours in disparity, far from both
    flying_relative: float = critical(
        0.08,
        0.01,
        0.5,
        "",
        "a flying pixel, between a near and a far surface, differs from both neighbours by at least this "
        "share of the disparity",
    )
    max_flying_share: float = critical(
        0.03, 0.005, 1.0, "", "greatest share of flying pixels; with more the frame is invalid"
    )
    flying_sigmas: float = critical(
        5.0, 1.0, 20.0, "sigma", "a flying pixel differs from both neighbours by at least this much noise as well"
    )

    # Smeared edges: ramps of disparity between a near and a far surface, of a camera whose edges are all like that
    smear_min_share: float = critical(
        0.7, 0.0, 1.0, "", "a camera smears edges when more than this share of its edges are ramps (1: never)"
    )
    smear_min_edges: float = number(
        60.0,
        1.0,
        10000.0,
        "",
        "least number of edges in every fourth row, at an image height of 480, for a frame to count in that judgement",
    )
    smear_min_frames: int = number(
        5, 2, 30, "frames", "number of frames with enough edges after which a camera is judged by their mean"
    )
    smear_clear_share: float = critical(
        0.8, 0.0, 1.0, "", "share of ramps above which a camera counts as smearing after fewer frames"
    )
    smear_clear_edges: float = number(
        100.0,
        1.0,
        10000.0,
        "",
        "least number of edges in every fourth row, at an image height of 480, for that early judgement",
    )
    smear_merge_sigmas: float = number(
        2.5, 0.0, 6.0, "sigma", "noise of one pixel that the merge allows in addition where edges are smeared"
    )

    # Noise in a part of the picture: pixels alone, unlike each of their neighbours
    noisy_tiles: int = critical(16, 1, 64, "", "number of tiles across and down for that check")
    max_noisy_share: float = critical(
        0.04, 0.0, 1.0, "", "greatest share of tiles that are noise; with more the frame is invalid"
    )

    # Ground
    ground_tolerance_m: float = critical(
        0.25, 0.03, 1.0, "m", "least half-thickness of the ground; larger: low objects near the camera count as ground"
    )
    ground_sigmas: float = critical(
        4.0,
        1.0,
        8.0,
        "sigma",
        "half-thickness of the ground in noise of the height, sigma_h = ke * X * h; larger: fewer false obstacles far "
        "away, fewer low ones found",
    )
    ground_tolerance_cap: float = critical(
        0.9, 0.3, 1.0, "", "greatest half-thickness of the ground, as a share of min_obstacle_height_m"
    )
    ground_max_slope: float = critical(
        0.06, 0.0, 0.3, "m/m", "greatest slope of a surface that counts as ground; steeper is an obstacle or unknown"
    )
    ground_max_height_m: float = number(
        60.0, 1.0, 200.0, "m", "greatest height of the camera above the ground for which ground is searched"
    )
    ground_min_height_m: float = number(
        0.04, 0.02, 1.0, "m", "least height of the camera above the ground for which ground is searched"
    )
    ground_height_step: float = number(
        0.04, 0.005, 0.3, "", "relative step of the heights that are voted for: the noise of the height grows with it"
    )
    ground_column_step: int = number(5, 1, 64, "px", "distance of the sampled columns; larger: faster, fewer samples")
    ground_row_step: int = number(3, 1, 64, "px", "distance of the sampled rows; larger: faster, fewer samples")
    ground_max_samples: int = number(
        6000, 1000, 1000000, "", "greatest number of sampled pixels; larger images are sampled in larger steps"
    )
    ground_pair_climb: float = number(
        0.2,
        0.02,
        1.0,
        "",
        "two pixels of a column form a pair when a wall between them would rise by this share of the camera's height",
    )
    ground_pair_climb_min_m: float = number(0.08, 0.01, 1.0, "m", "least rise of a wall between the pixels of a pair")
    ground_pair_climb_max_m: float = number(2.0, 0.1, 20.0, "m", "greatest rise of a wall between the pixels of a pair")
    ground_pair_parts: int = number(
        3, 1, 20, "", "greatest distance of the rows of a pair: the height of the image divided by this"
    )
    ground_fit_rounds: int = number(
        4, 1, 20, "", "number of rounds of the fit; each uses the pixels near the result of the round before"
    )
    ground_recede_share: float = number(
        0.2,
        0.0,
        1.0,
        "",
        "least share of the distance by which ground recedes from row to row that its pixels must recede; "
        "those of a wall do not",
    )
    ground_fit_floor_m: float = number(
        0.02, 0.001, 1.0, "m", "added to the noise of a pixel in its weight, so that near pixels do not dominate"
    )

    def __post_init__(self) -> None:
        check("", self)

    @property
    def noise_alike_px(self) -> float:
        """Length of a run of neighbouring pixels whose mean is no better than one of them, px: the integral of a
        Gaussian correlation, at least 1; the paper takes pixels for independent."""
        return max(1.0, math.sqrt(math.pi) * self.noise_length_px)
