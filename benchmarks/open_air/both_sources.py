"""The figures of fidelity for both sources of depth: ray-cast depth with the noise model, and rendered pairs through the matcher.

    python -m benchmarks.open_air.both_sources
    python -m benchmarks.open_air.both_sources --profiles zed --scenes street,white_pillars --all

Both see the same scenes from the same places with the same camera. The noise model has the faults of the fidelity run ("all")
at the noise that the driver states. It knows neither texture nor light, so it is run once for each scene and seed. Of three
seeds, skies and levels of sensor noise each pair occurs once in a scene (a Latin square of nine views); --all takes the 27
combinations. Open space is presumed where the driver marks smooth pixels, so that wrong open cells are counted too.

Returns 1 where a goal is missed: false stops at most 1 % of the truly free directions, no cell called free or open that holds a
solid, a valid model of at least one view."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.open_air.joint_figures import JointFigures, figures_of, outline_table, table
from benchmarks.open_air.open_claims import marked
from benchmarks.open_air.view_options import INDOOR, words
from benchmarks.open_air.views import FRAMES, Seen, View, last_model, pose_of, profile_of, scene_of, see
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.frames import rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from drivers.simulation.sensor_model import TYPICAL, measure
from drivers.simulation.source import Rendered, look
from drivers.simulation.stereo.stereo_profiles import StereoCamera, StereoProfile

MODEL, PAIRS = "noise model", "rendered pairs"
PROFILES = ("zed", "long", "oak")
SCENES = (
    "field",
    "field_with_trees",
    "meadow_by_wood",
    "street",
    "hill_crest",
    "container_8m",
    "white_pillars",
    "white_balloons",
    "overhang",
    "wires",
    "white_room",
)
SEEDS, SKIES, NOISES_GREY = (0, 1, 2), ("clear", "hazy", "clouds"), (0.5, 1.0, 1.5)
FALSE_STOPS_PERCENT = 1.0


def combinations(every: bool) -> Iterator[tuple[int, str, tuple[float, ...]]]:
    """(seed, sky, levels of noise). In the Latin square one level for each seed and sky."""
    for i, seed in enumerate(SEEDS):
        for j, sky in enumerate(SKIES):
            yield seed, sky, NOISES_GREY if every else (NOISES_GREY[(i + j) % len(NOISES_GREY)],)


def modelled(view: View, profile: StereoProfile, extractor: Extractor) -> Seen:
    """A view whose depth is ray-cast, with the faults of the noise model at the profile's own noise."""
    scene, info = scene_of(view.scene, view.seed, view.sky), replace(profile.info(), marks_smooth=False)
    R, at = pose_of(view, scene)
    truth, R_level = look(scene.scene, info, R, at), rotation_level_cam_optical(R)
    scaled = TYPICAL.scaled_to(info.intrinsics.width)
    sensor = replace(scaled, ke_per_m=info.ke_per_m, blind_left_px=profile.unmatched_left_px)
    images = (measure(truth.depth_m, info, sensor, view.seed, number) for number in range(FRAMES))
    depth, model = last_model(extractor, info, R_level, images)
    return Seen(
        view=view,
        noise_grey=0.0,
        scene=scene,
        pair=None,
        model=model,
        unmatched_left_px=profile.unmatched_left_px,
        unmatched_right_px=profile.unmatched_right_px,
        frame=Rendered(scene.scene, info, depth, R, R_level, at, truth),
    )


def seen_views(a: argparse.Namespace, name: str, scene: str) -> Iterator[tuple[str, Seen]]:
    """(source, view) of a profile and a scene."""
    profile, extractor = marked(profile_of(name)), Extractor(Params(), OpenSkyParams(mode="presume"))
    camera = StereoCamera(profile)
    for seed in SEEDS:
        yield MODEL, modelled(View(scene=scene, profile=name, height_m=a.height, seed=seed), profile, extractor)
    for seed, sky, noises in combinations(a.all):
        # indoors there is no sky
        view = View(scene=scene, profile=name, sky=SKIES[0] if scene in INDOOR else sky, height_m=a.height, seed=seed)
        for seen in see(view, noises, camera, extractor):
            yield PAIRS, seen


def missed_goals(rows: dict[str, JointFigures]) -> list[str]:
    """A sentence for each goal that a row misses."""
    found = []
    for name, figures in rows.items():
        if figures.invalid == figures.views:
            found.append(f"{name}: no view has a valid model, nothing was judged")
        share = figures.row()["false_stops"]
        if share > FALSE_STOPS_PERCENT:
            found.append(f"{name}: {share:.2f} % false stops, goal {FALSE_STOPS_PERCENT:g} %")
        for kind, cells in (("free", figures.wrong_free), ("open", figures.wrong_open)):
            if cells:
                found.append(f"{name}: {cells} cells called {kind} hold a solid")
    return found


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--profiles", type=words, default=list(PROFILES))
    p.add_argument("--scenes", type=words, default=list(SCENES))
    p.add_argument("--height", type=float, default=2.0, help="metres above the ground")
    p.add_argument("--all", action="store_true", help="all combinations of seed, sky and noise")
    p.add_argument("--json", type=Path, help="the counts of each view")
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a goal is missed."""
    a = parse(arguments)
    total: dict[str, JointFigures] = {}
    by_scene: dict[str, JointFigures] = {}
    by_light: dict[str, JointFigures] = {}
    each = []
    for name in a.profiles:
        for scene in a.scenes:
            for source, seen in seen_views(a, name, scene):
                figures = figures_of(seen)
                rows = [total.setdefault(f"{name}, {source}", JointFigures())]
                rows.append(by_scene.setdefault(f"{name}, {scene}, {source}", JointFigures()))
                if source == PAIRS:
                    lights = (seen.view.sky, f"noise {seen.noise_grey:g}", f"seed {seen.view.seed}")
                    rows += [by_light.setdefault(f"{name}, {light}", JointFigures()) for light in lights]
                for row in rows:
                    row.add(figures)
                where = {"profile": name, "source": source, "scene": scene, "sky": seen.view.sky}
                each.append(where | {"seed": seen.view.seed, "noise": seen.noise_grey} | figures.sums())
            print(f"{name}, {scene}", file=sys.stderr, flush=True)
    for group, first in ((total, "camera, source"), (by_light, "camera, light"), (by_scene, "camera, scene, source")):
        print(table(group, first), end="\n\n")
    print(outline_table(total), end="\n\n")
    missed = missed_goals(total)
    print("\n".join(missed) or "all goals are reached")
    if a.json:
        a.json.write_text(json.dumps(each))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
