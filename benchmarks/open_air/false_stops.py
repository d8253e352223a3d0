"""False stops and kept obstacles of rendered stereo.

    python -m benchmarks.open_air.false_stops
    python -m benchmarks.open_air.false_stops --profile oak --scenes field,street --skies clear,clouds --heights 2

Each scene is rendered as two images, matched, and extracted. Per scene: share of truly free directions called free, closed by
any plane, and closed by a plane that is not there (false stop), all at the vehicle's height within 10 m; missed obstacle rays
on measured pixels; recall of the upright outlines of blank things."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import missed_rays, rays_of, stops
from benchmarks.open_air.directions import judge_directions
from benchmarks.open_air.outlines import OutlineCounts, outline_counts
from benchmarks.open_air.view_options import add_view_options, views, words
from benchmarks.open_air.views import Seen, every_match, profile_of, see
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.params import Params
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_profiles import StereoCamera

NOISES_GREY = (0.5, 1.0, 1.5)
STEP_M, STEP_PX = 0.5, 5


@dataclass(slots=True)
class Counts:
    """Sums over views. directions: truly free ones; rays: obstacle rays on measured pixels; rays_inside: those of them away from
    depth steps, see `beside_steps`."""

    views: int = 0
    invalid: int = 0
    planes: int = 0
    pixels: int = 0
    measured: int = 0
    sky_pixels: int = 0
    sky_near: int = 0
    directions: int = 0
    called_free: int = 0
    closed: int = 0
    false_stops: int = 0
    rays: int = 0
    missed: int = 0
    rays_inside: int = 0
    missed_inside: int = 0
    outlines: list[OutlineCounts] = field(default_factory=list)

    def add(self, other: Counts) -> None:
        """The sums of other views."""
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))

    def row(self) -> dict[str, float]:
        """Shares in percent."""

        def percent(part: int, whole: int) -> float:
            return 100.0 * part / whole if whole else math.nan

        outline = sum(o.pixels for o in self.outlines)
        return {
            "views": self.views,
            "invalid": self.invalid,
            "planes": self.planes / max(1, self.views),
            "measured": percent(self.measured, self.pixels),
            "sky_near": percent(self.sky_near, self.sky_pixels),
            "free": percent(self.called_free, self.directions),
            "closed": percent(self.closed, self.directions),
            "false_stops": percent(self.false_stops, self.directions),
            "missed": percent(self.missed, self.rays),
            "missed_inside": percent(self.missed_inside, self.rays_inside),
            "outline_px": percent(sum(o.measured for o in self.outlines), outline),
            "outline": percent(sum(o.kept for o in self.outlines), outline),
        }


def beside_steps(range_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(H, W) within STEP_PX of a step of the true range of more than STEP_M, or of the sky: where a window of the matcher lies on
    two things. range_m: inf for the sky."""
    r = np.where(np.isfinite(range_m), range_m, 1e6)
    step = np.zeros(r.shape, np.uint8)
    step[:, 1:] |= np.abs(np.diff(r, axis=1)) > STEP_M
    step[1:] |= np.abs(np.diff(r, axis=0)) > STEP_M
    return np.asarray(cv2.dilate(step, np.ones((2 * STEP_PX + 1, 2 * STEP_PX + 1), np.uint8)) > 0)


def counts_of(seen: Seen) -> Counts:
    """The counts of one view."""
    frame, model = seen.frame, seen.model
    sky = ~np.isfinite(frame.truth.depth_m)
    sky[:, : seen.unmatched_left_px] = False
    directions = judge_directions(frame, model, seen.unmatched_left_px)
    rays = rays_of(frame, frame.info.ke_per_m, blind_left_px=seen.unmatched_left_px)
    depth, _ = stops(model.planes.astype(np.float64), frame.info.intrinsics, frame.R_level_optical)
    stop_m = depth * rays.per_depth
    # an invalid model says nothing: what it does not stop is not missed
    judged = rays.obstacle & rays.measured & model.valid
    inside = judged & ~beside_steps(rays.range_m)
    missed = missed_rays(rays, stop_m)
    return Counts(
        views=1,
        invalid=int(not model.valid),
        planes=len(model.planes),
        pixels=frame.depth_mm.size,
        measured=int((frame.depth_mm > 0).sum()),
        sky_pixels=int(sky.sum()),
        sky_near=int((sky & (frame.depth_mm > 0) & (frame.depth_mm < 10_000)).sum()),
        directions=int(directions.truly_free.sum()),
        called_free=int((directions.truly_free & directions.called_free).sum()),
        closed=int((directions.truly_free & directions.closed).sum()),
        false_stops=directions.false_stops,
        rays=int(judged.sum()),
        missed=int((missed & judged).sum()),
        rays_inside=int(inside.sum()),
        missed_inside=int((missed & inside).sum()),
        outlines=outline_counts(frame, seen.scene.blank, rays, stop_m, seen.unmatched_left_px),
    )


COLUMNS = {
    "views": ("views", 0),
    "invalid": ("invalid", 0),
    "planes": ("planes", 1),
    "measured": ("measured %", 1),
    "sky_near": ("sky < 10 m %", 2),
    "free": ("called free %", 1),
    "closed": ("closed %", 1),
    "false_stops": ("false stops %", 2),
    "missed": ("missed %", 2),
    "missed_inside": ("missed inside %", 2),
    "outline_px": ("outline px %", 1),
    "outline": ("outline %", 1),
}


def table(rows: dict[str, dict[str, float]], first: str = "scene") -> str:
    """Markdown of rows by name."""
    lines = ["| " + " | ".join([first, *(title for title, _ in COLUMNS.values())]) + " |"]
    lines.append("|---" * (len(COLUMNS) + 1) + "|")
    for name, row in rows.items():
        cells = ["" if math.isnan(row[key]) else f"{row[key]:.{digits}f}" for key, (_, digits) in COLUMNS.items()]
        lines.append("| " + " | ".join([name, *cells]) + " |")
    return "\n".join(lines)


def outline_table(found: list[OutlineCounts]) -> str:
    """Markdown: recall of outlines by range."""
    lines = ["| range m | outline px | measured % | in the model % |", "|---|---|---|---|"]
    for low in range(0, 20, 2):
        here = [o for o in found if low <= o.range_m < low + 2]
        pixels = sum(o.pixels for o in here)
        if pixels:
            shares = [100.0 * sum(getattr(o, key) for o in here) / pixels for key in ("measured", "kept")]
            lines.append(f"| {low} to {low + 2} | {pixels} | {shares[0]:.1f} | {shares[1]:.1f} |")
    return "\n".join(lines)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_view_options(p)
    p.add_argument("--all-matches", action="store_true", help="accept every match: the confidence rules are off")
    p.add_argument("--skies", type=words, default=["clear", "hazy", "clouds"], help=f"of {', '.join(SKIES)}")
    p.add_argument("--noise", type=words, default=list(NOISES_GREY), help="grey levels")
    p.add_argument("--json", type=Path, help="all sums")
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    a = parse(arguments)
    noises = tuple(float(n) for n in a.noise)
    profile = profile_of(a.profile)
    if a.all_matches:
        profile = every_match(profile)
    camera, extractor = StereoCamera(profile), Extractor(Params())
    by_scene: dict[str, Counts] = {}
    by_light: dict[str, Counts] = {}
    total = Counts()
    for scene in a.scenes:
        for view in views(a, scene):
            for seen in see(view, noises, camera, extractor):
                found = counts_of(seen)
                light = f"{view.sky}, noise {seen.noise_grey:g}"
                for counts in (by_scene.setdefault(scene, Counts()), by_light.setdefault(light, Counts()), total):
                    counts.add(found)
        print(f"{scene}: {json.dumps(by_scene[scene].row())}", file=sys.stderr, flush=True)
    print(table({**{name: c.row() for name, c in by_scene.items()}, "all": total.row()}))
    print()
    print(table({name: c.row() for name, c in by_light.items()}, "light"))
    print()
    print(outline_table(total.outlines))
    if a.json:
        a.json.write_text(json.dumps({name: asdict(c) for name, c in by_scene.items()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
