"""Compares a recorded, rectified stereo pair with a measured disparity: the accepted matches, and the model of the frame.

    python -m benchmarks.open_air.recorded_truth LEFT.png RIGHT.png TRUTH.png --f-px 721.5 --baseline-m 0.532 \\
        --centre-px 609.6 172.9 --max-range-m 20

TRUTH is a 16-bit PNG in the size of the images, disparity times 256, 0: not measured (the form of the KITTI benchmark), such
as the points of a laser scanner. The camera is assumed to stand upright, with `--pitch` degrees.

Matches: share of the measured points with one; median and robust standard deviation of matched less measured disparity;
share that is nearer or farther by more than 2 px. Model: of the obstacle points whose match is right within 1 px, those
let pass by more than max(0.5 m, 2 sigma), those that the margins cover, and those inside of free or open cells."""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.coverage import ROUNDING_M, within_margin
from benchmarks.fidelity.metrics import MISSED_M, stops
from benchmarks.open_air.recorded_pair import Pair, load
from benchmarks.open_air.views import FRAMES, last_model
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.types import FrameModel
from drivers.cameras.stereo import MatchParams, StereoMatcher

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
STEPS_PER_PX = 256.0
"""Of the disparity in the file."""
OUTLIER_PX = 2.0
RIGHT_PX = 1.0
BANDS_PX = (1.0, 4.0, 8.0, 16.0, 32.0, 96.0)
"""Edges of the bands of disparity."""
LEAST_HEIGHT_M = 0.6
"""Height above the ground from which on a point is an obstacle."""
RANGE_SHARE = 0.9
"""Points beyond this share of the range are not obstacles: the noise makes them far."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Points:
    """Measured points of a pair, in the size of the reduced image. u, v: (N,) places; disparity_px: (N,)."""

    u: Floats
    v: Floats
    disparity_px: Floats

    def pixels(self, shape: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(rows, columns) of the nearest pixels of an image of this shape."""
        rows = np.clip(np.rint(self.v), 0, shape[0] - 1).astype(np.intp)
        return rows, np.clip(np.rint(self.u), 0, shape[1] - 1).astype(np.intp)


def load_truth(path: Path, pair: Pair) -> Points:
    """Reads measured disparities for a pair that `load` has reduced. Raises ValueError."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError(f"{path}: not a 16-bit grey PNG")
    scale = pair.intrinsics.width / image.shape[1]
    if round(image.shape[0] * scale) != pair.intrinsics.height:
        raise ValueError(f"{path}: {image.shape[1]}x{image.shape[0]} px does not fit to the images")
    v, u = np.nonzero(image)
    disparity = image[v, u] / STEPS_PER_PX * scale
    return Points(u=(u + 0.5) * scale - 0.5, v=(v + 0.5) * scale - 0.5, disparity_px=disparity)


def match_lines(error_px: Floats, matched: Mask, truth_px: Floats) -> Iterator[str]:
    """Rows of a table, for all points and for each band of disparity. error_px: (N,) matched less measured."""
    yield "| disparity, px | points | matched % | median px | sigma px | nearer by > 2 px % | farther % |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    edges = [(BANDS_PX[0], BANDS_PX[-1]), *itertools.pairwise(BANDS_PX)]
    for low, high in edges:
        inside = (truth_px >= low) & (truth_px < high)
        e = error_px[inside & matched]
        if len(e):
            middle = float(np.median(e))
            sigma = 1.4826 * float(np.median(np.abs(e - middle)))
            yield (
                f"| {low:g} to {high:g} | {inside.sum()} | {100 * matched[inside].mean():.1f} | {middle:+.2f} | {sigma:.2f} | "
                f"{100 * (e > OUTLIER_PX).mean():.2f} | {100 * (e < -OUTLIER_PX).mean():.2f} |"
            )


def model_of(pair: Pair, R: Floats, max_range_m: float, bias_px: float) -> FrameModel:
    """The model of the second of two equal frames, with open space presumed. R: level_cam from optical."""
    bias = bias_px / (pair.intrinsics.fx * pair.baseline_m)
    info = replace(pair.info(), max_range_m=max_range_m, bias_per_m=bias)
    extractor = Extractor(open_sky=OpenSkyParams(mode="presume"))
    return last_model(extractor, info, R, [pair.depth()] * FRAMES)[1]


def inside_cells(model: FrameModel, points_m: Floats, slack_m: Floats) -> tuple[int, int]:
    """Numbers of points (N, 3) in level_cam that lie in free cells, in open cells, by more than slack_m (N,) from both ends."""
    free = model.free
    d = np.searchsorted(free.azimuth_edges_rad, np.arctan2(points_m[:, 1], points_m[:, 0]), side="right") - 1
    k = np.searchsorted(free.layer_edges_m, points_m[:, 2], side="right") - 1
    directions, layers = free.free_to_m.shape
    ok = (d >= 0) & (d < directions) & (k >= 0) & (k < layers)
    at, range_m, slack = (d[ok], k[ok]), np.hypot(points_m[ok, 0], points_m[ok, 1]), slack_m[ok]

    def count(first_m: Floats, last_m: Floats) -> int:
        return int(((range_m > first_m + slack) & (range_m < last_m - slack)).sum())

    opened = count(free.open_from_m[at], free.open_to_m[at]) if free.has_open else 0
    return count(free.free_from_m[at], free.free_to_m[at]), opened


def model_line(pair: Pair, points: Points, right: Mask, R: Floats, max_range_m: float, bias_px: float) -> str:
    """A row of a table: the model with a bias of bias_px. right: (N,) the match is right within RIGHT_PX."""
    model, k = model_of(pair, R, max_range_m, bias_px), pair.intrinsics
    if not (model.valid and model.ground.seen):
        return f"| {bias_px:g} | no ground was found; try another --pitch | | | | | |"
    z = k.fx * pair.baseline_m / points.disparity_px
    directions = np.column_stack([(points.u - k.cx) / k.fx, (points.v - k.cy) / k.fy, np.ones_like(z)]) @ R.T
    p, g = directions * z[:, None], model.ground
    height_m = g.height_m + g.slope_x * p[:, 0] + g.slope_y * p[:, 1] - p[:, 2]
    at = points.pixels((k.height, k.width))
    obstacle = right & (height_m > LEAST_HEIGHT_M) & (np.hypot(p[:, 0], p[:, 1]) < RANGE_SHARE * max_range_m)
    planes, sigma_m = model.planes.astype(np.float64), model.ke_per_m * z**2
    stop_m = stops(planes, k, R)[0][at]
    missed = stop_m > z + np.fmax(MISSED_M, 2.0 * sigma_m)
    covered = stop_m <= z + ROUNDING_M
    covered |= within_margin(p, planes, model.margin_m.astype(np.float64)) if len(planes) else False
    in_free, in_open = inside_cells(model, p[obstacle], 2.0 * sigma_m[obstacle])
    return (
        f"| {bias_px:g} | {len(planes)} | {obstacle.sum()} | {100 * missed[obstacle].mean():.2f} | "
        f"{100 * covered[obstacle].mean():.1f} | {in_free} | {in_open} |"
    )


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("left", type=Path)
    p.add_argument("right", type=Path)
    p.add_argument("truth", type=Path)
    p.add_argument("--f-px", type=float, required=True, help="focal length of the full image, px")
    p.add_argument("--baseline-m", type=float, required=True)
    p.add_argument("--centre-px", type=float, nargs=2, metavar=("CX", "CY"), required=True, help="of the full image")
    p.add_argument("--max-range-m", type=float, default=20.0)
    p.add_argument("--pitch", type=float, default=0.0, help="degrees")
    p.add_argument("--bias-px", type=float, nargs="+", default=[0.0, 0.15], help="a row for each")
    a = p.parse_args(arguments)
    try:
        pair = load(a.left, a.right, a.f_px, a.baseline_m)
        points = load_truth(a.truth, pair)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    scale = pair.intrinsics.fx / a.f_px
    cx, cy = ((c + 0.5) * scale - 0.5 for c in a.centre_px)
    pair = replace(pair, intrinsics=replace(pair.intrinsics, cx=cx, cy=cy))
    disparity = StereoMatcher(MatchParams()).disparity(pair.left, pair.right)[points.pixels(pair.left.shape)]
    error_px, matched = disparity - points.disparity_px, disparity >= 0.0
    print("\n".join(match_lines(error_px, matched, points.disparity_px)), end="\n\n")
    print("| bias px | planes | obstacle points | missed % | covered % | in free cells | in open cells |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    level = rotation_from_euler(0.0, math.radians(a.pitch), 0.0) @ R_CAMFRD_OPTICAL
    right = matched & (np.abs(error_px) < RIGHT_PX)
    for bias_px in a.bias_px:
        print(model_line(pair, points, right, rotation_level_cam_optical(level), a.max_range_m, bias_px))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
