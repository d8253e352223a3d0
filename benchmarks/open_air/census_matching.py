"""Census matching along image rows with path penalties, as cameras do it in hardware: cost, paths, confidence, subpixel,
left-right check. Written from public descriptions of the method; no camera's own code or exact tables are known. A bit of the
census compares a pixel with the centre of the window; an OAK compares with the mean of the window by default (DepthAI 3.12,
CensusTransform.enableMeanMode)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulation.stereo.exposure import Gray
from drivers.simulation.stereo.textures import kernel

_NONE = -1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CensusParams:
    """Parameters of the matching."""

    disparities: int = 96  # searched
    # rows, columns: of the census window
    rows: int = 5
    columns: int = 7
    threshold_grey: int = 0  # a pixel counts as darker than the centre of the window only by more than this
    # p1, p2: penalties of a step of one and of more, in bits
    p1: int = 4
    p2: int = 16
    paths: int = 4  # 4 (both directions of rows and columns) or 2 (rows only)
    least_margin: float = 0.05  # the best cost must lie this share below the best one elsewhere
    most_cost: float = 0.35  # share of the census bits that may differ
    check_px: float = 1.0  # left and right agree within
    subpixel_bits: int = 3  # steps of 1 / 2^bits px (5 by default in DepthAI 3.12 and in a D400)
    speckle_px: int = 0  # smaller patches are dropped, 0 none

    def disparity(self, left: Gray, right: Gray) -> NDArray[np.float32]:
        """(H, W) float32 px of a rectified pair, -1: no match."""
        return census_disparity(left, right, self)


@kernel
def _census(image: Gray, rows: int, columns: int, threshold: int, out: NDArray[np.uint64]) -> None:
    """A bit for each pixel of the window that is darker than its centre by more than a threshold -> out (H, W)."""
    height, width = image.shape
    half_v, half_u = rows // 2, columns // 2
    for v in range(half_v, height - half_v):
        for u in range(half_u, width - half_u):
            bits = np.uint64(0)
            centre = int(image[v, u]) - threshold
            for dv in range(-half_v, half_v + 1):
                for du in range(-half_u, half_u + 1):
                    if dv == 0 and du == 0:
                        continue
                    bits = bits << np.uint64(1)
                    if image[v + dv, u + du] < centre:
                        bits |= np.uint64(1)
            out[v, u] = bits


@kernel
def _bit_count(bits: np.uint64) -> int:
    x = bits - ((bits >> np.uint64(1)) & np.uint64(0x5555555555555555))
    x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
    x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return int((x * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def _costs(left: NDArray[np.uint64], right: NDArray[np.uint64], worst: int, out: NDArray[np.uint8]) -> None:
    """Differing bits -> out (H, W, D); `worst` where the right image ends."""
    height, width, disparities = out.shape
    for v in range(height):
        for u in range(width):
            for d in range(disparities):
                out[v, u, d] = _bit_count(left[v, u] ^ right[v, u - d]) if u >= d else worst


@kernel
def _step(cost: NDArray[np.uint8], before: NDArray[np.int32], p1: int, p2: int, after: NDArray[np.int32]) -> None:
    """One step of a path: costs of the pixel (D,) with those before it on the path -> after (D,)."""
    disparities = len(cost)
    least = before[0]
    for d in range(1, disparities):
        least = min(least, before[d])
    for d in range(disparities):
        best = min(before[d], least + p2)
        if d > 0:
            best = min(best, before[d - 1] + p1)
        if d < disparities - 1:
            best = min(best, before[d + 1] + p1)
        after[d] = cost[d] + best - least


@kernel
def _paths(cost: NDArray[np.uint8], p1: int, p2: int, columns_too: bool, total: NDArray[np.uint16]) -> None:
    """Sums of the path costs -> total (H, W, D)."""
    height, width, disparities = cost.shape
    zero = np.zeros(disparities, np.int32)
    a, b = np.empty(disparities, np.int32), np.empty(disparities, np.int32)
    for v in range(height):
        for way in range(2):
            a[:] = zero
            for i in range(width):
                u = i if way == 0 else width - 1 - i
                _step(cost[v, u], a, p1, p2, b)
                for d in range(disparities):
                    total[v, u, d] += b[d]
                a, b = b, a
    if not columns_too:
        return
    above, here = np.zeros((width, disparities), np.int32), np.empty((width, disparities), np.int32)
    for way in range(2):
        above[:] = 0
        for i in range(height):
            v = i if way == 0 else height - 1 - i
            for u in range(width):
                _step(cost[v, u], above[u], p1, p2, here[u])
                for d in range(disparities):
                    total[v, u, d] += here[u, d]
            above, here = here, above


@kernel
def _choose(
    total: NDArray[np.uint16],
    cost: NDArray[np.uint8],
    margin: float,
    most_bits: float,
    check_px: float,
    left_d: NDArray[np.float32],
    right_d: NDArray[np.int32],
) -> None:
    """Disparity (H, W) float32 px, -1 where the match is not sure or the right image disagrees; right_d: scratch."""
    height, width, disparities = total.shape
    for v in range(height):
        for u in range(width):
            best, at = 1 << 30, 0
            for d in range(min(disparities, width - u)):
                if total[v, u + d, d] < best:
                    best, at = total[v, u + d, d], d
            right_d[v, u] = at
        for u in range(width):
            left_d[v, u] = _NONE
            t = total[v, u]
            best, at = 1 << 30, 0
            for d in range(min(disparities, u + 1)):
                if t[d] < best:
                    best, at = int(t[d]), d
            second = 1 << 30
            for d in range(min(disparities, u + 1)):
                if abs(d - at) > 1:
                    second = min(second, int(t[d]))
            if best >= (1.0 - margin) * second or cost[v, u, at] > most_bits:
                continue
            if abs(right_d[v, u - at] - at) > check_px:
                continue
            fine = float(at)
            if 0 < at < disparities - 1 and at < u:
                low, high = float(t[at - 1]), float(t[at + 1])
                # two straight lines of one slope: the form of a sum of absolute differences
                fine += 0.5 * (low - high) / max(max(low, high) - best, 1.0)
            left_d[v, u] = fine


def census_disparity(left: Gray, right: Gray, p: CensusParams) -> NDArray[np.float32]:
    """(H, W) float32 px of a rectified pair, -1: no match."""
    codes = []
    for image in (left, right):
        code = np.zeros(image.shape, np.uint64)
        _census(np.ascontiguousarray(image), p.rows, p.columns, p.threshold_grey, code)
        codes.append(code)
    bits = p.rows * p.columns - 1
    cost = np.empty((*left.shape, p.disparities), np.uint8)
    _costs(codes[0], codes[1], bits, cost)
    total = np.zeros(cost.shape, np.uint16)
    _paths(cost, p.p1, p.p2, p.paths == 4, total)
    found, scratch = np.empty(left.shape, np.float32), np.empty(left.shape, np.int32)
    _choose(total, cost, p.least_margin, p.most_cost * bits, p.check_px, found, scratch)
    step = float(1 << p.subpixel_bits)
    found = np.where(found >= 0.0, np.rint(found * step) / step, np.float32(_NONE)).astype(np.float32)
    if p.speckle_px:
        fixed = np.where(found >= 0.0, np.rint(found * 16.0), -16.0).astype(np.int16)
        cv2.filterSpeckles(fixed, -16, p.speckle_px, 32)
        found = np.where(fixed >= 0, found, np.float32(_NONE))
    border = max(p.rows, p.columns) // 2
    found[:border], found[-border:], found[:, :border], found[:, -border:] = _NONE, _NONE, _NONE, _NONE
    return found
