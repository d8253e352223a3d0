"""Options of a command line that choose views, and the views that they choose."""

from __future__ import annotations

import argparse

from benchmarks.open_air.views import View
from drivers.simulation.stereo.stereo_profiles import PROFILES
from drivers.simulation.stereo.stereo_scenes import STEREO_SCENES

INDOOR = ("white_room",)


def words(text: str) -> list[str]:
    """The parts of a list with commas."""
    return [w for w in text.split(",") if w]


def add_view_options(p: argparse.ArgumentParser) -> None:
    """Profile, scenes, heights, attitudes and seeds."""
    p.add_argument("--profile", choices=list(PROFILES), default="zed")
    p.add_argument("--scenes", type=words, default=list(STEREO_SCENES))
    p.add_argument("--heights", type=words, default=[2.0, 5.0, 10.0], help="metres")
    p.add_argument("--pitch", type=words, default=[0.0], help="degrees")
    p.add_argument("--roll", type=words, default=[0.0], help="degrees")
    p.add_argument("--seeds", type=words, default=[0])


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
