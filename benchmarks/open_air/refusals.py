"""Why truly free directions are neither free nor open to 10 m, by the first rule that refuses them.

    python -m benchmarks.open_air.refusals
    python -m benchmarks.open_air.refusals --scenes field,street --skies clear,clouds --heights 2,5,10 --pitch=-10,0,10

Per scene the share of truly free directions at the vehicle's height that are open, and for each reason the share of those that
are not. A direction has the reason of its first column of blocks that is not open to 10 m; without such a column that of
the walk over the cells."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks import markdown
from benchmarks.open_air.directions import TO_M, judged_azimuths, truth
from benchmarks.open_air.open_claims import as_free, marked
from benchmarks.open_air.view_options import REFUSING, seen_views, view_parser
from benchmarks.open_air.views import profile_of
from core.buffers import Buffers
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.classify import classify, clear_range_m, pixel_limits
from core.stages.free_space import WalkedView
from core.stages.level import LevelledView, level_view
from core.stages.open_blocks import BLOCK
from core.stages.open_columns import Refusal
from core.stages.open_space import OpenObservation, observe_open
from core.stages.view_geometry import source_of, view_geometry
from core.types import FrameModel, FreeEnd
from drivers.simulation.source import Rendered
from drivers.simulation.stereo.stereo_profiles import StereoCamera

OPEN, INVALID, PLANE = "open", "invalid frame", "plane"
_WALK = {
    FreeEnd.NOT_SEEN: "cells not in view",
    FreeEnd.OBSTACLE: "measured, nearer less noise",
    FreeEnd.UNKNOWN: "cells unknown",
    FreeEnd.FIELD_OF_VIEW: "end of the view",
    FreeEnd.MAX_RANGE: "range of the camera",
}
REASONS = (
    INVALID,
    *(r.name.lower().replace("_", " ") for r in Refusal if r is not Refusal.NONE),
    *_WALK.values(),
    PLANE,
)


def evidence(
    frame: Rendered, model: FrameModel, params: Params, open_sky: OpenSkyParams
) -> tuple[LevelledView, OpenObservation]:
    """The levelled view of a frame and what is open in it by its pixels, with the noise and the ground of its valid model.
    Without the removal of smeared edges, which rendered stereo does not need."""
    info, R, ke = frame.info, np.ascontiguousarray(frame.R_level_optical), model.ke_per_m
    marks = np.empty(frame.depth_mm.shape, np.uint16)
    classify(frame.depth_mm, pixel_limits(info, ke, params), marks)
    levelled = level_view(marks, info, R, view_geometry(info, R, params), ke, params, Buffers())
    walked = WalkedView(
        codes=levelled.exact_codes,
        geometry=levelled.exact_view,
        source=source_of(info, R, clear_range_m(info, ke, params)),
        ground=model.ground,
        ke_per_m=ke,
    )
    found = observe_open(frame.depth_mm, walked, params, open_sky, Buffers())
    if found is None:
        raise ValueError("[open_sky] mode is off: nothing is judged")
    return levelled, found


def columns_of(azimuths: NDArray[np.float64], levelled: LevelledView) -> NDArray[np.int64]:
    """The columns of blocks that the directions between two azimuths cross."""
    view = levelled.exact_view
    f_u = view.f_px / float(view.lateral[0])
    u = np.clip(np.tan(azimuths) * f_u + view.cu, 0, len(levelled.exact_codes) - 1)
    return np.arange(int(u[0]) // BLOCK, int(u[-1]) // BLOCK + 1)


def reason(d: int, layer: int, levelled: LevelledView, found: OpenObservation, to_m: float) -> str:
    """Why direction d of a layer is not open to to_m by its pixels; PLANE where it is."""
    seen, columns = found.seen, found.columns
    if seen.free_to_m[d, layer] > max(seen.free_from_m[d, layer], to_m - 0.5):
        return PLANE
    if seen.end[d, layer] == FreeEnd.OBSTACLE and seen.free_to_m[d, layer] > seen.free_from_m[d, layer]:
        return _WALK[FreeEnd.OBSTACLE]  # seen through up to something that may be nearer than to_m by its noise
    among = columns_of(seen.edges_rad[[d, d + 1]], levelled)
    refused = [j for j in among if columns.limit_m[j] < to_m]
    if refused:
        return Refusal(int(columns.refusal[refused[0]])).name.lower().replace("_", " ")
    return _WALK[FreeEnd(int(seen.end[d, layer]))]


def reasons_of(
    frame: Rendered, model: FrameModel, unmatched_px: tuple[int, int], params: Params, open_sky: OpenSkyParams
) -> Counter[str]:
    """How many truly free directions of a frame are open to TO_M, and the reasons of the others. unmatched_px: columns at the
    left and at the right that never have a match."""
    azimuth, rows = judged_azimuths(frame, model, *unmatched_px)
    rows = rows[truth(frame, azimuth)] if len(rows) else rows
    if not model.valid:
        return Counter({INVALID: len(rows)})
    levelled, found = evidence(frame, model, params, open_sky)
    layer = int(np.searchsorted(model.free.layer_edges_m, 0.0, side="right")) - 1
    claimed = as_free(model).free
    begin, end = claimed.free_from_m[:, layer], claimed.free_to_m[:, layer]
    is_open = (end > begin) & (end >= min(TO_M, 0.999 * frame.info.max_range_m))
    return Counter(OPEN if is_open[d] else reason(int(d), layer, levelled, found, TO_M) for d in rows)


def share_table(rows: dict[str, Counter[str]], names: Sequence[str], whole: str = "") -> str:
    """Markdown: percent of counts[whole], or of all counts where that is empty; names that do not occur are left out."""
    used = [n for n in names if any(counts[n] for counts in rows.values())]

    def cells(counts: Counter[str]) -> list[str]:
        total = counts[whole] if whole else counts.total()
        return [str(total), *(f"{100.0 * counts[n] / max(1, total):.1f}" if counts[n] else "" for n in used)]

    titles = ["scene", whole or "directions", *used]
    return markdown.table(titles, [[name, *cells(counts)] for name, counts in rows.items()])


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    a = view_parser(__doc__, skies=["clear", "clouds"], scenes=REFUSING).parse_args(arguments)
    camera, open_sky = StereoCamera(marked(profile_of(a.profile))), OpenSkyParams(mode="presume")
    extractor = Extractor(Params(), open_sky)
    rows: dict[str, Counter[str]] = {}
    for scene, seen in seen_views(a, camera, extractor):
        view, unmatched_px = seen.view, (seen.unmatched_left_px, seen.unmatched_right_px)
        name = f"{scene}, {view.sky}{', tilted' if view.pitch_deg or view.roll_deg else ''}"
        counts = reasons_of(seen.frame, seen.model, unmatched_px, extractor.params, open_sky)
        rows.setdefault(name, Counter()).update(counts)
    print(share_table(rows, (OPEN, *REASONS)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
