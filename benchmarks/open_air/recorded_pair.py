"""What a recorded, rectified stereo pair gives: matches, marks, and what is called free or open at assumed tilts.

    python -m benchmarks.open_air.recorded_pair LEFT.png RIGHT.png --f-px 1068.1 --baseline-m 0.12 --out pair.png

The attitude of a recorded pair is not known, so that each tilt is assumed in turn: a wrong tilt is an error of the
mount. The picture shows the left image, the accepted matches and the marks."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.open_air.views import FRAMES, last_model
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.types import (
    BEYOND_MM,
    CONTINUED_MM,
    GREATEST_MARK_MM,
    TEXTURED_MM,
    TEXTURELESS_MM,
    CameraInfo,
    FrameModel,
    Intrinsics,
)
from drivers.cameras.stereo import MatchParams, StereoMatcher
from drivers.cameras.stereo_errors import bias_coefficient, noise_coefficient
from drivers.cameras.zed_uvc import DISPARITY_SIGMA_PX

Gray = NDArray[np.uint8]
WIDTH = 672
"""Width in pixels to which the images are reduced, that of a ZED at VGA."""
COLOURS = {
    TEXTURELESS_MM: (255, 120, 0),
    BEYOND_MM: (0, 220, 220),
    CONTINUED_MM: (0, 0, 255),
    TEXTURED_MM: (90, 90, 90),
}
"""BGR of each mark; measured pixels are green, others black."""
NEAR_M, FAR_M = 0.5, 20.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pair:
    """A rectified pair. left, right: (H, W) uint8; baseline_m: distance between the cameras."""

    left: Gray
    right: Gray
    intrinsics: Intrinsics
    baseline_m: float

    def depth(self) -> NDArray[np.uint16]:
        """(H, W) uint16 mm with marks, as the ZED's driver delivers it with `mark_smooth`."""
        matcher = StereoMatcher(MatchParams(mark_smooth=True))
        return matcher.depth(self.left, self.right, self.intrinsics.fx, self.baseline_m)

    def info(self) -> CameraInfo:
        """The constants of its camera, with the errors that the ZED's driver assumes."""
        optics = self.intrinsics.fx, self.baseline_m
        return CameraInfo(
            "recorded",
            self.intrinsics,
            max_range_m=12.0,
            ke_per_m=noise_coefficient(DISPARITY_SIGMA_PX, *optics),
            marks_smooth=True,
            bias_per_m=bias_coefficient(self.intrinsics, optics[1]),
        )


def load(left: Path, right: Path, f_px: float, baseline_m: float) -> Pair:
    """Reads and reduces the images of a pair; the principal point is assumed in their middle. Raises ValueError."""
    images = []
    for path in (left, right):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError(f"{path}: not a readable image")
        images.append(image)
    full = images[0].shape[1]
    height = round(images[0].shape[0] * WIDTH / full)
    small = [np.asarray(cv2.resize(i, (WIDTH, height), interpolation=cv2.INTER_AREA), np.uint8) for i in images]
    f = f_px * WIDTH / full
    k = Intrinsics(WIDTH, height, f, f, 0.5 * (WIDTH - 1), 0.5 * (height - 1))
    return Pair(left=small[0], right=small[1], intrinsics=k, baseline_m=baseline_m)


def models(pair: Pair, depth: NDArray[np.uint16], pitches_deg: list[float]) -> Iterator[tuple[float, FrameModel]]:
    """(pitch, model) at each assumed pitch, with open space presumed. The second of two equal frames is used."""
    extractor = Extractor(open_sky=OpenSkyParams(mode="presume"))
    for pitch_deg in pitches_deg:
        R = rotation_level_cam_optical(rotation_from_euler(0.0, math.radians(pitch_deg), 0.0) @ R_CAMFRD_OPTICAL)
        yield pitch_deg, last_model(extractor, pair.info(), R, [depth] * FRAMES)[1]


def words(pitch_deg: float, model: FrameModel) -> str:
    """One line on a model."""
    if not model.valid:
        return f"pitch {pitch_deg:+.0f}: invalid, {model.cause}"
    free = model.free
    known = free.free_to_m > free.free_from_m
    layer = int(np.searchsorted(free.layer_edges_m, 0.0, side="right")) - 1
    opened = int((free.open_to_m > free.free_to_m).sum()) if free.has_open else 0
    ground = f"ground {model.ground.height_m:.2f} m below" if model.ground.seen else "no ground"
    return (
        f"pitch {pitch_deg:+.0f}: {len(model.planes)} planes, {ground}, {int(known[:, layer].sum())} of {len(known)} "
        f"directions free in the camera's layer, {opened} cells open"
    )


def coloured(depth: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """(H, W, 3) BGR: near red, far blue, unknown black."""
    metres = np.clip(depth / 1000.0, NEAR_M, FAR_M)
    level = 255.0 * np.log(FAR_M / metres) / np.log(FAR_M / NEAR_M)
    colours = cv2.applyColorMap(level.astype(np.uint8), cv2.COLORMAP_TURBO)
    colours[depth == 0] = 0
    return np.asarray(colours, np.uint8)


def picture(pair: Pair, depth: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """The left image, the distances and the marks, one below the other."""
    marks = np.zeros((*depth.shape, 3), np.uint8)
    marks[depth > GREATEST_MARK_MM] = (0, 160, 0)
    for value, colour in COLOURS.items():
        marks[depth == value] = colour
    measured = np.where(depth > GREATEST_MARK_MM, depth, 0).astype(np.uint16)
    return np.vstack([cv2.cvtColor(pair.left, cv2.COLOR_GRAY2BGR), coloured(measured), marks])


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("left", type=Path)
    p.add_argument("right", type=Path)
    p.add_argument("--f-px", type=float, required=True, help="focal length of the full image, px")
    p.add_argument("--baseline-m", type=float, required=True)
    p.add_argument("--pitch", default="-20,-10,0,10,20", help="assumed pitches, degrees")
    p.add_argument("--out", type=Path, default=Path("bench-out/recorded_pair.png"))
    a = p.parse_args(arguments)
    try:
        pair = load(a.left, a.right, a.f_px, a.baseline_m)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    depth = pair.depth()
    share = [float((depth == value).mean()) for value in COLOURS]
    print(
        f"measured {(depth > GREATEST_MARK_MM).mean():.1%}, textureless {share[0]:.1%}, beyond 65 m {share[1]:.1%}, "
        f"continued {share[2]:.1%}, textured {share[3]:.1%}"
    )
    for pitch_deg, model in models(pair, depth, [float(t) for t in a.pitch.split(",")]):
        print(words(pitch_deg, model))
    a.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(a.out), picture(pair, depth))
    print(a.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
