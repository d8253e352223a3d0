"""False stops and kept obstacles of rendered stereo.

    python -m benchmarks.open_air.false_stops
    python -m benchmarks.open_air.false_stops --profile oak --scenes field,street --skies clear,clouds --heights 2

Each scene is rendered as two images, matched, and extracted. Per scene: share of truly free directions called free, closed by
any plane, and closed by a plane that is not there (false stop), all at the vehicle's height within 10 m; missed obstacle rays
on measured pixels; recall of the upright outlines of blank things. Returns 1 where a free cell holds a solid."""

from __future__ import annotations

import argparse
import sys

from benchmarks.open_air.joint_figures import JointFigures, figures_of, outline_table, table
from benchmarks.open_air.view_options import seen_views, view_parser
from benchmarks.open_air.views import every_match, profile_of
from core.extractor import Extractor
from core.params import Params
from drivers.simulation.stereo.stereo_profiles import StereoCamera

NOISES_GREY = (0.5, 1.0, 1.5)
COLUMNS = (
    "views",
    "invalid",
    "planes",
    "measured",
    "sky_near",
    "opened",
    "closed",
    "false_stops",
    "missed",
    "missed_inside",
    "outline_px",
    "outline",
    "wrong_free",
)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = view_parser(__doc__, skies=["clear", "hazy", "clouds"], noise=list(NOISES_GREY))
    p.add_argument("--all-matches", action="store_true", help="accept every match: the confidence rules are off")
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    a = parse(arguments)
    profile = every_match(profile_of(a.profile)) if a.all_matches else profile_of(a.profile)
    by_scene: dict[str, JointFigures] = {}
    by_light: dict[str, JointFigures] = {}
    total = {"all": JointFigures()}
    for scene, seen in seen_views(a, StereoCamera(profile), Extractor(Params())):
        found, light = figures_of(seen), f"{seen.view.sky}, noise {seen.noise_grey:g}"
        for rows, name in ((by_scene, scene), (by_light, light), (total, "all")):
            rows.setdefault(name, JointFigures()).add(found)
    for rows, first in ((by_scene | total, "scene"), (by_light, "light")):
        print(table(rows, first, COLUMNS), end="\n\n")
    print(outline_table(total))
    return int(total["all"].wrong_free > 0)


if __name__ == "__main__":
    sys.exit(main())
