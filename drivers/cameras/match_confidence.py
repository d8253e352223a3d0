"""Which pixels of a matched stereo pair are accepted, from both images and the disparity found. See
docs/explanation/stereo-depth.md.

A matcher gives the best disparity there is, also where the images hold nothing but noise: blank sky, blank paint. Here each
match is tested against what noise could have produced. Only differences of grey along a row locate a match, so all rules look
at the horizontal derivative of both images, the right one taken where the disparity says:

- *correlation*: in a window the two derivatives must agree. Noise of two sensors does not. For texture of variance t and noise
  of variance n the correlation is t / (t + n): this is the local contrast against the noise, measured where it is used.
  Where the texture is strong the correlation must be high: two different textures agree by chance, but not so well;
- *texture*: the variance of the derivative must exceed that of the noise, which is measured in the pair itself from what differs
  between the two images where they are matched;
- *period*: where the left image repeats itself along the row, another disparity fits as well;
- *patch*: what is left must be part of a patch of one surface, single pixels are chance. The nearer it claims to be, the more
  pixels it needs: edges of different things that look alike agree in a few rows only, and at any disparity;
- *shared*: a place of the right image belongs to one thing. Where a patch of one edge lies there on what other matches of another
  disparity hold as well, two equal edges of the left image were matched to one of the right. A patch of which most lies so is
  dropped, the greater one of the true edge reaches farther;
- *smear*: a window takes the disparity of its strongest edge to all its pixels. Beside an area without measurements the outermost
  columns and rows may belong to that area. One column is dropped, an upright edge locates itself. As many rows as the window
  reaches are dropped: above and below a level edge it is not known to which side the disparity belongs. A far row whose own texture
  agrees in both images keeps all but the outermost pixel: far ground fades gradually, and has no edge there.
- *level line*: a level rod has no derivative along the row; the rows above and below give it their disparity, see level_lines.py.

What fails a rule is no measurement."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .level_lines import without_level_lines

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_SOBEL_SCALE = 1.0 / 8.0
"""Makes the 3x3 derivative one in grey levels per pixel."""
_LEAST_NOISE_GREY = 0.12
"""Standard deviation of the derivative by rounding to whole grey levels: sqrt(1/12) times 0.43, the norm of the derivative."""
_NOISE_SHARES = 2.0
"""Factor on the share of noise in the variance, by which the least correlation of strong texture is lowered; 1 is what the noise
takes."""
_LEAST_MATCHED = 0.5
"""Share of the window that must have a disparity."""
_FAR_PX = 1.0
"""Matches of less disparity are far."""
BACKGROUND_PX = 4.0
"""Matches of less disparity may be what is behind a rod, which the window measures in its place."""
_ROW_PX, _ROW_CORRELATION = 31, 0.6
"""Columns of one row that must agree by this correlation where a far row is kept."""
_PATCH_STEP_PX = 1.5
"""Neighbours of one surface differ by no more."""
_EDGE_PX = 1200
"""Larger patches are more than one edge."""
_SHARED_PX, _SHARED_STEP_PX = 2, 3.0
"""Columns within which matches share a place of the right image, and the least difference of their disparities, pixels."""
_STEP_PX = 8
"""Step of rows and columns at which the noise is sampled, pixels."""
_NOISE_PERCENTILE, _LEAST_SAMPLES = 20.0, 50
_BAND_PX = 16
"""Rows that are averaged where repetition is looked for."""
_LEAST_POWER = 1e-2
"""Variance of the derivative, (grey levels per pixel)^2, below which nothing repeats itself."""
_LEAST_SHIFT_PX = 3
_DIP = 0.4
"""A repetition shows as a correlation that falls by this much and rises again."""
_PERIOD_WINDOWS_PX = (31, 62, 124, 248, 496)
"""Each for the shifts from a sixth to a third of it, the first for all smaller ones."""
_PERIOD_AREA = (31, 3)
"""Columns and bands of the neighbourhood."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfidenceLimits:
    """window_px: side of the window, odd. correlation: least correlation of both derivatives, 0: rule off;
    strong_correlation: the same where the texture is far above the noise; far_correlation: the same for matches of less than
    BACKGROUND_PX. texture: least
    variance of the derivative over that of the noise, 0: off. period: correlation of the left image with itself from which on
    it repeats, 1: off; period_px: greatest period looked for. patch_px: smaller patches of similar disparity are dropped, 0: off;
    patch_per_px: so are those of fewer pixels for each pixel of their disparity, 0: off. An upright edge is 3 to 4 px wide: with 3
    it must be about as high as the baseline is long.
    shared: patches of one edge are dropped of which a greater share lies where other matches lie in the right image, 1: off.
    smear_px, smear_rows: columns and rows of the border of accepted areas beside unmeasured ones that are dropped, 0: off.
    level_px: length of level lines on which a match counts only where its own row agrees by level_correlation, 0: off."""

    window_px: int = 7
    correlation: float = 0.7
    strong_correlation: float = 0.85
    far_correlation: float = 0.91
    texture: float = 3.0
    period: float = 0.9
    period_px: int = 48
    patch_px: int = 25
    patch_per_px: float = 3.0
    shared: float = 0.5
    smear_px: int = 1
    smear_rows: int = 4
    level_px: int = 61
    level_correlation: float = 0.8


EVERY_MATCH = ConfidenceLimits(
    correlation=0.0,
    texture=0.0,
    period=1.0,
    patch_px=0,
    patch_per_px=0.0,
    shared=1.0,
    smear_px=0,
    smear_rows=0,
    level_px=0,
)
"""Limits with which every rule is off, to examine the rules one by one."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MatchStatistics:
    """Of the window around each pixel, all (H, W) float32. correlation: -1..1 of the derivatives of both images; variance: the
    lesser of both, in (grey levels per pixel)^2; matched: share of the window that has a disparity. noise_variance: of the
    derivative by noise alone."""

    correlation: Image
    variance: Image
    matched: Image
    noise_variance: float


def derivative(image: Gray) -> Image:
    """Change of the grey level along the row, (H, W) float32 per pixel; rows are smoothed over three."""
    return np.asarray(cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=_SOBEL_SCALE), np.float32)


def derivatives_at_match(left: Gray, right: Gray, disparity: Image) -> tuple[Image, Image]:
    """The derivative of the left image, and that of the right one where the disparity says; (H, W) float32 each."""
    columns = np.arange(left.shape[1], dtype=np.float32)[None, :] - disparity
    at_match = cv2.remap(derivative(right), columns, _rows(*left.shape), cv2.INTER_LINEAR)
    return derivative(left), np.asarray(at_match, np.float32)


def match_statistics(left: Gray, right: Gray, disparity: Image, window_px: int) -> MatchStatistics:
    """How well both images agree at a disparity (H, W) float32 px, negative: none. left, right: (H, W) uint8, rectified."""
    found = (disparity >= 0.0).astype(np.float32)
    g_left, g_right = (g * found for g in derivatives_at_match(left, right, disparity))

    def mean(image: Image) -> Image:
        return np.asarray(cv2.boxFilter(image, cv2.CV_32F, (window_px, window_px)), np.float32)

    share, mean_left, mean_right = mean(found), mean(g_left), mean(g_right)
    square_left, square_right, product = mean(g_left * g_left), mean(g_right * g_right), mean(g_left * g_right)
    # all moments times the square of the share: a common factor of the correlation
    var_left = share * square_left - mean_left * mean_left
    var_right = share * square_right - mean_right * mean_right
    both = share * product - mean_left * mean_right
    correlation = both / np.sqrt(np.maximum(var_left * var_right, np.float32(1e-12)))
    scale = np.float32(1.0) / np.maximum(share * share, np.float32(1e-6))
    s = np.s_[::_STEP_PX, ::_STEP_PX]
    # what both do not share is noise: half of the variance of the difference, where the match is right
    differing = ((0.5 * (var_left[s] + var_right[s]) - both[s]) * scale[s])[share[s] > 0.5]
    noise = float(np.percentile(differing, _NOISE_PERCENTILE)) if differing.size >= _LEAST_SAMPLES else 0.0
    return MatchStatistics(
        correlation=correlation,
        variance=np.maximum(np.minimum(var_left, var_right) * scale, np.float32(1e-6)),
        matched=share,
        noise_variance=max(noise, _LEAST_NOISE_GREY**2),
    )


@functools.lru_cache(maxsize=2)
def _rows(height: int, width: int) -> Image:
    """(H, W) the row of each pixel."""
    rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    rows.setflags(write=False)
    return rows


def repetitive(left: Gray, period: float, period_px: int) -> Mask:
    """(H, W) whether the left image repeats itself along the row, with a period of 3 to period_px columns and a correlation of at
    least `period` over three periods and more, in most of the neighbourhood. Looked at in bands of rows.

    Periods up to a third of the first window are looked for in steps of half a pixel: whole pixels lie too far beside the peak
    of a period of 3.3 pixels, as of a net."""
    height, width = left.shape
    band = cv2.resize(derivative(left), (width, max(1, height // _BAND_PX)), interpolation=cv2.INTER_AREA)
    last = min(period_px, width // 2 - 1)
    first_px, *longer_px = _PERIOD_WINDOWS_PX
    fine = cv2.resize(band, (2 * width, len(band)), interpolation=cv2.INTER_CUBIC)
    found, least = np.zeros(fine.shape, np.float32), np.ones_like(fine)
    # from half of the least period on, where it is least like itself; a step may lie half a step beside the peak
    shortest, longest = 2 * _LEAST_SHIFT_PX, 2 * min(last, first_px // 3)
    limits = {
        s: period * math.cos(math.pi / s) if s >= shortest else math.inf for s in range(shortest // 2, longest + 1)
    }
    _add_repetition(fine, 2 * first_px, limits, least, found)
    found, least = np.maximum(found[:, ::2], found[:, 1::2]), np.minimum(least[:, ::2], least[:, 1::2])
    for window_px in longer_px:
        limits = dict.fromkeys(range(window_px // 6 + 1, min(last, window_px // 3) + 1), period)
        _add_repetition(band, window_px, limits, least, found)
    # two poles are alike too; a repetition fills an area
    area = (cv2.blur(found, _PERIOD_AREA) >= 0.5).astype(np.uint8)
    return np.asarray(cv2.resize(area, (width, height), interpolation=cv2.INTER_NEAREST) > 0)


def _add_repetition(band: Image, window_px: int, limits: dict[int, float], least: Image, found: Image) -> None:
    """Sets `found` to 1 where a band (N, W) is like itself after a shift. limits: least correlation of each shift, in rising order;
    least: (N, W) the least correlation at smaller shifts. found, least: (N, W) float32, in and out."""
    size = (window_px, 1)
    scale = np.float32(1.0) / np.sqrt(cv2.boxFilter(band * band, cv2.CV_32F, size) + np.float32(_LEAST_POWER))
    for shift, limit in limits.items():
        ratio = cv2.boxFilter(band[:, shift:] * band[:, :-shift], cv2.CV_32F, size)
        ratio *= scale[:, shift:]
        ratio *= scale[:, :-shift]
        lowest = least[:, shift:]
        # a smooth edge is like itself at small shifts: a repetition is a likeness that ends and returns
        again = (ratio >= np.float32(limit)) & (lowest <= ratio - np.float32(_DIP))
        found[:, shift:][again] = 1.0
        found[:, :-shift][again] = 1.0
        np.minimum(lowest, ratio, out=lowest)


def patches(disparity: Image, patch_px: int, step_px: float) -> Image:
    """The disparity without patches of less than patch_px pixels; neighbours in a patch differ by at most step_px."""
    fixed = (disparity * np.float32(16.0)).astype(np.int16)
    cv2.filterSpeckles(fixed, -16, patch_px, 16.0 * step_px)
    return np.where(fixed >= 0, disparity, np.float32(-1.0))


def large_patches(disparity: Image, per_px: float, step_px: float) -> Image:
    """The disparity without patches of fewer than per_px pixels for each pixel of their mean disparity. Small patches that touch
    count as one."""
    most_px = int(per_px * float(disparity.max(initial=0.0))) + 1
    small = (disparity >= 0.0) & (patches(disparity, most_px, step_px) < 0.0)
    count, labels = cv2.connectedComponents(small.view(np.uint8), connectivity=4)
    where = np.flatnonzero(small)
    label = labels.ravel()[where]
    pixels = np.bincount(label, minlength=count)
    total = np.bincount(label, weights=disparity.ravel()[where], minlength=count)
    # pixels < per_px * total / pixels
    dropped = where[(pixels * pixels < per_px * total)[label]]
    kept = disparity.copy()
    kept.ravel()[dropped] = -1.0
    return kept


def _patch_labels(disparity: Image, inside: Mask, step_px: float) -> tuple[int, NDArray[np.int32]]:
    """(labels and one more, label (H, W) of the patch of each pixel, 0: not inside). Neighbours in a patch differ by at most step_px."""
    height, width = disparity.shape
    # each second row and column holds the links between neighbours
    grid = np.zeros((2 * height - 1, 2 * width - 1), np.uint8)
    grid[::2, ::2] = inside
    grid[::2, 1::2] = inside[:, 1:] & inside[:, :-1] & (np.abs(np.diff(disparity, axis=1)) <= step_px)
    grid[1::2, ::2] = inside[1:] & inside[:-1] & (np.abs(np.diff(disparity, axis=0)) <= step_px)
    count, labels = cv2.connectedComponents(grid, connectivity=4)
    return count, np.asarray(labels[::2, ::2], np.int32)


def _beside_others(disparity: Image, pixels: Mask) -> Mask:
    """(N,) of these pixels (H, W), all with a disparity, whether the place in the right image lies beside that of a match of another
    disparity."""
    width = disparity.shape[1]
    found = disparity >= 0.0
    matched = disparity[found]
    place = np.flatnonzero(found) - np.rint(matched).astype(np.intp)
    held = np.full(disparity.size, -1.0, np.float32)
    held[place] = matched
    mine = disparity[pixels]
    at = np.flatnonzero(pixels) - np.rint(mine).astype(np.intp)
    column = at % width
    beside = np.zeros(len(at), np.bool_)
    for step in range(-_SHARED_PX, _SHARED_PX + 1):
        other = held[at + np.clip(step, -column, width - 1 - column)]
        beside |= (other >= 0.0) & (np.abs(other - mine) > _SHARED_STEP_PX)
    return beside


def without_shared(disparity: Image, share: float, step_px: float) -> Image:
    """The disparity without patches of one edge of which more than `share` lies in the right image where other matches lie. A
    disparity is at most the column of its pixel."""
    small = (disparity >= 0.0) & (patches(disparity, _EDGE_PX, step_px) < 0.0)
    beside = _beside_others(disparity, small)
    if not beside.any():
        return disparity
    count, labels = _patch_labels(disparity, small, step_px)
    label = labels[small]
    dropped = np.bincount(label, weights=beside, minlength=count) > share * np.bincount(label, minlength=count)
    return np.where(dropped[labels], np.float32(-1.0), disparity)


def rows_agree(left: Gray, right: Gray, disparity: Image) -> Mask:
    """(H, W) whether the derivatives of both images agree at a disparity along the row of a pixel alone, and along both rows beside
    it: the derivative of a row holds a quarter of what these show."""
    g_left, g_right = derivatives_at_match(left, right, disparity)

    def mean(image: Image) -> Image:
        return np.asarray(cv2.boxFilter(image, cv2.CV_32F, (_ROW_PX, 1)))

    both = np.maximum(mean(g_left * g_left) * mean(g_right * g_right), np.float32(1e-12))
    agree = (mean(g_left * g_right) >= np.float32(_ROW_CORRELATION) * np.sqrt(both)).view(np.uint8)
    return np.asarray(cv2.erode(agree, np.ones((3, 1), np.uint8), borderValue=1)).view(np.bool_)


def without_smear(disparity: Image, smear_px: int, smear_rows: int, window_px: int, located: Mask) -> Image:
    """The disparity without the pixels within smear_px of an area without one, and of wider areas without those within smear_rows
    rows, unless `located` (H, W). Holes narrower than window_px are no area."""
    found = (disparity >= 0.0).view(np.uint8)
    closed = cv2.morphologyEx(found, cv2.MORPH_CLOSE, np.ones((window_px, window_px), np.uint8))
    near = np.ones((2 * smear_px + 1, 2 * smear_px + 1), np.uint8)
    tall = np.ones((2 * max(smear_px, smear_rows) + 1, 2 * smear_px + 1), np.uint8)
    # nothing is known beyond the image's border, and nothing is taken from there
    inner = cv2.erode(closed, tall, borderValue=1)
    # what is lower than the window is no border of an area: the steps of a slanted edge, which are measured
    narrower = cv2.erode(closed, near, borderValue=1)
    low = narrower & ~cv2.dilate(inner, tall)
    inner |= narrower & located.view(np.uint8)
    return np.where((inner | low) > 0, disparity, np.float32(-1.0))


def accepted_matches(left: Gray, right: Gray, disparity: Image, limits: ConfidenceLimits) -> Image:
    """The disparity (H, W) float32 px with -1 where the match is not accepted. left, right: (H, W) uint8, rectified."""
    good = disparity >= 0.0
    if limits.correlation > 0.0 or limits.texture > 0.0:
        s = match_statistics(left, right, disparity, limits.window_px)
        good &= s.matched >= _LEAST_MATCHED
        if limits.correlation > 0.0:
            far = disparity < BACKGROUND_PX
            strong = np.where(far, np.float32(limits.far_correlation), np.float32(limits.strong_correlation))
            strong -= _NOISE_SHARES * s.noise_variance / s.variance
            good &= s.correlation >= np.maximum(strong, np.float32(limits.correlation))
        good &= s.variance >= limits.texture * s.noise_variance
    if limits.period < 1.0:
        good &= ~repetitive(left, limits.period, limits.period_px)
    kept = np.where(good, disparity, np.float32(-1.0))
    if limits.patch_px:
        kept = patches(kept, limits.patch_px, _PATCH_STEP_PX)
    if limits.patch_per_px:
        kept = large_patches(kept, limits.patch_per_px, _PATCH_STEP_PX)
    if limits.shared < 1.0:
        kept = without_shared(kept, limits.shared, _PATCH_STEP_PX)
    if limits.smear_px or limits.smear_rows:
        far = (kept >= 0.0) & (kept < _FAR_PX)
        located = far & rows_agree(left, right, kept) if far.any() else far
        kept = without_smear(kept, limits.smear_px, limits.smear_rows, limits.window_px, located)
    if limits.level_px:
        kept = without_level_lines(left, right, kept, limits.level_px, limits.level_correlation)
    return kept
