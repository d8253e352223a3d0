"""What the frames of the last half second would add to open space, and what they would hide.

    python -m benchmarks.open_air.earlier_frames
    python -m benchmarks.open_air.earlier_frames --scenes field,street --heights 2 --mover-m-s 0,5
    python -m benchmarks.open_air.earlier_frames --rods --heights 2 --mover-m-s 0,5

Directions at the vehicle's height that are free or open to 10 m in the newest of five frames, and in what is known from all five: a
place counts that an earlier frame shows free or open and that no thing of `mover_m_s` can have reached since. Nothing of the newest frame
speaks against it, so the figures are upper bounds. With --rods the same towards level rods before a field, where each such direction is
wrong."""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from benchmarks.open_air.directions import HALF_HEIGHT_M, TO_M, judged_azimuths, truth
from benchmarks.open_air.open_claims import as_free, marked
from benchmarks.open_air.refusals import OPEN
from benchmarks.open_air.view_options import add_view_options, views, words
from benchmarks.open_air.views import View, pose_of, profile_of, scene_of
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import ExtractorState, FrameModel
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered, look
from drivers.simulation.stereo.pair_renderer import expose_pair
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_profiles import StereoCamera
from drivers.simulation.stereo.stereo_scenes import StereoScene, surfaces_of

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
DIRECTIONS = "directions"
FRAMES, INTERVAL_S, APART_M = 5, 0.1, 0.15
SWAY_DEG = ((0.6, -0.4), (-0.5, 0.7), (0.3, 0.8), (-0.8, -0.2), (0.0, 0.0))
"""Pitch and roll of each frame of a swaying flight, in addition to those of the view."""
STEADY_DEG = ((0.0, 0.0),) * FRAMES
ROD_DIAMETERS_M, ROD_DISTANCES_M, ROD_BELOW_DEG = (0.006, 0.012, 0.024, 0.05), (1.6, 3.0, 5.0), (1.0, 2.0)
"""Level rods across the view: below_deg below the horizon of the newest frame."""
_CELL_M = 0.125
_LOW_M, _HIGH_M = np.array([0.0, -11.0, -3.0]), np.array([13.0, 11.0, 3.0])
_GRID_M: Floats = np.stack(
    np.meshgrid(
        *(np.arange(low + _CELL_M / 2, high, _CELL_M) for low, high in zip(_LOW_M, _HIGH_M, strict=True)), indexing="ij"
    ),
    axis=-1,
)
"""(X, Y, Z, 3) middles of cells around the newest camera in axes of ned; the views look north."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sequence:
    """Models of FRAMES frames, oldest first, the positions of their camera (FRAMES, 3) in ned, its heading, and the newest frame."""

    models: list[FrameModel]
    positions_m: Floats
    heading_rad: float
    newest: Rendered


def rod_scene(diameter_m: float, distance_m: float, below_deg: float, height_m: float) -> StereoScene:
    """A field with a level metal rod across the view of a camera at a height."""
    builder = SceneBuilder("field")
    builder.ground()
    z = distance_m * math.tan(math.radians(below_deg)) - height_m
    builder.cylinder("wire", (distance_m, -12.0, z), (distance_m, 12.0, z), 0.5 * diameter_m)
    return StereoScene(name="rod", surfaces=surfaces_of(builder.build()), sky=SKIES["clear"])


def fly(
    view: View,
    scene: StereoScene,
    sway_deg: tuple[tuple[float, float], ...],
    noise_grey: float,
    camera: StereoCamera,
    extractor: Extractor,
) -> Sequence:
    """FRAMES frames, APART_M apart straight ahead, the last of them at the pose of the view."""
    profile, info, state = camera.profile, camera.profile.info(), ExtractorState()
    exposure = replace(profile.view.exposure, noise_grey=noise_grey)
    R_view, end_m = pose_of(view, scene)
    heading_rad = math.atan2(R_view[1, 2], R_view[0, 2])
    ahead = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])
    positions_m = end_m - APART_M * np.arange(FRAMES - 1, -1, -1)[:, None] * ahead
    models: list[FrameModel] = []
    for number, (at, (pitch, roll)) in enumerate(zip(positions_m, sway_deg, strict=True)):
        attitude = math.radians(view.roll_deg + roll), math.radians(view.pitch_deg + pitch), heading_rad
        R = rotation_from_euler(*attitude) @ R_CAMFRD_OPTICAL
        R_level = rotation_level_cam_optical(R)
        pair = expose_pair(camera.brightness(scene, R, at, view.seed), exposure, view.seed, number)
        depth = camera.depth_of(pair)
        for _ in range(2 if number == 0 else 1):  # the second frame measures the noise and the ground
            model, state = extractor.extract(depth, info, R_level, state=state)
        models.append(model)
    newest = Rendered(scene.scene, info, depth, R, R_level, at, look(scene.scene, info, R, at))
    return Sequence(models=models, positions_m=positions_m, heading_rad=heading_rad, newest=newest)


def shown(s: Sequence, number: int, places_m: Floats) -> Mask:
    """Whether a frame shows places (..., 3), relative to the newest camera in axes of ned, free or open."""
    f = as_free(s.models[number]).free
    x, y, z = np.moveaxis(places_m + (s.positions_m[-1] - s.positions_m[number]), -1, 0)
    d = np.searchsorted(f.azimuth_edges_rad, np.arctan2(y, x) - s.heading_rad, side="right") - 1
    layer = np.searchsorted(f.layer_edges_m, z, side="right") - 1
    inside = (d >= 0) & (d < len(f.azimuth_edges_rad) - 1) & (layer >= 0) & (layer < len(f.layer_edges_m) - 1)
    at = np.where(inside, d, 0), np.where(inside, layer, 0)
    begin, end, range_m = f.free_from_m[at], f.free_to_m[at], np.hypot(x, y)
    return np.asarray(inside & (end > begin) & (range_m >= begin) & (range_m <= end))


def known_free(s: Sequence, mover_m_s: float) -> Mask:
    """Whether places of _GRID_M are free or open in the newest frame, or were so and no thing of this speed can have reached them
    since. An invalid frame empties what was known."""
    known = np.zeros(_GRID_M.shape[:-1], np.bool_)
    for number, model in enumerate(s.models):
        if mover_m_s > 0.0 and known.any():
            known = distance_transform_edt(known, sampling=_CELL_M) > mover_m_s * INTERVAL_S
        known = known | shown(s, number, _GRID_M) if model.valid else np.zeros_like(known)
    return known


def is_known(known: Mask, s: Sequence, d: int, nearest_m: float) -> bool:
    """Whether direction d of the newest profile is known to be free from nearest_m to TO_M at the height of the camera."""
    edges = s.models[-1].free.azimuth_edges_rad[d : d + 2].astype(np.float64)
    azimuth = edges[0] + (np.arange(3) + 0.5) / 3.0 * (edges[1] - edges[0]) + s.heading_rad
    heights = np.linspace(-0.75, 0.75, 4) * HALF_HEIGHT_M
    a, r, z = np.meshgrid(azimuth, np.arange(nearest_m + _CELL_M, TO_M - _CELL_M, _CELL_M), heights, indexing="ij")
    places_m = np.stack([r * np.cos(a), r * np.sin(a), z], axis=-1)
    at = np.floor((places_m - _LOW_M) / _CELL_M).astype(np.int64)
    return bool(known[tuple(np.moveaxis(at, -1, 0))].all())


def counts_of(
    s: Sequence, unmatched_px: tuple[int, int], movers_m_s: list[float], is_barred: bool = False
) -> Counter[str]:
    """How many truly free directions there are, are open in the newest frame, and are known from all frames with each speed.
    is_barred: something that `truth`, which looks at three heights, may miss stands in all directions: all are counted."""
    model = s.models[-1]
    azimuth, rows = judged_azimuths(s.newest, model, *unmatched_px)
    rows = rows if is_barred or not len(rows) else rows[truth(s.newest, azimuth)]
    counts = Counter({DIRECTIONS: len(rows)})
    if not model.valid:
        return counts
    layer = int(np.searchsorted(model.free.layer_edges_m, 0.0, side="right")) - 1
    claimed = as_free(model).free
    begin, end = claimed.free_from_m[:, layer], claimed.free_to_m[:, layer]
    is_open = (end > begin) & (end >= TO_M)
    nearest_m = float(np.median(begin[is_open])) if is_open.any() else 1.0
    counts[OPEN] = int(is_open[rows].sum())
    for speed in movers_m_s:
        known = known_free(s, speed)
        counts[f"{speed:g} m/s"] = sum(bool(is_open[d]) or is_known(known, s, int(d), nearest_m) for d in rows)
    return counts


def cases(a: argparse.Namespace) -> Iterator[tuple[str, View, StereoScene, tuple[tuple[float, float], ...]]]:
    """(name of a row, view, scene, attitudes) of each flight."""
    if not a.rods:
        for scene in a.scenes:
            for view in views(a, scene):
                yield f"{scene}, steady", view, scene_of(scene, view.seed, view.sky), STEADY_DEG
                yield f"{scene}, swaying", view, scene_of(scene, view.seed, view.sky), SWAY_DEG
        return
    for diameter_m in ROD_DIAMETERS_M:
        for distance_m in ROD_DISTANCES_M:
            for below_deg in map(float, a.below_deg):
                for view in views(a, "field"):
                    rod = rod_scene(diameter_m, distance_m, below_deg, view.height_m)
                    yield f"rod of {1000.0 * diameter_m:g} mm at {distance_m:g} m", view, rod, STEADY_DEG


def table(rows: dict[str, Counter[str]], movers_m_s: list[float]) -> str:
    """Markdown: the number of directions, and percent of them that are open in the newest frame, and known from all."""
    shares = [OPEN, *(f"{speed:g} m/s" for speed in movers_m_s)]
    lines = ["| " + " | ".join(("flight", DIRECTIONS, *shares)) + " |", "|---" * (len(shares) + 2) + "|"]
    for name, counts in rows.items():
        total = max(1, counts[DIRECTIONS])
        cells = (f"{100.0 * counts[share] / total:.1f}" for share in shares)
        lines.append("| " + " | ".join((name, str(counts[DIRECTIONS]), *cells)) + " |")
    return "\n".join(lines)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_view_options(p)
    p.set_defaults(scenes=["field", "hill_crest", "meadow_by_wood", "street", "field_with_trees", "roof_edge"])
    p.add_argument("--skies", type=words, default=["clear"])
    p.add_argument("--noise", type=float, default=1.0, help="grey levels")
    p.add_argument("--mover-m-s", type=words, default=[0.0, 5.0, 10.0, 15.0], help="speed of what may enter")
    p.add_argument("--open-share", type=float, default=OpenSkyParams().open_share, help="key of [open_sky]")
    p.add_argument("--rods", action="store_true", help="level rods before a field in place of the scenes")
    p.add_argument("--below-deg", type=words, default=list(ROD_BELOW_DEG), help="of the rods, below the horizon")
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    a = parse(arguments)
    camera = StereoCamera(marked(profile_of(a.profile)))
    extractor = Extractor(Params(), OpenSkyParams(mode="presume", open_share=a.open_share))
    unmatched_px = (camera.profile.unmatched_left_px, camera.profile.unmatched_right_px)
    movers_m_s = [float(speed) for speed in a.mover_m_s]
    rows: dict[str, Counter[str]] = {}
    for name, view, scene, sway_deg in cases(a):
        flight = fly(view, scene, sway_deg, a.noise, camera, extractor)
        counts = counts_of(flight, unmatched_px, movers_m_s, is_barred=a.rods)
        rows.setdefault(name, Counter()).update(counts)
        print(name, dict(counts), file=sys.stderr, flush=True)
    print(table(rows, movers_m_s))
    return 0


if __name__ == "__main__":
    sys.exit(main())
