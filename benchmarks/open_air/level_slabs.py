"""Blank slabs that fill the upper half of the view and end at the horizon, and how many of their pixels are called open.

    python -m benchmarks.open_air.level_slabs
    python -m benchmarks.open_air.level_slabs --profile oak_wide --roll 0,1,3

24 views for each roll: slabs at 3 and 8 m, dark and bright, whose lower edge lies up to 1.2 degrees from the horizon, with both edges
outside of the view and with one upright edge in the middle of it (`part`). The second of two frames over grass, clear sky, 2 m up."""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections import Counter

import numpy as np

from benchmarks.open_air.odd_claims import LEAST_PX, wrong_pixels
from benchmarks.open_air.odd_scenes import painted
from benchmarks.open_air.open_claims import as_free, marked
from benchmarks.open_air.view_options import words
from benchmarks.open_air.views import profile_of
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import ExtractorState
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered, look
from drivers.simulation.stereo.pair_renderer import expose_pair
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_profiles import PROFILES, StereoCamera
from drivers.simulation.stereo.stereo_scenes import StereoScene, surfaces_of
from drivers.simulation.stereo.textures import Material

DISTANCES_M, ALBEDOS, ABOVE_DEG = (3.0, 8.0), (0.15, 0.6), (-1.2, -0.6, -0.2, 0.2, 0.6, 1.2)
HEIGHT_M, WIDTH_M = 2.0, 40.0
FULL, PART = "full", "part"


def slab_scene(distance_m: float, albedo: float, above_deg: float, first_m: float) -> StereoScene:
    """A slab over grass whose lower edge lies above_deg above the horizon of a camera HEIGHT_M up; it begins first_m to the right."""
    builder = SceneBuilder("slab")
    builder.ground()
    low_m = HEIGHT_M + distance_m * math.tan(math.radians(above_deg))
    builder.box("slab", distance_m + 0.25, first_m + 0.5 * WIDTH_M, 0.5, WIDTH_M, 30.0, 0.0, low_m)
    surfaces = painted(surfaces_of(builder.build()), {"slab": Material(albedo=albedo)})
    return StereoScene(name="slab", surfaces=surfaces, sky=SKIES["clear"])


def wrong_px(scene: StereoScene, roll_deg: float, camera: StereoCamera, extractor: Extractor) -> int:
    """Pixels of the slab in cells that are free or open."""
    R = rotation_from_euler(math.radians(roll_deg), 0.0, 0.03) @ R_CAMFRD_OPTICAL
    at, R_level, info, state = (
        np.array([0.0, 0.0, -HEIGHT_M]),
        rotation_level_cam_optical(R),
        camera.profile.info(),
        ExtractorState(),
    )
    bright = camera.brightness(scene, R, at, 0)
    for number in range(2):
        depth = camera.depth_of(expose_pair(bright, camera.profile.view.exposure, 0, number))
        model, state = extractor.extract(depth, info, R_level, state=state)
    if not model.valid:
        return 0
    frame = Rendered(scene.scene, info, depth, R, R_level, at, look(scene.scene, info, R, at))
    return int(wrong_pixels(frame, as_free(model), Params()).sum())


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--profile", choices=list(PROFILES), default="zed")
    p.add_argument("--roll", type=words, default=[0.0], help="degrees")
    p.add_argument(
        "--slabs", type=words, default=[FULL, PART], help="full: both edges outside of the view; part: one inside"
    )
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    a = parse(arguments)
    camera = StereoCamera(marked(profile_of(a.profile)))
    extractor = Extractor(Params(), OpenSkyParams(mode="presume"))
    counts: dict[tuple[str, float], Counter[str]] = {}
    for slab, (distance_m, albedo, above_deg) in itertools.product(
        a.slabs, itertools.product(DISTANCES_M, ALBEDOS, ABOVE_DEG)
    ):
        scene = slab_scene(distance_m, albedo, above_deg, 0.0 if slab == PART else -0.5 * WIDTH_M)
        for roll in map(float, a.roll):
            wrong = wrong_px(scene, roll, camera, extractor)
            counts.setdefault((slab, roll), Counter()).update(views=1, wrong=int(wrong >= LEAST_PX))
            if wrong >= LEAST_PX:
                print(
                    f"{slab}, roll {roll:g}, {distance_m:g} m, albedo {albedo:g}, {above_deg:g} degrees: {wrong} px",
                    flush=True,
                )
    for (slab, roll), count in counts.items():
        print(f"{slab}, roll {roll:g}: {count['wrong']} of {count['views']} views wrong")
    return 0


if __name__ == "__main__":
    sys.exit(main())
