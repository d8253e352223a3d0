"""How clearly both images show with which of them the depth of a device is aligned (drivers/cameras/depth_alignment.py).

    python -m benchmarks.open_air.aligned_side

Views of rendered scenes, matched by the model of a device from either image."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from benchmarks.open_air.view_options import words
from companion.argument_parser import ArgumentParser
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from drivers.cameras.depth_alignment import alignment_pixels
from drivers.cameras.stereo import depth_mm
from drivers.simulation.stereo.census_matching import census_disparity
from drivers.simulation.stereo.stereo_profiles import OAK, StereoCamera
from drivers.simulation.stereo.stereo_scenes import make_stereo_scene

SCENES = ("street", "field_with_trees", "white_pillars", "container_8m", "wires", "hill_crest", "overhang")
POSES = ((0.0, 0.0, 2.0), (34.4, -11.5, 3.0), (-22.9, 0.0, 6.0))
"""Heading and pitch, degrees, and height, metres."""


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--scenes", type=words, default=list(SCENES))
    camera, census = StereoCamera(OAK), OAK.census
    assert census is not None
    f_b_px_m = OAK.view.intrinsics.fx * OAK.view.baseline_m
    sys.stdout.write(
        "scene, heading, pitch, height: pixels that fit left, right; depth of the left, of the right image\n"
    )
    for name in p.parse_args(arguments).scenes:
        for heading_deg, pitch_deg, height_m in POSES:
            R = rotation_from_euler(0.0, np.radians(pitch_deg), np.radians(heading_deg)) @ R_CAMFRD_OPTICAL
            pair = camera.pair(make_stereo_scene(name), R, np.array([0.0, 0.0, -height_m]), 0)
            images = pair.left, pair.right
            right, left = (np.ascontiguousarray(image[:, ::-1]) for image in (pair.right, pair.left))
            of_left = depth_mm(census_disparity(*images, census), f_b_px_m)
            of_right = depth_mm(census_disparity(right, left, census), f_b_px_m)[:, ::-1].copy()
            counts = (
                alignment_pixels(depth, images, f_b_px_m, OAK.match.window_px | 1) for depth in (of_left, of_right)
            )
            sys.stdout.write(f"{name}, {heading_deg:g}, {pitch_deg:g}, {height_m:g}: {', '.join(map(str, counts))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
