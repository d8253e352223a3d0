"""Which unmeasured pixels of a stereo pair show a smooth surface: sky or blank paint. See docs/explanation/open-space.md.

A pixel is smooth where neither its rows nor its columns hold an edge that stands out of the sensor's noise, at several scales, and
where the right image shows the same brightness at the same place (what is far, or larger than its disparity) and as few edges. Dark and
saturated pixels of either image are not judged: there it holds no contrast that could show an edge."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import BEYOND_MM, CONTINUED_MM, TEXTURED_MM, TEXTURELESS_MM, UNKNOWN_MM

from .level_lines import line_steps
from .match_confidence import BACKGROUND_PX
from .sky_areas import ambiguous_sky
from .sky_edges import FAR_PX, columns_with_near_edge
from .sky_gradient import columns_without_gradient

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST_NOISE_GREY, _MOST_NOISE_GREY = 0.3, 2.5
"""Bounds of the estimated noise, grey levels: rounding to whole levels, and the greatest one of an image without a smooth tile."""
_TILE_PX, _NOISE_PERCENTILE = 16, 15.0
_SPECKLE_SCALE = 6.0
"""Standard deviation of `_SPECKLE` on noise of 1."""
_SPECKLE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
_MEAN_ABS = 0.798
"""Mean of |x| of a normal distribution."""
_SOBEL_NOISE = 0.433
"""Standard deviation of the 3x3 derivative, in grey levels per pixel, on noise of 1."""
_BENDS = (((5, 5), (6, 0)), ((5, 5), (0, 6)), ((21, 3), (0, 4)), ((3, 21), (4, 0)))
"""Windows (width, height) and the steps (right, down) at which their means are compared, pixels."""

_BLURRED_WINDOW, _MOST_DIFFERENT = (41, 41), 0.25
"""Window (width, height), and greatest difference of the shares of edges in it between both images. It is greater where something
blurs one lens alone, as a finger, a drop or fog: a surface with fine texture looks smooth in its image, and has no match."""
_LIKE_WINDOW, _LIKE_BELOW_PX, _LIKE_GAP_PX, _LIKE_ROWS = (41, 5), 6, 8, 90
"""A surface is compared with what is below it: window of the means (width, height), distance of its rows, unmatched rows between
both, and greatest number of rows below the surface, pixels."""
_EDGE_ROWS = 6
"""Rows below smooth pixels in which the lower edge of these lies: its marks begin 3 rows above it, and a lens blurs it."""
_BRIGHTER_GREY, _BRIGHTER_SHARE = 8.0, 0.3
"""An edge that gets brighter downwards by so much, and by such a share of the darkening within _EDGE_ROWS of it, is no edge of the
sky. Sharpening makes such edges beside that of the sky: an unsharp mask that adds all of the difference 0.2 of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothLimits:
    """Limits of a surface without texture, in grey levels (0..255).

    edge_sigmas: least contrast of an edge, in standard deviations of the noise; slope_grey: greatest change of grey per pixel
    of a sky; bend_grey: greatest change of that slope over a window; dark_grey, bright_grey: pixels outside of this range are
    not judged; differ_grey: greatest difference in brightness between both images; like_grey: greatest difference between a
    surface and what is below it that counts as alike; grow_px: pixels this close to an edge are not smooth; line_px: least length of
    a level line; rise_px: rows over which the brightness of a sky changes; near_px: least disparity of what is near; far_px:
    greatest disparity of an edge of the sky. `limits_of` gives the limits of a camera."""

    edge_sigmas: float = 5.0
    slope_grey: float = 0.8
    bend_grey: float = 0.6
    dark_grey: int = 30
    bright_grey: int = 250
    differ_grey: float = 4.0
    like_grey: float = 5.0
    grow_px: int = 2
    line_px: int = 61
    rise_px: int = 24
    near_px: float = BACKGROUND_PX
    far_px: float = FAR_PX


_TUNED_F_PX, _TUNED_F_B_PX_M = 350.0, 42.0
"""Focal length of the camera of which SmoothLimits holds the limits, and the same times its baseline."""


def limits_of(f_px: float, baseline_m: float) -> SmoothLimits:
    """The limits for a camera: angles and distances in its pixels. A greater focal length or baseline does not make a distance looser. f_px:
    focal length of the rectified images."""
    tuned = SmoothLimits()
    deeper = min(1.0, f_px * baseline_m / _TUNED_F_B_PX_M)
    return replace(
        tuned,
        rise_px=max(1, round(tuned.rise_px * f_px / _TUNED_F_PX)),
        near_px=tuned.near_px * deeper,
        far_px=tuned.far_px * deeper,
    )


def noise_grey(image: Gray) -> float:
    """Standard deviation of the sensor's noise, grey levels, from the smoothest tiles of an image (H, W) uint8.

    Rectification interpolates between pixels, and cameras remove noise. The rest is alike in neighbouring pixels: their differences
    show down to a sixth of it, differences of means of 2 x 2 pixels at least two thirds. Where the noise of each pixel is
    independent, such means have half of it, so that they are doubled."""
    fine = np.asarray(image, np.float32)
    half = cv2.resize(fine, (image.shape[1] // 2, image.shape[0] // 2), interpolation=cv2.INTER_AREA)
    sigma = max(_speckle(fine), 2.0 * _speckle(half))
    return min(max(sigma, _LEAST_NOISE_GREY), _MOST_NOISE_GREY)


def _speckle(image: Image) -> float:
    """Standard deviation of noise that is independent from pixel to pixel, from the smoothest tiles of an image (H, W)."""
    speckle = np.abs(cv2.filter2D(image, cv2.CV_32F, _SPECKLE))
    height, width = image.shape
    tiles = cv2.resize(speckle, (max(1, width // _TILE_PX), max(1, height // _TILE_PX)), interpolation=cv2.INTER_AREA)
    return float(np.percentile(tiles, _NOISE_PERCENTILE)) / (_SPECKLE_SCALE * _MEAN_ABS)


@functools.lru_cache(maxsize=8)
def _bend_kernels(window: tuple[int, int], step: tuple[int, int]) -> tuple[Image, Image]:
    """The kernels along rows and along columns of the mean of a window before, less twice that of one here, plus that of one after a
    step of (right, down) pixels, one of which is 0."""
    along, across = (0, 1) if step[0] else (1, 0)
    box = np.full(window[along], 1.0 / window[along])
    bend = np.zeros(2 * step[along] + 1)
    bend[[0, step[along], -1]] = 1.0, -2.0, 1.0
    kernels = [np.convolve(box, bend), np.full(window[across], 1.0 / window[across])]
    first, second = (kernels[k].astype(np.float32) for k in (along, across))
    return first, second


@functools.lru_cache(maxsize=16)
def _bend_noise(shape: tuple[int, int], window: tuple[int, int], step: tuple[int, int]) -> Image:
    """(H, W) standard deviation of the bend on noise of 1. It is greatest at the border of the image, where the mirrored window
    holds the same pixels twice."""

    def along(kernel: Image, length: int) -> Image:
        weights = cv2.filter2D(
            np.eye(length, dtype=np.float32), cv2.CV_32F, kernel.reshape(-1, 1), borderType=cv2.BORDER_REFLECT_101
        )
        return np.asarray(np.linalg.norm(weights, axis=1), np.float32)

    first, second = _bend_kernels(window, step)
    noise = np.outer(along(second, shape[0]), along(first, shape[1])).astype(np.float32)
    noise.setflags(write=False)
    return noise


def edges(image: Gray, limits: SmoothLimits, sigma: float | None = None) -> Mask:
    """(H, W) whether a pixel lies on an edge or within `grow_px` of it. sigma: `noise_grey` of the image where it is known.

    Clear edges by the 3x3 derivative, where they are. Faint ones by means of windows whose slope bends, only where no clear edge
    lies in the windows: these would smear it over their width."""
    sigma = noise_grey(image) if sigma is None else sigma
    size = (2 * limits.grow_px + 1,) * 2
    steep = limits.edge_sigmas * _SOBEL_NOISE * sigma + limits.slope_grey
    right = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    down = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    clear = (np.maximum(np.abs(right), np.abs(down)) > steep).view(np.uint8)
    faint = np.zeros_like(clear)
    for window, (du, dv) in _BENDS:
        rows, columns = _bend_kernels(window, (du, dv))
        bend = np.abs(cv2.sepFilter2D(image, cv2.CV_32F, rows, columns, borderType=cv2.BORDER_REFLECT_101))
        limit = np.float32(limits.edge_sigmas * sigma) * _bend_noise(image.shape, window, (du, dv))
        limit += np.float32(limits.bend_grey)
        reach = (window[0] // 2 + abs(du)) * 2 + 1, (window[1] // 2 + abs(dv)) * 2 + 1
        apart = cv2.dilate(clear, cv2.getStructuringElement(cv2.MORPH_RECT, reach)) == 0
        faint |= ((bend > limit) & apart).view(np.uint8)
    return np.asarray(cv2.dilate(clear | faint, cv2.getStructuringElement(cv2.MORPH_RECT, size)), np.uint8).view(
        np.bool_
    )


def judged(image: Gray, limits: SmoothLimits) -> Mask:
    """(H, W) which pixels are neither dark nor saturated, so that an edge would show."""
    return np.asarray((image >= limits.dark_grey) & (image <= limits.bright_grey))


def smooth(left: Gray, right: Gray, edge: Mask, limits: SmoothLimits) -> Mask:
    """(H, W) whether the left image is smooth, the right one has the same brightness, and both have about as many edges around. Both
    (H, W) uint8, rectified; edge: `edges` of the left one."""
    return smooth_and_shifted(left, right, edge, limits)[0]


def smooth_and_shifted(left: Gray, right: Gray, edge: Mask, limits: SmoothLimits) -> tuple[Mask, Mask]:
    """(`smooth` (H, W), whether the left image is smooth and the right one has another brightness (H, W)). The second lies beside the
    outline of a near thing: in the right image it lies to the left by its disparity."""
    even = ~edge & judged(left, limits) & judged(right, limits)
    if not even.any():
        return even, even
    more = edges(right, limits).astype(np.float32) - edge
    even &= np.abs(cv2.blur(more, _BLURRED_WINDOW)) <= _MOST_DIFFERENT
    mean_left, mean_right = (cv2.boxFilter(image, cv2.CV_32F, (7, 7)) for image in (left, right))
    difference = np.asarray(mean_left - mean_right, np.float32)
    if even.any():  # both imagers need not be equally bright
        difference -= np.float32(np.median(difference[even]))
    same = np.abs(difference) <= limits.differ_grey
    return np.asarray(even & same), np.asarray(even & ~same)


def continued(matched: Mask, even: Mask, left: Gray, limits: SmoothLimits) -> Mask:
    """(H, W) which smooth pixels continue a matched surface below them upwards, with no change of brightness: far ground whose
    texture is finer than a pixel. matched, even: (H, W) whether a pixel is matched, smooth."""
    mean = np.asarray(cv2.boxFilter(left, cv2.CV_32F, _LIKE_WINDOW), np.float32)
    found = np.zeros_like(even)
    width = left.shape[1]
    level, gap, rise = np.zeros(width, np.float32), np.full(width, _LIKE_GAP_PX + 1), np.zeros(width, np.int64)
    for v in range(left.shape[0] - 1 - _LIKE_BELOW_PX, -1, -1):
        here = matched[v]
        # of the surface a little below its upper end: the window there holds nothing of what is above it
        level = np.where(here, mean[v + _LIKE_BELOW_PX], level)
        rise = np.where(here, 0, rise + 1)
        like = even[v] & (rise <= _LIKE_ROWS) & (gap <= _LIKE_GAP_PX) & (np.abs(mean[v] - level) <= limits.like_grey)
        found[v] = like & ~here
        gap = np.where(here | like, 0, gap + 1)
    return found


def apart_from(steps: NDArray[np.float32], smooth_above: Mask) -> Mask:
    """(H, W) which pixels lie within one row of a level line that is not the lower edge of the sky, at which it gets darker downwards.
    steps: `line_steps`; smooth_above: (H, W) whether a pixel is smooth."""
    around = np.ones((2 * _EDGE_ROWS + 1, 1), np.uint8)
    below = around.copy()
    below[_EDGE_ROWS + 1 :] = 0
    darkening = -np.asarray(cv2.erode(steps, around), np.float32)
    brighter = steps > np.maximum(np.float32(_BRIGHTER_SHARE) * darkening, np.float32(_BRIGHTER_GREY))
    edge = cv2.dilate(smooth_above.view(np.uint8), below).view(np.bool_) & ~brighter
    lines = (steps != 0.0) & ~edge
    return np.asarray(cv2.dilate(lines.view(np.uint8), np.ones((3, 1), np.uint8))).view(np.bool_)


def mark_unmeasured(
    depth_mm: NDArray[np.uint16], disparity: NDArray[np.float32], left: Gray, right: Gray, limits: SmoothLimits
) -> NDArray[np.uint16]:
    """The depth image (H, W) uint16 with marks for UNKNOWN_MM where the images say more: BEYOND_MM where there is a disparity,
    CONTINUED_MM and TEXTURELESS_MM where the images are smooth, TEXTURED_MM where the left one is not. Dark and saturated pixels,
    smooth ones that differ between the images, and level lines stay UNKNOWN_MM: these may be rods. The lower edge of the sky is no such
    line. disparity: (H, W) float32 px, negative: none."""
    sigma = noise_grey(left)
    matched, edge = disparity >= 0.0, edges(left, limits, sigma)
    even, shifted = smooth_and_shifted(left, right, edge, limits)
    even &= ~matched
    even[:, columns_with_near_edge(even, left, right, limits.far_px)] = False
    # a sky of one brightness is still one of two areas of which one is a thing: its columns are removed last
    flat = columns_without_gradient(even, left, limits.rise_px, sigma)
    near = shifted | (disparity >= limits.near_px)
    even &= ~ambiguous_sky(even, even | (shifted & ~matched), near, left, limits.slope_grey)
    even[:, flat] = False
    marks = np.where(even, np.uint16(TEXTURELESS_MM), np.uint16(UNKNOWN_MM))
    marks[edge & judged(left, limits)] = TEXTURED_MM
    marks[continued(matched, even, left, limits)] = CONTINUED_MM
    rods = apart_from(line_steps(left, limits.line_px), marks == TEXTURELESS_MM)
    marks[rods & (marks == TEXTURED_MM)] = UNKNOWN_MM
    marks[matched] = BEYOND_MM
    return np.where(depth_mm == UNKNOWN_MM, marks, depth_mm)
