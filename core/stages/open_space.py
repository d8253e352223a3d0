"""Open space: unmeasured, textureless pixels that are presumed free on stated evidence. See docs/explanation/open-space.md.

Stereo measures no smooth surface, so a clear sky is unmeasured, as a blank wall is. The sky is distinguished from the wall by its
border: each column of the levelled view is open where its textureless pixels reach from the upper border of the image down to an
edge, below which something is measured at distance R. A blank object nearer than R in that column would need an edge of its own:
upright ones are measured, at the object's distance; those that are nearly parallel to the image rows are not, so an edge counts at
the horizon alone. The column is open up to R, or to what is measured beside it.

The result is an image of codes in which open pixels see through up to that range; free_space.py then walks over it as it does
for the free profile, with the same rules for borders, ground and range."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import inline_ieee, inner, inner_inline, kernel
from ..open_sky_params import OpenSkyParams
from ..params import Params
from ..types import BEYOND_MM, CONTINUED_MM, TEXTURED_MM, TEXTURELESS_MM, UNKNOWN_MM
from .free_space import FreeObservation, WalkedView, observe_free
from .open_blocks import (
    BEYOND_ALL,
    BLOCK,
    EDGE_ROWS,
    STEP,
    MarkedView,
    join_ground,
    level_marks,
    sort_blocks,
)
from .open_columns import (
    Columns,
    bridge_columns,
    empty_columns,
    limit_columns,
    open_settings,
    scan_column,
    things_above,
)
from .view_geometry import Q_FAR, Q_UNKNOWN

_FAR = np.uint16(Q_FAR)
_MOST_HOLE = 4
"""Rows of a textured hole in measured ground that are filled: one less than the marks of a single edge take (`SmoothLimits.grow_px`
on both sides of it), so that an object of its own is never filled."""


@inner
def end_of_edge(mm, u, first, most, out):
    """The row behind the textured cells of column u that are the edge of the textureless ones from row `first` on, where matched or
    smooth ground follows. `first` where that does not follow within `most` rows: they are no edge, a textured object may begin at
    the horizon. Where matched ground follows within these rows, smooth ground between both is part of the edge."""
    rows, v = out.shape[1], first
    while v < rows and out[u, v] == Q_UNKNOWN and mm[u, v] == TEXTURELESS_MM:
        v += 1
    last = min(rows - 1, v + most)
    while v < last and out[u, v] == Q_UNKNOWN and mm[u, v] == TEXTURED_MM:
        v += 1
    if v > last or (out[u, v] == Q_UNKNOWN and mm[u, v] not in (BEYOND_MM, CONTINUED_MM)):
        return first
    end = v
    while v < last and out[u, v] == Q_UNKNOWN and mm[u, v] in (TEXTURED_MM, CONTINUED_MM):
        v += 1
    return v if out[u, v] != Q_UNKNOWN or mm[u, v] == BEYOND_MM else end


class OpenRows(NamedTuple):
    """Rows of a column of blocks whose unknown cells get the code of what is open."""

    first: int  # first row of the textureless run
    edge: int  # row behind it. Textureless cells below are open until something else is met.
    end: int  # row from which on no textureless cell is open
    ground_end: int  # row from which on no smooth ground is open
    edge_rows: int  # greatest height of the textured edge of the run, rows


@inner
def set_open(mm, columns, run, code, out):
    """Gives a code to unknown cells of columns (first, end) by their marks: textureless cells of a run, the textured ones that
    are its edge, and smooth ground below that. Cells that were matched beyond what millimetres can hold get it from row run.first
    on. Cells of which nothing is known, and what lies lower, keep theirs. run: OpenRows."""
    rows = out.shape[1]
    below_sky = min(rows, max(run.first, min(run.edge, run.end)))
    end = min(rows, max(below_sky, max(run.end, run.ground_end)))
    for u in range(columns[0], columns[1]):
        # the edge before it changes
        edge = end_of_edge(mm, u, below_sky, run.edge_rows, out)
        set_marked(mm[u, run.first : below_sky], code, code, out[u, run.first : below_sky])
        sky = True
        for v in range(below_sky, end):
            # a mark stays where the view has no code of its own, and is none elsewhere
            mark = mm[u, v] if out[u, v] == Q_UNKNOWN else np.uint16(UNKNOWN_MM)
            sky = sky and mark == TEXTURELESS_MM
            in_sky, at_edge = sky and v < run.end, mark == TEXTURED_MM and v < edge
            if in_sky or at_edge or mark == BEYOND_MM or (mark == CONTINUED_MM and v < run.ground_end):
                out[u, v] = code
        set_marked(mm[u, end:], np.uint16(Q_UNKNOWN), code, out[u, end:])


@inner_inline
def set_marked(mm, textureless, matched, out):
    """Gives codes to unknown cells (N,): to those that are textureless, and to those matched beyond what millimetres can hold."""
    for i in range(len(out)):
        mark, code = mm[i], out[i]
        given = textureless if mark == TEXTURELESS_MM else code
        given = matched if mark == BEYOND_MM else given
        out[i] = given if code == Q_UNKNOWN else code


@inner
def fill_holes(mm, columns, first, end, code, out):
    """Textured holes of at most _MOST_HOLE rows between measured cells of columns (first, end) and rows first..end - 1 get the nearest of
    both and of the code: texture is matched with holes where it is fine."""
    for u in range(columns[0], columns[1]):
        begin, textured = first, True
        for v in range(first, min(end, out.shape[1])):
            if out[u, v] == Q_UNKNOWN:
                textured = textured and mm[u, v] == TEXTURED_MM
                continue
            if begin > first and textured and v - begin <= _MOST_HOLE:
                for row in range(begin, v):
                    out[u, row] = max(code, max(out[u, begin - 1], out[u, v]))
            begin, textured = v + 1, True


@kernel
def open_codes(depth_mm, codes, H, settings, columns, marked):
    """marked.codes: (cols, rows) uint16 out, the codes with those of open cells set to the range to which they are open.

    depth_mm: (H, W) uint16 of the source with its marks; codes: of its levelled view, H: of ViewGeometry. settings: (1,)
    OPEN_SETTINGS. columns: Columns of the blocks of the view, filled. marked: MarkedView, filled."""
    rows = codes.shape[1]
    s = settings[0]
    n = len(columns.limit_m)
    shape = (n, (rows + BLOCK - 1) // BLOCK)
    kind, near = np.empty(shape, np.uint8), np.empty(shape, np.float32)
    # what is beyond the range of the camera has a distance too
    level_marks(depth_mm.ravel(), depth_mm.shape, codes, H, s.far_m, s.gain, marked)
    join_ground(marked, max(0, int(math.ceil(s.horizon_row))))
    sort_blocks(marked, s.gain, kind, near)
    judge_columns(kind, near, marked.kinds, s, columns)
    for j in range(n):
        if columns.limit_m[j] < s.most_m:
            limit_far(codes, H, (j * BLOCK, min((j + 1) * BLOCK, len(codes))), columns.limit_m[j], s, marked.codes)
        if columns.base_m[j] > 0.0:
            open_column(marked.mm, columns, j, s, marked.codes)


@inner
def judge_columns(kind, near, cells, s, columns):
    """Fills `columns`. kind, near: (C, R) of `sort_blocks`; cells: `MarkedView.kinds`."""
    horizon = int(math.floor((s.horizon_row + 0.5) / BLOCK))
    for j in range(kind.shape[0]):
        u = j * BLOCK
        sampled = cells[u], cells[u + STEP if u + STEP < len(cells) else u]
        top, edge, base, base_m, why = scan_column(kind[j], near[j], sampled, s)
        columns.top[j], columns.edge[j], columns.base[j], columns.base_m[j] = top, edge, base, base_m
        columns.refusal[j] = why
        columns.above_m[j], columns.floating_m[j] = things_above(
            kind[j], near[j], max(edge if base_m > 0.0 else 0, horizon)
        )
    bridge_columns(columns)
    limit_columns(columns, s)


@inner
def open_column(mm, columns, j, s, out):
    """Sets the codes of column j of blocks, which gives evidence. Where its neighbours rule it out, only what was matched beyond
    the range counts."""
    cols, rows = out.shape
    limit = columns.limit_m[j]
    among = (j * BLOCK, min((j + 1) * BLOCK, cols))
    first = columns.top[j] * BLOCK
    if limit <= 0.0:
        set_open(mm, among, OpenRows(first, rows, 0, 0, 0), np.uint16(Q_FAR), out)
        return
    code = np.uint16(Q_FAR)
    if limit < s.most_m:
        code = np.uint16(min(65535.0, math.ceil(s.gain / max(limit, np.float32(1e-3)))))
    below, edge = min((columns.base[j] + 1) * BLOCK, rows), columns.edge[j] * BLOCK
    gap = int(s.gap_t * s.f_px)
    run = OpenRows(first, edge, min(below, edge + gap + BLOCK), edge + int(s.continued_t * s.f_px), EDGE_ROWS + gap)
    set_open(mm, among, run, code, out)
    fill_holes(mm, among, edge, edge + 3 * gap, code, out)


@inner
def limit_far(codes, H, columns, limit_m, s, out):
    """Limits the distance of far cells of columns (first, end) to limit_m, but not to less than free ranges see through them.

    No planes stand for what is measured beyond the range. The side of a blank object is at times measured too far away there, as its
    upright edge takes part of the disparity of the ground behind. So a far cell is open only as far as its column.

    codes, H: as in `open_codes`; s: a record of OPEN_SETTINGS; out: (cols, rows) uint16, in and out."""
    most = np.float32(s.gain / limit_m) if limit_m > 0.0 else BEYOND_ALL
    scale = s.gain / s.far_m
    for u in range(columns[0], columns[1]):
        # an optical depth as a forward distance
        first, per_row = np.float32(scale * (H[2, 0] * u + H[2, 2])), np.float32(scale * H[2, 1])
        raise_far(codes[u], first, per_row, most, out[u])


@inline_ieee
def raise_far(codes, first, per_row, most, out):
    """Raises the codes of far cells of one column (rows,) to at least first + per_row * row, or to `most`, where that is less."""
    for v in range(len(out)):
        least = np.ceil(min(first + per_row * np.float32(np.int32(v)), most))
        code = np.uint16(np.int32(min(least, np.float32(65535.0))))
        code = max(code, out[v])
        out[v] = code if codes[v] == _FAR else out[v]


def far_m(clear_m: float, ke_per_m: float, params: Params) -> float:
    """The optical depth that the walk, which takes its noise off, sees through up to clear_m: free ranges take none off what is far."""
    spread = params.profile_sigmas * ke_per_m
    root = 1.0 - 4.0 * spread * clear_m
    without_cap = 2.0 * clear_m / (1.0 + math.sqrt(root)) if root >= 0.0 else math.inf
    return min(without_cap, clear_m / (1.0 - params.profile_noise_cap))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OpenObservation:
    """What is free or open by pixels alone, and the evidence: seen: as `observe_free` gives it; columns: of the blocks of the view;
    marked: its cells with the codes of open ones, in buffers that the next call overwrites."""

    seen: FreeObservation
    columns: Columns
    marked: MarkedView


@lru_cache(maxsize=4)
def _walk_params(params: Params, share: float) -> Params:
    """The parameters of the walk over open codes: it reaches beyond the planes, which stop the free profile at slivers."""
    return replace(params, free_share=max(share, params.free_share))


def observe_open(
    depth_mm: NDArray[np.uint16],
    walked: WalkedView,
    params: Params,
    open_sky: OpenSkyParams,
    buffers: Buffers,
) -> OpenObservation | None:
    """What is free or open by the pixels of a levelled view; None where nothing is to be presumed.

    depth_mm: (H, W) uint16 of the source with its marks; walked: its view."""
    if not open_sky.presumes:
        return None
    source, codes = walked.source.copy(), walked.codes
    most_m = min(float(source["max_range_m"][0]), open_sky.open_max_range_m)
    far = far_m(float(source["clear_m"][0]), walked.ke_per_m, params)
    settings = open_settings(walked.geometry, most_m, far, open_sky)
    columns = empty_columns(-(-len(codes) // BLOCK))
    marked = MarkedView(
        codes=buffers("open_codes", codes.shape, np.uint16),
        mm=buffers("open_marks", codes.shape, np.uint16),
        kinds=buffers("open_kinds", codes.shape, np.uint8),
    )
    open_codes(depth_mm, codes, walked.geometry.H, settings, columns, marked)
    source["clear_m"] = most_m
    over_open = replace(walked, codes=marked.codes, source=source)
    seen = observe_free(over_open, _walk_params(params, open_sky.open_share))
    return OpenObservation(seen=seen, columns=columns, marked=marked)
