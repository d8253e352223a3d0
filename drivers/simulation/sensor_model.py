"""What a stereo depth camera makes of exact depth: noise constant in disparity, holes, wrong matches, the
range clip.

Z = f B / d, so sigma_Z = Z^2 / (f B) sigma_d = ke Z^2 with ke = sigma_d / (f B): normal noise of ke in 1/Z at any range. Depth is
along the optical axis; one ray through the middle of each pixel. Not modelled: steps of the disparity (1/8 to 1/32 px in
cameras; depth is rounded to mm), errors that depend on texture and stay from frame to frame, calibration, exposure time. Rendered
stereo (`stereo`) has the first two."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.types import FAR_MM, SATURATED_MM, UNKNOWN_MM, CameraInfo

DepthMm = NDArray[np.uint16]
NOISE_LENGTH_PX = 9.0
"""Measured on a still RealSense D435 at 640x480 from differences of frames 0.1 to 0.6 s apart: the correlation of the
noise of 1/Z falls to 1/e at 9.5 px along a row and at 7 px along a column (0.93 and 0.91 at 1 px, 0.46 and 0.27 at 8 px,
0.13 and 0.06 at 16 px). It does not depend on the time between the frames."""
WHITE_SHARE = 0.05
"""Share of the variance that is independent from pixel to pixel, from the same measurement."""
SMEARED_STEP_PER_M = 0.3
"""A larger step of 1/Z is not smeared. On a D435 with a baseline of 50 mm steps of up to 5 or 6 px are ramps, larger ones are
holes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """The faults of a simulated camera; the defaults are a perfect one."""

    ke_per_m: float = 0.0  # noise, sigma_Z = ke * Z^2, normal in 1/Z
    # distance over which the correlation of that noise falls to 1/e, 0 for independent pixels ("white"); see
    # `NOISE_LENGTH_PX`
    noise_length_px: float = NOISE_LENGTH_PX
    dropout_share: float = 0.0  # single pixels without a measurement
    holes: int = 0  # elliptic blobs of about hole_radius_px without one
    hole_radius_px: float = 12.0
    blind_left_px: int = 0  # columns that the second imager does not see
    # share of the pixels overwritten by 2x2 blocks of a disparity drawn uniformly from the sensor's range
    mismatch_share: float = 0.0
    flying_share: float = 0.0  # share of the pixels at a depth edge that lie somewhere between its two sides
    saturated_share: float = 0.0  # pixels written as 65535
    sky_is_far: bool = False  # what is beyond the range is marked "far" instead of "no measurement"
    # width of the window over which a matcher averages 1/Z, after near surfaces have grown by a third of it on each
    # side; 0: edges are sharp
    smear_px: float = 0.0
    # distance of the second imager to the right, which does not see what near surfaces cover left of them, see
    # `_hidden`; 0: it sees everything
    baseline_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.ke_per_m <= 0.05:
            raise ValueError(f"sensor model: ke_per_m={self.ke_per_m:g}, expected 0..0.05")
        if not 0.0 <= self.noise_length_px <= 64.0:
            raise ValueError(f"sensor model: noise_length_px={self.noise_length_px:g}, expected 0..64")
        if not 0.0 <= self.smear_px <= 64.0:
            raise ValueError(f"sensor model: smear_px={self.smear_px:g}, expected 0..64")
        for name in ("dropout_share", "mismatch_share", "flying_share", "saturated_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"sensor model: {name}={getattr(self, name):g}, expected 0..1")
        if not 0.0 <= self.baseline_m <= 2.0:
            raise ValueError(f"sensor model: baseline_m={self.baseline_m:g}, expected 0..2")
        if self.holes < 0 or self.blind_left_px < 0 or not self.hole_radius_px > 0.0:
            raise ValueError("sensor model: holes and blind_left_px must be >= 0, hole_radius_px > 0")

    def scaled_to(self, width: int) -> SensorModel:
        """The same faults for an image of another width than 640 px: lengths in pixels follow it."""
        factor = width / 640.0
        return replace(
            self,
            hole_radius_px=self.hole_radius_px * factor,
            blind_left_px=round(self.blind_left_px * factor),
            noise_length_px=self.noise_length_px * factor,
            smear_px=self.smear_px * factor,
        )


PERFECT = SensorModel()
TYPICAL = SensorModel(
    ke_per_m=0.0015, dropout_share=0.05, holes=4, mismatch_share=0.002, flying_share=0.5, blind_left_px=16
)
"""Noise of a good stereo camera with the faults that the fidelity figures are stated for."""


def generator(seed: int, frame: int) -> np.random.Generator:
    """The random numbers of one frame: the same for the same (seed, frame) on every machine."""
    return np.random.Generator(np.random.PCG64([seed, frame]))


def measure(depth_m: NDArray[np.float64], info: CameraInfo, model: SensorModel, seed: int, frame: int = 0) -> DepthMm:
    """What the camera delivers for exact depth (H, W), metres, inf where nothing is: (H, W) uint16
    millimetres.

    Noise is added to 1/Z, hence constant in disparity. Too near is UNKNOWN_MM; beyond the range is UNKNOWN_MM
    or, with sky_is_far, FAR_MM."""
    rng = generator(seed, frame)
    inverse = 1.0 / depth_m
    hidden = _hidden(inverse, info.intrinsics.fx * model.baseline_m) if model.baseline_m > 0.0 else None
    if model.smear_px > 1.0:
        inverse = _smeared(inverse, round(model.smear_px))
    if model.flying_share > 0.0:
        inverse = _flying(inverse, model.flying_share, rng)
    if model.ke_per_m > 0.0:
        inverse = inverse + model.ke_per_m * unit_noise(inverse.shape, model.noise_length_px, rng) * np.isfinite(
            depth_m
        )
    if model.mismatch_share > 0.0:
        inverse = _mismatches(inverse, info, model.mismatch_share, rng)
    with np.errstate(divide="ignore"):
        z_m = np.where(inverse > 0.0, 1.0 / inverse, np.inf)
    far = FAR_MM if model.sky_is_far else UNKNOWN_MM
    out = np.full(z_m.shape, UNKNOWN_MM, np.uint16)
    out[z_m > info.max_range_m] = far
    measured = (z_m >= info.min_range_m) & (z_m <= info.max_range_m)
    out[measured] = np.rint(1000.0 * z_m[measured]).astype(np.uint16)
    if hidden is not None:
        out[hidden] = UNKNOWN_MM
    return _holes(out, model, rng)


def unit_noise(shape: tuple[int, ...], length_px: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(H, W) normal noise of variance 1 whose correlation falls to 1/e at length_px; independent pixels below 2 px.

    White noise is averaged three times by a box as wide as the correlation length, which is close to a Gaussian filter with
    a standard deviation of half that length. A WHITE_SHARE of the variance stays independent."""
    width = round(length_px)
    if width < 2:
        return rng.standard_normal(shape)
    margin = 3 * (width - 1)
    blobs = rng.standard_normal((shape[0] + margin, shape[1] + margin))
    kernel = np.ones(1)
    for _ in range(3):
        blobs = _box_sum(_box_sum(blobs, width).T, width).T
        kernel = np.convolve(kernel, np.ones(width))
    blobs *= math.sqrt(1.0 - WHITE_SHARE) / float(kernel @ kernel)
    return blobs + math.sqrt(WHITE_SHARE) * rng.standard_normal(shape)


def _box_sum(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Sums of `width` successive rows: (N - width + 1, M)."""
    total = np.zeros((len(values) + 1, values.shape[1]))
    np.cumsum(values, axis=0, out=total[1:])
    return np.asarray(total[width:] - total[:-width])


def _hidden(inverse: NDArray[np.float64], f_b_px_m: float) -> NDArray[np.bool_]:
    """(H, W) whether the second imager of a rectified pair does not see what the first one sees there.

    A pixel in column u with disparity d = f B / Z lies in column u - d of the second image. It is hidden where a pixel farther to the
    right lies in that column or left of it. inverse: 1/Z (H, W); f_b_px_m: focal length times baseline, px m."""
    place = np.arange(inverse.shape[1]) - f_b_px_m * inverse
    leftmost = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(inverse.shape, np.bool_)
    hidden[:, :-1] = place[:, :-1] >= leftmost[:, 1:]
    return hidden


def _smeared(inverse: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """1/Z (H, W), 0: nothing, as a matcher with a window of `width` px sees it: near surfaces a third of the window larger, steps
    ramps of its width. What borders on nothing keeps its outline, and so do steps above SMEARED_STEP_PER_M."""
    grow, half = width // 3, width // 2
    grown = _greatest(inverse, grow)
    padded = np.pad(np.where(inverse > 0.0, grown, 0.0), half)
    known = np.pad((inverse > 0.0).astype(np.float64), half)
    size = 2 * half + 1
    total, count = (_box_sum(_box_sum(a, size).T, size).T for a in (padded, known))
    mean = total / np.maximum(count, 1.0)
    least = -_greatest(np.where(inverse > 0.0, -inverse, -np.inf), half + grow)
    smooth = _greatest(inverse, half + grow) - least <= SMEARED_STEP_PER_M
    return np.where((inverse > 0.0) & smooth, mean, inverse)


def _greatest(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """The greatest value within `reach` px along rows and columns: a square window."""
    for axis in (0, 1):
        padded = np.pad(values, [(reach, reach) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis)
        values = windows.max(axis=-1)
    return values


def _flying(inverse: NDArray[np.float64], share: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Replaces a share of the pixels beside a horizontal depth edge (a jump of 10 % or more) by a disparity
    between both sides. What borders on the sky is left alone: there is nothing to mix with."""
    left, right = inverse[:, :-1], inverse[:, 1:]
    edge = (np.abs(left - right) > 0.1 * np.maximum(left, right)) & (left > 0.0) & (right > 0.0)
    chosen = edge & (rng.random(edge.shape) < share)
    side = rng.random(edge.shape) < 0.5
    mix = rng.random(edge.shape)
    value = mix * left + (1.0 - mix) * right
    out = inverse.copy()
    out[:, :-1][chosen & side] = value[chosen & side]
    out[:, 1:][chosen & ~side] = value[chosen & ~side]
    return out


def _mismatches(
    inverse: NDArray[np.float64], info: CameraInfo, share: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    height, width = inverse.shape
    count = math.ceil(share * inverse.size / 4)
    v, u = rng.integers(0, height - 1, count), rng.integers(0, width - 1, count)
    value = rng.uniform(1.0 / info.max_range_m, 1.0 / info.min_range_m, count)
    out = inverse.copy()
    for dv in (0, 1):
        for du in (0, 1):
            out[v + dv, u + du] = value
    return out


def _holes(depth_mm: DepthMm, model: SensorModel, rng: np.random.Generator) -> DepthMm:
    height, width = depth_mm.shape
    if model.dropout_share > 0.0:
        depth_mm[rng.random(depth_mm.shape) < model.dropout_share] = UNKNOWN_MM
    if model.saturated_share > 0.0:
        depth_mm[rng.random(depth_mm.shape) < model.saturated_share] = SATURATED_MM
    v, u = np.ogrid[:height, :width]
    for _ in range(model.holes):
        cu, cv = rng.uniform(0, width), rng.uniform(0, height)
        ru, rv = model.hole_radius_px * rng.uniform(0.5, 1.5, 2)
        depth_mm[((u - cu) / ru) ** 2 + ((v - cv) / rv) ** 2 < 1.0] = UNKNOWN_MM
    depth_mm[:, : model.blind_left_px] = UNKNOWN_MM
    return depth_mm
