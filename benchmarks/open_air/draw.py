"""Pictures of rendered stereo: the left image, every match, and the accepted ones.

python -m benchmarks.open_air.draw --out bench-out/stereo.png --scenes field_with_trees,container_8m,white_pillars,fence"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.open_air.views import View, every_match, pose_of, profile_of, scene_of
from companion.argument_parser import ArgumentParser
from drivers.cameras.stereo import depth_mm
from drivers.simulation.stereo.pair_renderer import with_noise
from drivers.simulation.stereo.stereo_profiles import StereoCamera

Colours = NDArray[np.uint8]
NEAR_M, FAR_M = 0.5, 20.0
GAP_PX = 6


def coloured(depth: NDArray[np.uint16]) -> Colours:
    """(H, W, 3) BGR: near red, far blue, unknown black."""
    metres = np.clip(depth / 1000.0, NEAR_M, FAR_M)
    level = 255.0 * np.log(FAR_M / metres) / np.log(FAR_M / NEAR_M)
    colours = cv2.applyColorMap(level.astype(np.uint8), cv2.COLORMAP_TURBO)
    colours[depth == 0] = 0
    return np.asarray(colours, np.uint8)


def column(view: View, noise_grey: float) -> Colours:
    """The image of a view, the depth of every match and of the accepted ones, one below the other."""
    scene = scene_of(view.scene, view.seed, view.sky)
    profile = profile_of(view.profile)
    profile = replace(profile, view=with_noise(profile.view, noise_grey))
    camera = StereoCamera(profile)
    pair = camera.pair(scene, *pose_of(view, scene), view.seed)
    disparities = (StereoCamera(p).disparity(pair) for p in (every_match(profile), profile))
    k = profile.view
    depths = [coloured(depth_mm(d, k.intrinsics.fx * k.baseline_m)) for d in disparities]
    gap = np.full((GAP_PX, pair.left.shape[1], 3), 255, np.uint8)
    return np.vstack([cv2.cvtColor(pair.left, cv2.COLOR_GRAY2BGR), gap, depths[0], gap, depths[1]])


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--scenes", default="field_with_trees,container_8m,white_pillars,fence")
    p.add_argument("--profile", default="zed")
    p.add_argument("--sky", default="clear")
    p.add_argument("--noise", type=float, default=1.0, help="grey levels")
    p.add_argument("--scale", type=float, default=0.5)
    p.add_argument("--out", type=Path, default=Path("bench-out/stereo.png"))
    a = p.parse_args(arguments)
    columns = [column(View(scene=s, profile=a.profile, sky=a.sky), a.noise) for s in a.scenes.split(",")]
    gap = np.full((len(columns[0]), GAP_PX, 3), 255, np.uint8)
    picture = np.hstack([part for c in columns for part in (c, gap)][:-1])
    picture = cv2.resize(picture, None, fx=a.scale, fy=a.scale, interpolation=cv2.INTER_AREA)
    a.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(a.out), picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
