"""What rendered stereo calls free and what open, and which of it is wrong.

    python -m benchmarks.open_air.open_claims
    python -m benchmarks.open_air.open_claims --scenes field,bridge --skies clear --heights 2 --pitch=-10,0,10

Per scene: share of truly free directions called free, and free or open, to 10 m at the vehicle's height; cells of the free
profile, and cells that only the open profile claims, in which a solid stands (benchmarks/free_space/volume.py), the deepest
with its name."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks import markdown
from benchmarks.free_space.volume import WrongCell, wrong_cells
from benchmarks.open_air.directions import TO_M, judged_azimuths, truth
from benchmarks.open_air.view_options import seen_views, view_parser
from benchmarks.open_air.views import Seen, profile_of
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import BEYOND_MM, CONTINUED_MM, TEXTURED_MM, TEXTURELESS_MM, FrameModel
from drivers.simulation.source import Rendered
from drivers.simulation.stereo.stereo_profiles import StereoCamera, StereoProfile

_COLORS = {TEXTURELESS_MM: (255, 120, 0), BEYOND_MM: (0, 220, 220), CONTINUED_MM: (0, 0, 255)}
_MEASURED, _OPEN = (0, 160, 0), (255, 255, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Claims:
    """Of one frame. directions: truly free ones; free, opened: of them called free, and free or open, up to TO_M. wrong_free:
    cells of the free profile with a solid; wrong_open: those of the open profile that are not among them, with the names of the solids."""

    directions: int
    free: int
    opened: int
    wrong_free: int
    wrong_open: tuple[tuple[WrongCell, str], ...]
    more_cells: int


def as_free(model: FrameModel) -> FrameModel:
    """The model with its open ranges in the place of the free ones, to be judged like those."""
    f = model.free
    if not f.has_open:
        return model
    farther = f.open_to_m > f.free_to_m
    from_m, to_m = np.where(farther, f.open_from_m, f.free_from_m), np.where(farther, f.open_to_m, f.free_to_m)
    return replace(model, free=replace(f, free_from_m=from_m, free_to_m=to_m))


def true_ke_per_m(frame: Rendered, model: FrameModel) -> float:
    """The noise by which claims are judged: that of the model, at most that of the camera. A model that overstates its noise would
    excuse its own claims."""
    return min(model.ke_per_m, frame.info.ke_per_m)


def claims_of(
    frame: Rendered, model: FrameModel, unmatched_left_px: int, params: Params, unmatched_right_px: int = 0
) -> Claims:
    """What a model claims, against the geometry of its frame."""
    azimuth, rows = judged_azimuths(frame, model, unmatched_left_px, unmatched_right_px)
    free = truth(frame, azimuth) if len(rows) else np.zeros(0, np.bool_)
    if not model.valid:
        return Claims(directions=int(free.sum()), free=0, opened=0, wrong_free=0, wrong_open=(), more_cells=0)
    layer = int(np.searchsorted(model.free.layer_edges_m, 0.0, side="right")) - 1
    least_m = min(TO_M, 0.999 * frame.info.max_range_m)

    def called(m: FrameModel) -> int:
        begin, end = m.free.free_from_m[rows, layer], m.free.free_to_m[rows, layer]
        return int((free & (end > begin) & (end >= least_m)).sum())

    opened, ke = as_free(model), true_ke_per_m(frame, model)
    wrong, cells = wrong_cells(frame, model, ke, params)
    wrong_open, open_cells = wrong_cells(frame, opened, ke, params)
    known = {(w.direction, w.layer) for w in wrong}
    names = frame.scene.names
    return Claims(
        directions=int(free.sum()),
        free=called(model),
        opened=called(opened),
        wrong_free=len(wrong),
        wrong_open=tuple(
            (w, names[w.solid] if w.solid >= 0 else "ground") for w in wrong_open if (w.direction, w.layer) not in known
        ),
        more_cells=open_cells - cells,
    )


@dataclass(slots=True)
class ClaimCounts:
    """Sums over frames."""

    frames: int = 0
    invalid: int = 0
    directions: int = 0
    free: int = 0
    opened: int = 0
    wrong_free: int = 0
    wrong_open: int = 0
    more_cells: int = 0
    deepest_m: float = 0.0
    deepest: str = ""
    frames_wrong: list[str] = field(default_factory=list)

    def add(self, claims: Claims, valid: bool, where: str) -> None:
        """One frame."""
        self.frames += 1
        self.invalid += not valid
        self.directions += claims.directions
        self.free += claims.free
        self.opened += claims.opened
        self.wrong_free += claims.wrong_free
        self.wrong_open += len(claims.wrong_open)
        self.more_cells += claims.more_cells
        if claims.wrong_open:
            self.frames_wrong.append(where)
        for wrong, name in claims.wrong_open:
            if wrong.deep_m > self.deepest_m:
                self.deepest_m, self.deepest = wrong.deep_m, name

    def row(self) -> list[str]:
        """Cells of a table."""

        def percent(part: int) -> str:
            return f"{100.0 * part / self.directions:.1f}" if self.directions else ""

        deepest = f"{self.deepest_m:.2f} ({self.deepest})" if self.wrong_open else ""
        return [
            str(self.frames),
            str(self.invalid),
            percent(self.free),
            percent(self.opened),
            str(self.wrong_free),
            str(self.wrong_open),
            deepest,
            str(self.more_cells),
        ]


COLUMNS = ("frames", "invalid", "free %", "free or open %", "wrong free", "wrong open", "deepest m", "cells more")


def picture(seen: Seen) -> NDArray[np.uint8]:
    """Left image beside the depth image: measured green, textureless blue, matched beyond millimetres yellow, continued red."""
    if seen.pair is None:
        raise ValueError("this view has no images")
    left = cv2.cvtColor(seen.pair.left, cv2.COLOR_GRAY2BGR)
    depth = np.zeros_like(left)
    depth[seen.frame.depth_mm > TEXTURED_MM] = _MEASURED
    for mark, color in _COLORS.items():
        depth[seen.frame.depth_mm == mark] = color
    f, k = seen.model.free, seen.frame.info.intrinsics
    if seen.model.valid and f.has_open:
        layer = int(np.searchsorted(f.layer_edges_m, 0.0, side="right")) - 1
        to_m = np.maximum(f.open_to_m[:, layer] - f.open_from_m[:, layer], 0.0)
        middle = 0.5 * (f.azimuth_edges_rad[1:] + f.azimuth_edges_rad[:-1])
        for azimuth, far in zip(middle, to_m, strict=True):  # a bar for each direction, 1 px for 0.1 m
            u = round(float(k.cx + k.fx * math.tan(float(azimuth))))
            cv2.line(depth, (u, k.height - 1), (u, k.height - 1 - round(10.0 * float(far))), _OPEN, 2)
    return np.asarray(np.hstack([left, depth]), np.uint8)


def marked(profile: StereoProfile) -> StereoProfile:
    """The profile with a driver that marks smooth pixels."""
    return replace(profile, match=replace(profile.match, mark_smooth=True))


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = view_parser(__doc__, skies=["clear", "hazy"])
    p.add_argument("--pictures", type=Path, help="folder for a picture of each frame")
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where a cell is free or open that holds a solid."""
    a = parse(arguments)
    extractor = Extractor(Params(), OpenSkyParams(mode="presume"))
    rows: dict[str, ClaimCounts] = {}
    total = ClaimCounts()
    for scene, seen in seen_views(a, StereoCamera(marked(profile_of(a.profile))), extractor):
        view = seen.view
        where = f"{scene} {view.sky} {view.height_m:g} m, pitch {view.pitch_deg:g}, roll {view.roll_deg:g}, noise {seen.noise_grey:g}"
        claims = claims_of(seen.frame, seen.model, seen.unmatched_left_px, extractor.params, seen.unmatched_right_px)
        for counts in (rows.setdefault(scene, ClaimCounts()), total):
            counts.add(claims, seen.model.valid, where)
        if a.pictures:
            a.pictures.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(a.pictures / f"{where.replace(', ', '_').replace(' ', '_')}.png"), picture(seen))
    print(
        markdown.table(("scene", *COLUMNS), ([name, *counts.row()] for name, counts in (rows | {"all": total}).items()))
    )
    for where in total.frames_wrong:
        print(f"wrong: {where}")
    return int(total.wrong_free + total.wrong_open > 0)


if __name__ == "__main__":
    sys.exit(main())
