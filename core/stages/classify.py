"""Pixel classification: marks each pixel of the depth image as measured, unknown or far, and removes flying pixels.

Input: the depth image as the camera delivers it. Output: `marks`, an image (H, W) of uint16 that holds the depth in
millimetres where a pixel is measured, UNKNOWN_MM or FAR_MM elsewhere.

The paper has no such stage. It is needed because a real depth image contains invalid values, values beyond the range
in which the noise is known, and interpolated values at the edges of objects (flying pixels).

Kernels compute disparity as 1000/mm in float32 where they need it: the division is faster than a look-up table."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_ieee, inner_inline, kernel
from ..params import Params
from ..types import FAR_MM, SATURATED_MM, CameraInfo


class PixelLimits(NamedTuple):
    """Limits of `classify`, see `pixel_limits`."""

    # uint16, least depth that counts as measured. Closer pixels are unknown, as are the marks up to GREATEST_MARK_MM.
    least_mm: Any
    greatest_mm: Any  # uint16, greatest depth that counts as measured. Pixels farther away are far.
    relative: Any  # float32. Two pixels lie apart if their 1/Z differ by more than a step of absolute + relative / Z.
    absolute: Any  # float32, 1/m, see `relative`


_FAR, _SATURATED = np.uint16(FAR_MM), np.uint16(SATURATED_MM)
UNKNOWN_INVERSE = np.float32(-1.0)
"""1/Z of a pixel without a measurement. 0 is that of a far pixel."""
_LEAST_M, _MOST_M = np.float32(0.0005), np.float32(65.533)
"""Limits of a depth in metres that is rounded to 1..65533 mm. Greater values of uint16 are marks."""


@inner
def metres_to_mm(metres, out):
    """Converts depth in metres, (H, W) float32, to millimetres, (H, W) uint16. Values that are no valid depth become
    UNKNOWN_MM."""
    for v in range(metres.shape[0]):
        line, mm = metres[v], out[v]
        for u in range(len(line)):
            z = line[u]
            good = (z > _LEAST_M) & (z < _MOST_M)
            rounded = np.int32((z if good else np.float32(0.0)) * np.float32(1000.0) + np.float32(0.5))
            mm[u] = np.uint16(rounded if good else 0)


def depth_to_mm(depth: NDArray[np.uint16] | NDArray[np.float32], out: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Returns the depth image as read-only, C-contiguous uint16 millimetres.

    Values of a float32 image that are not finite, not positive or beyond 65.533 m become UNKNOWN_MM. That includes
    infinity, because most stereo drivers write it where they found no match.

    Args:
        depth: (H, W) uint16 millimetres or float32 metres.
        out: (H, W) uint16. It receives the result if the image must be converted or copied; otherwise the result is a
            view of `depth`.

    Raises:
        ValueError: the dtype is another one, or the shape differs from that of `out`."""
    flags = depth.flags
    if depth.dtype is out.dtype and depth.shape == out.shape and flags.c_contiguous and not flags.writeable:
        return depth.view(np.uint16)
    if depth.shape != out.shape:
        raise ValueError(
            f"depth image is {depth.shape[1::-1]}, the camera's intrinsics say {out.shape[1::-1]} (width, height): "
            "use the intrinsics of this resolution"
        )
    if depth.dtype == np.float32:
        metres_to_mm(np.ascontiguousarray(depth), out)
    elif depth.dtype != np.uint16:
        raise ValueError(f"depth of dtype {depth.dtype}: expected uint16 millimetres or float32 metres")
    elif not depth.flags.c_contiguous:
        np.copyto(out, depth)
    view = depth.view(np.uint16) if depth.dtype == np.uint16 and depth.flags.c_contiguous else out.view()
    view.flags.writeable = False
    return view


def clear_range_m(info: CameraInfo, ke_per_m: float, params: Params) -> float:
    """Returns the greatest depth that counts as measured, in metres. Pixels beyond it are marked FAR_MM.

    The limit is `clear_sigmas` of noise closer than the maximum range of the camera. Of a surface near the maximum
    range only the pixels whose noise makes them too close are within the range; without the margin they would form an
    obstacle metres in front of the surface."""
    return info.max_range_m / (1.0 + params.clear_sigmas * ke_per_m * info.max_range_m)


def pixel_limits(info: CameraInfo, ke_per_m: float, params: Params) -> PixelLimits:
    """Returns the limits of pixels for a camera and the noise coefficient in use."""
    return PixelLimits(
        least_mm=np.uint16(info.least_mm),
        greatest_mm=np.uint16(math.floor(1000.0 * clear_range_m(info, ke_per_m, params))),
        relative=np.float32(params.flying_relative),
        absolute=np.float32(params.flying_sigmas * ke_per_m),
    )


@inner_ieee
def inverse_of_row(mm, least, greatest, out):
    """Computes 1/Z of one row of the depth image.

    Args:
        mm: (W,) uint16.
        least: uint16. Pixels with a smaller value are unknown.
        greatest: uint16. Pixels with a greater value are far.
        out: (W,) float32 out, 1/m: 0 where the pixel is far, UNKNOWN_INVERSE where it is unknown."""
    for u in range(len(mm)):
        z = mm[u]
        d = np.float32(1000.0) / np.float32(z)
        if z > greatest:
            d = np.float32(0.0)
        if (z < least) | (z == _SATURATED):
            d = UNKNOWN_INVERSE
        out[u] = d


@kernel
def inverse_image(depth_mm, limits):
    """Returns 1/Z of an image as `inverse_of_row`, (H + 2, W + 2) float32. The border is unknown."""
    rows, cols = depth_mm.shape
    out = np.full((rows + 2, cols + 2), UNKNOWN_INVERSE, np.float32)
    for v in range(rows):
        inverse_of_row(depth_mm[v], limits.least_mm, limits.greatest_mm, out[v + 1, 1 : cols + 1])
    return out


@inner_ieee
def inverse_at(depth_mm, v, u, limits):
    """Returns 1/Z of a pixel in 1/m as `inverse_of_row`. Outside of the image it is unknown."""
    if v < 0 or v >= depth_mm.shape[0] or u < 0 or u >= depth_mm.shape[1]:
        return UNKNOWN_INVERSE
    z = depth_mm[v, u]
    if z < limits.least_mm or z == _SATURATED:
        return UNKNOWN_INVERSE
    return np.float32(0.0) if z > limits.greatest_mm else np.float32(1000.0) / np.float32(z)


@inner_inline
def is_between(d, a, b, step):
    """True if both neighbours a and b are measured and 1/Z of a pixel lies between theirs, a step away from both."""
    low, high = min(a, b), max(a, b)
    return (low > np.float32(0.0)) & (d - low > step) & (high - d > step)


@inner_ieee
def flies_off_line(depth_mm, v, u, dv, du, limits):
    """True if a pixel is flying between its neighbours (dv, du) to either side, and on neither side in line with
    two."""
    zero = np.float32(0.0)
    d = inverse_at(depth_mm, v, u, limits)
    a, b = inverse_at(depth_mm, v - dv, u - du, limits), inverse_at(depth_mm, v + dv, u + du, limits)
    step = limits.absolute + limits.relative * d
    if not is_between(d, a, b, step):
        return False
    c = inverse_at(depth_mm, v - 2 * dv, u - 2 * du, limits)
    if c > zero and abs(c - a - a + d) <= step:
        return False
    c = inverse_at(depth_mm, v + 2 * dv, u + 2 * du, limits)
    return not (c > zero and abs(c - b - b + d) <= step)


@inner
def keep_slanted(depth_mm, v, flies, limits, marks):
    """Restores the marks of flying pixels that lie on a surface, and returns their number.

    On a plane 1/Z is linear along rows and columns. A surface seen edge-on changes by more than a step from pixel to
    pixel, so that most of its pixels lie strictly between their neighbours. They are kept if 1/Z of the pixel and of two
    next to it on one side lie on a line. Beside a flying pixel the two are on one of the surfaces, and the pixel is more
    than a step away.
    flies: (W,) bool, True: flying; marks: (W,) uint16 of the row, in and out."""
    kept = 0
    for u in range(len(flies)):
        if not flies[u]:
            continue
        if flies_off_line(depth_mm, v, u, 0, 1, limits) or flies_off_line(depth_mm, v, u, 1, 0, limits):
            continue
        marks[u] = depth_mm[v, u]
        kept += 1
    return kept


@kernel
def classify(depth_mm, limits, out):
    """Marks every pixel and returns the number of measured, far and flying pixels.

    A flying pixel lies strictly between its left and right neighbours, or between its upper and lower neighbours, and
    differs from both by more than a step. It becomes unknown. A pixel in front of both neighbours may be a thin
    object and is kept, and so is one on the surface of its neighbours (`keep_slanted`).

    The inner loop has no branch, so that the compiler can vectorise it. Three rows of 1/Z are kept at a time.
    out: (H, W) uint16, the marks."""
    rows, cols = depth_mm.shape
    least, greatest, zero = limits.least_mm, limits.greatest_mm, np.float32(0.0)
    # 1/Z of the previous, the present and the next row, with a border
    inverse = np.full((3, cols + 2), UNKNOWN_INVERSE, np.float32)
    inverse_of_row(depth_mm[0], least, greatest, inverse[0, 1 : cols + 1])
    flies = np.zeros(cols, np.bool_)
    measured, far, flying = 0, 0, 0
    for v in range(rows):
        here, after = inverse[v % 3], inverse[(v + 1) % 3, 1 : cols + 1]
        if v + 1 < rows:
            inverse_of_row(depth_mm[v + 1], least, greatest, after)
        else:
            after[:] = UNKNOWN_INVERSE
        left, middle, right, before = here[:cols], here[1 : cols + 1], here[2:], inverse[(v + 2) % 3, 1 : cols + 1]
        mm, marks = depth_mm[v], out[v]
        # 32 bits, as wide as 1/Z: wider sums would halve the number of pixels per instruction
        row_measured, row_far, row_flying = np.int32(0), np.int32(0), np.int32(0)
        for u in range(cols):
            d = middle[u]
            step = limits.absolute + limits.relative * d
            fly = is_between(d, left[u], right[u], step) | is_between(d, before[u], after[u], step)
            mark = mm[u]
            if d == zero:
                mark = _FAR
            if (d < zero) | fly:
                mark = np.uint16(0)
            marks[u], flies[u] = mark, fly
            row_measured = np.int32(row_measured + np.int32(d > zero))
            row_far = np.int32(row_far + np.int32(d == zero))
            row_flying = np.int32(row_flying + np.int32(fly))
        measured += int(row_measured)
        far += int(row_far)
        if row_flying > 0:
            flying += row_flying - keep_slanted(depth_mm, v, flies, limits, marks)
    return measured, far, flying
