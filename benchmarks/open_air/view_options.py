"""Options of a command line that choose views, and the views that they choose."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

from benchmarks.open_air.stereo_profiles import PROFILES
from benchmarks.open_air.stereo_scenes import STEREO_SCENES
from benchmarks.open_air.views import Seen, View, see
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_profiles import StereoCamera

INDOOR = ("white_room",)
REFUSING = ("field", "hill_crest", "meadow_by_wood", "street", "field_with_trees", "roof_edge")
"""Scenes whose open directions are refused in part."""


def words(text: str) -> list[str]:
    """The parts of a list with commas."""
    return [w for w in text.split(",") if w]


def view_parser(
    doc: str | None,
    *,
    skies: Sequence[str],
    noise: Sequence[float] = (1.0,),
    scenes: Sequence[str] = tuple(STEREO_SCENES),
) -> ArgumentParser:
    """A parser of camera, scenes, heights, attitudes, seeds, skies and noise, with these defaults. doc: of the command."""
    p = ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--profile", choices=list(PROFILES), default="zed")
    p.add_argument("--scenes", type=words, default=list(scenes))
    p.add_argument("--heights", type=words, default=[2.0, 5.0, 10.0], help="metres")
    p.add_argument("--pitch", type=words, default=[0.0], help="degrees")
    p.add_argument("--roll", type=words, default=[0.0], help="degrees")
    p.add_argument("--seeds", type=words, default=[0])
    p.add_argument("--skies", type=words, default=list(skies), help=f"of {', '.join(SKIES)}")
    p.add_argument("--noise", type=words, default=list(noise), help="grey levels")
    return p


def views(a: argparse.Namespace, scene: str) -> list[View]:
    """The views of a scene. Indoors there is no sky and one height."""
    return [
        View(
            scene=scene,
            profile=a.profile,
            sky=sky,
            height_m=float(height),
            pitch_deg=float(pitch),
            roll_deg=float(roll),
            seed=int(seed),
        )
        for sky in (a.skies[:1] if scene in INDOOR else a.skies)
        for height in (a.heights[:1] if scene in INDOOR else a.heights)
        for pitch in a.pitch
        for roll in a.roll
        for seed in a.seeds
    ]


def seen_views(a: argparse.Namespace, camera: StereoCamera, extractor: Extractor) -> Iterator[tuple[str, Seen]]:
    """(scene, view) of all views and levels of noise."""
    for scene in a.scenes:
        for view in views(a, scene):
            for seen in see(view, tuple(float(n) for n in a.noise), camera, extractor):
                yield scene, seen
