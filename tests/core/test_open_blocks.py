"""The marks and blocks of a levelled view against slow, obvious versions, cell by cell."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.stages.level import source_of_rows, source_rows_of_column
from core.stages.open_blocks import (
    BEYOND_ALL,
    BLOCK,
    CONTINUED,
    MEASURED,
    OTHER,
    OUTSIDE,
    PARTLY,
    SMOOTH,
    TEXTURED,
    MarkedView,
    join_ground,
    level_marks,
    sort_blocks,
)
from core.stages.open_columns import open_settings
from core.stages.open_space import OpenRows, end_of_edge, limit_far, set_open
from core.stages.view_geometry import Q_FAR, Q_UNKNOWN, ViewGeometry, view_geometry
from core.types import (
    BEYOND_MM,
    CONTINUED_MM,
    FAR_MM,
    SATURATED_MM,
    TEXTURED_MM,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    CameraInfo,
    Intrinsics,
)

Codes = NDArray[np.uint16]
CLEAR_M = 12.0
VALUES = np.array(
    [
        UNKNOWN_MM,
        TEXTURELESS_MM,
        BEYOND_MM,
        CONTINUED_MM,
        TEXTURED_MM,
        5000,
        11_999,
        12_000,
        12_001,
        40_000,
        FAR_MM,
        SATURATED_MM,
    ],
    np.uint16,
)


def random_view(seed: int) -> tuple[Codes, Codes, ViewGeometry]:
    """(depth with marks, codes of its view, view): patches of one value, so that blocks of each kind occur, and single pixels."""
    rng = np.random.default_rng(seed)
    width, height = (int(n) for n in rng.integers(30, 50, 2))
    info = CameraInfo("front", Intrinsics(width, height, 40.0, 40.0, 0.5 * width - 0.3, 0.5 * height))
    roll, pitch = rng.uniform(-0.4, 0.4, 2) * (seed % 3 > 0)
    R = rotation_level_cam_optical(rotation_from_euler(roll, pitch, 0.0) @ R_CAMFRD_OPTICAL)
    view = view_geometry(info, R, Params())
    patches = rng.choice(VALUES, (height // 6 + 1, width // 6 + 1))
    depth = np.kron(patches, np.ones((6, 6), np.uint16))[:height, :width].astype(np.uint16)
    single = rng.random(depth.shape) < 0.05
    depth[single] = rng.choice(VALUES, int(single.sum()))
    codes = np.where(rng.random((view.cols, view.rows)) < 0.5, Q_UNKNOWN, Q_FAR).astype(np.uint16)
    nearer = rng.random(codes.shape) < 0.1
    codes[nearer] = rng.integers(Q_FAR + 1, 65536, int(nearer.sum()))
    return depth, codes, view


def marked_view(depth: Codes, codes: Codes, view: ViewGeometry) -> MarkedView:
    """The result of the kernel."""
    shape = codes.shape
    out = MarkedView(np.empty(shape, np.uint16), np.empty(shape, np.uint16), np.empty(shape, np.uint8))
    level_marks(depth.ravel(), depth.shape, codes, view.H, CLEAR_M, view.f_px * view.lsb_per_px, out)
    return out


def naive_cell(z: int, code: int, forward: np.float32, gain: float) -> tuple[int, int, int]:
    """(code, mm, kind) of a cell within the image."""
    if code == Q_FAR:
        reached_mm = z if 1000.0 * CLEAR_M < z < FAR_MM else 1000.0 * CLEAR_M
        code = int(min(np.ceil(np.float32(1000.0 * gain) * forward / np.float32(reached_mm)), 65535.0))
    z = UNKNOWN_MM if z == SATURATED_MM else z
    of_mark = {TEXTURELESS_MM: SMOOTH, BEYOND_MM: MEASURED, CONTINUED_MM: CONTINUED, TEXTURED_MM: TEXTURED}
    return code, z, MEASURED if code != Q_UNKNOWN else of_mark.get(z, OTHER)


def naive_kind(kinds: list[int]) -> int:
    """The kind of a block of cells of these kinds."""
    measured = kinds.count(MEASURED)
    if OUTSIDE in kinds:
        return OUTSIDE
    if all(k == SMOOTH for k in kinds):
        return SMOOTH
    if 2 * measured >= len(kinds):
        return MEASURED
    if CONTINUED in kinds and set(kinds) <= {CONTINUED, MEASURED, SMOOTH}:
        return CONTINUED
    if OTHER in kinds:
        return PARTLY if measured else OTHER
    return TEXTURED


@pytest.mark.nojit
@pytest.mark.parametrize("pitch_deg", [-30.0, 0.0, 30.0])
def test_a_far_pixel_is_seen_through_to_the_clear_depth_and_no_farther(pitch_deg: float) -> None:
    """The range of a camera is a depth along its optical axis, a code stands for a forward distance."""
    info = CameraInfo("front", Intrinsics(48, 36, 40.0, 40.0, 23.5, 17.5))
    R = rotation_level_cam_optical(rotation_from_euler(0.0, math.radians(pitch_deg), 0.0) @ R_CAMFRD_OPTICAL)
    view = view_geometry(info, R, Params())
    depth, codes = np.full((36, 48), FAR_MM, np.uint16), np.full((view.cols, view.rows), Q_FAR, np.uint16)
    marked = marked_view(depth, codes, view)
    u, v = np.nonzero(marked.codes > Q_UNKNOWN)
    per_forward = view.H[2, 0] * u + view.H[2, 1] * v + view.H[2, 2]
    depth_m = view.f_px * view.lsb_per_px / marked.codes[u, v] * per_forward
    assert len(u) > 1000
    assert depth_m.max() <= CLEAR_M + 1e-4
    assert depth_m.min() > 0.95 * CLEAR_M


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(6))
def test_marks_and_blocks_are_those_of_each_cell(seed: int) -> None:
    depth, codes, view = random_view(seed)
    marked, gain = marked_view(depth, codes, view), view.f_px * view.lsb_per_px
    cols, rows = codes.shape
    expected, kinds = np.zeros((2, cols, rows), np.uint16), np.full((cols, rows), OUTSIDE)
    for u in range(cols):
        first, end = source_rows_of_column(view.H, u, depth.shape[1], depth.shape[0], rows)
        forward, at = np.empty(end - first, np.float32), np.empty(end - first, np.uint32)
        source_of_rows(view.H, u, first, depth.shape[1], depth.shape[0], forward, at)
        for i, v in enumerate(range(first, end)):
            z = int(depth.ravel()[at[i]])
            expected[0, u, v], expected[1, u, v], kinds[u, v] = naive_cell(z, int(codes[u, v]), forward[i], gain)
    assert np.array_equal(marked.codes, expected[0])
    assert np.array_equal(marked.mm, expected[1])
    assert np.array_equal(marked.kinds, 1 << kinds)

    shape = -(-cols // BLOCK), -(-rows // BLOCK)
    kind, near = np.empty(shape, np.uint8), np.empty(shape, np.float32)
    sort_blocks(marked, gain, kind, near)
    for j in range(shape[0]):
        for i in range(shape[1]):
            among = np.s_[j * BLOCK : (j + 1) * BLOCK : 2, i * BLOCK : (i + 1) * BLOCK : 2]
            assert kind[j, i] == naive_kind(kinds[among].ravel().tolist())
            most = int(marked.codes[among].max())
            assert near[j, i] == (np.float32(gain / most) if most > Q_FAR else BEYOND_ALL)


def test_every_kind_of_block_occurs() -> None:
    found: set[int] = set()
    for seed in range(6):
        depth, codes, view = random_view(seed)
        kinds = marked_view(depth, codes, view).kinds
        found |= set(np.log2(kinds).astype(int).ravel().tolist())
    assert found == {OUTSIDE, SMOOTH, MEASURED, OTHER, CONTINUED, TEXTURED}


def naive_join_ground(row: list[int]) -> list[int]:
    """The kinds of a row of cells below the horizon: up to three cells between smooth ground count as ground where they are smooth."""
    ground = [u for u, kind in enumerate(row) if kind == CONTINUED]
    joined = list(row)
    for one, next_one in pairwise(ground):
        for u in range(one + 1, next_one):
            joined[u] = CONTINUED if row[u] == SMOOTH and next_one - one - 1 <= 3 else row[u]
    return joined


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(4))
def test_narrow_gaps_in_smooth_ground_are_ground(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cols, rows, horizon = 60, 12, 5
    kinds = rng.choice([SMOOTH, CONTINUED, TEXTURED, MEASURED, OUTSIDE], (cols, rows), p=[0.5, 0.35, 0.05, 0.05, 0.05])
    mm = np.where(kinds == CONTINUED, CONTINUED_MM, np.where(kinds == SMOOTH, TEXTURELESS_MM, UNKNOWN_MM))
    marked = MarkedView(np.zeros((cols, rows), np.uint16), mm.astype(np.uint16), (1 << kinds).astype(np.uint8))
    join_ground(marked, horizon)
    expected = np.array([naive_join_ground(row.tolist()) if v >= horizon else row for v, row in enumerate(kinds.T)]).T
    assert np.array_equal(marked.kinds, 1 << expected)
    assert np.array_equal(marked.mm == CONTINUED_MM, expected == CONTINUED)
    changed = expected != kinds
    assert changed.any()
    assert (mm[changed] == TEXTURELESS_MM).all()


def naive_set_open(mm: Codes, u: int, run: OpenRows, code: int, out: Codes) -> None:
    """`set_open` of one column, cell by cell."""
    sky, end = True, end_of_edge(mm, u, max(run.first, min(run.edge, run.end)), run.edge_rows, out)
    for v in range(run.first, out.shape[1]):
        mark = int(mm[u, v]) if out[u, v] == Q_UNKNOWN else UNKNOWN_MM
        if v >= run.edge:
            sky = sky and mark == TEXTURELESS_MM
        at_edge = mark == TEXTURED_MM and run.edge <= v < end
        below = mark == CONTINUED_MM and run.edge <= v < run.ground_end
        if mark == BEYOND_MM or (mark == TEXTURELESS_MM and sky and v < run.end) or at_edge or below:
            out[u, v] = code


@pytest.mark.nojit
def test_an_edge_ends_at_ground_within_so_many_rows() -> None:
    mm = np.full((1, 30), TEXTURELESS_MM, np.uint16)
    out = np.full((1, 30), Q_UNKNOWN, np.uint16)
    mm[0, 10:15] = TEXTURED_MM
    assert end_of_edge(mm, 0, 8, 5, out) == 8, "smooth below it"
    mm[0, 15:] = CONTINUED_MM
    assert end_of_edge(mm, 0, 8, 5, out) == 15
    assert end_of_edge(mm, 0, 8, 4, out) == 8, "too high"
    mm[0, 15:] = UNKNOWN_MM
    assert end_of_edge(mm, 0, 8, 9, out) == 8, "nothing known below it"
    out[0, 15] = 77
    assert end_of_edge(mm, 0, 8, 9, out) == 15
    mm[0, 10:] = TEXTURED_MM
    nothing = np.full((1, 30), Q_UNKNOWN, np.uint16)
    assert end_of_edge(mm, 0, 8, 40, nothing) == 8, "to the lower border"
    mm[0] = TEXTURELESS_MM
    assert end_of_edge(mm, 0, 8, 40, nothing) == 8, "no edge"


@pytest.mark.nojit
def test_smooth_ground_within_an_edge_belongs_to_it_where_matched_ground_follows_soon() -> None:
    mm, out = np.full((1, 30), TEXTURELESS_MM, np.uint16), np.full((1, 30), Q_UNKNOWN, np.uint16)
    mm[0, 10:16], mm[0, 16], mm[0, 17:21] = TEXTURED_MM, CONTINUED_MM, TEXTURED_MM
    out[0, 21:] = 77
    assert end_of_edge(mm, 0, 8, 11, out) == 21
    assert end_of_edge(mm, 0, 8, 10, out) == 16, "too high: a thing below the smooth ground"
    mm[0, 19] = TEXTURELESS_MM
    assert end_of_edge(mm, 0, 8, 11, out) == 16, "a blank thing"


@pytest.mark.nojit
@pytest.mark.parametrize(
    "rows", [(3, 12, 17, 25, 6), (0, 40, 0, 0, 0), (0, 10, 10, 10, 0), (4, 20, 30, 22, 9), (0, 36, 40, 60, 9)]
)
def test_codes_of_open_cells_are_those_of_each_cell(rows: tuple[int, int, int, int, int]) -> None:
    run = OpenRows(*rows)
    rng = np.random.default_rng(run.ground_end)
    marks = np.array([UNKNOWN_MM, TEXTURELESS_MM, BEYOND_MM, CONTINUED_MM, TEXTURED_MM], np.uint16)
    mm = rng.choice(marks, (60, 40)).astype(np.uint16)
    mm[:40, : run.edge] = TEXTURELESS_MM
    mm[:20, run.edge : run.edge + 4] = TEXTURED_MM
    out = np.where(rng.random(mm.shape) < 0.3, 77, Q_UNKNOWN).astype(np.uint16)
    out[:30, : run.edge + 4] = Q_UNKNOWN
    expected = out.copy()
    for u in range(len(mm)):
        naive_set_open(mm, u, run, 500, expected)
    set_open(mm, (0, len(mm)), run, np.uint16(500), out)
    assert np.array_equal(out, expected)
    assert (out == 500).any()


@pytest.mark.nojit
@pytest.mark.parametrize("limit_m", [0.0, 4.0, 11.0])
def test_far_cells_reach_to_the_limit_of_their_column_or_to_the_range(limit_m: float) -> None:
    _, codes, view = random_view(1)
    gain = view.f_px * view.lsb_per_px
    s = open_settings(view, 15.0, CLEAR_M, OpenSkyParams(mode="presume"))[0]
    out = np.where(codes == Q_FAR, 1 + np.arange(codes.size, dtype=np.uint16).reshape(codes.shape), codes)
    out = out.astype(np.uint16)
    before, last = out.copy(), len(codes) - 1
    limit_far(codes, view.H, (1, last), limit_m, s, out)
    assert np.array_equal(out[[0, last]], before[[0, last]])
    assert np.array_equal(out[codes != Q_FAR], before[codes != Q_FAR])
    u, v = np.nonzero(codes[1:last] == Q_FAR)
    per_forward = view.H[2, 0] * (u + 1) + view.H[2, 1] * v + view.H[2, 2]
    reached_m = np.maximum(CLEAR_M / per_forward, limit_m)
    expected = np.maximum(before[u + 1, v], np.minimum(np.ceil(gain / reached_m), 65535))
    assert np.abs(out[u + 1, v].astype(int) - expected).max() <= 1
    assert (out[u + 1, v] > before[u + 1, v]).any()
