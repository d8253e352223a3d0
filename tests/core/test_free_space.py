"""The free-range profile against walking the cells one by one, and against scenes of known distances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import free_geometry as geometry
from core.stages import free_rings as rings
from core.stages import free_space as fs
from core.stages.depth_bias import DepthBias
from core.stages.free_cells import Samples, count_codes, look_at, looked_at
from core.stages.free_profile import PlaneStops, free_profile, stop_at_planes
from core.stages.ground import NO_GROUND
from core.stages.view_geometry import SOURCE, ViewGeometry
from core.types import FreeEnd, FreeProfile, Ground

from ..nightly import examples
from . import naive_free
from .columns import QUANTUM, F, code, view
from .tables import plane_table
from .views import VIEW, extract, flat_wall, free_to, level

SEED = st.integers(0, 2**32 - 1)
KE = 0.0015
SEEN_TO_19_M = np.array([(160, 120, 1.0, 0.0, 19.0, 20.0, 0.3)], SOURCE)[0]


def sees_through(codes: np.ndarray, x: float, per_forward: float) -> np.ndarray:
    """Whether each code sees through distance x: far does, the others measure behind it with two sigma to spare.

    per_forward: greatest optical depth over forward distance there."""
    measured = F * QUANTUM / np.maximum(codes, 1)
    return (codes == 1) | (
        (codes > 1) & (measured - np.minimum(2 * KE * per_forward * measured**2, 0.3 * measured) >= x)
    )


def random_codes(rng: np.random.Generator, cols: int, rows: int) -> np.ndarray:
    x = np.repeat(np.repeat(rng.uniform(1.0, 15.0, (cols // 8 + 1, rows // 8 + 1)), 8, 0), 8, 1)[:cols, :rows]
    codes = code(x.ravel()).reshape(x.shape)
    codes[rng.random(x.shape) < rng.choice([0.1, 0.5, 0.85])] = 0
    codes[rng.random(x.shape) < 0.2] = 1
    codes[:, : rng.integers(0, rows // 2)] = 0
    return codes


@pytest.mark.nojit
@examples(0.4)
@given(SEED)
def test_counting_and_walking_against_every_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = int(rng.choice([89, 90, 91, 92]))
    codes = random_codes(rng, 24, rows)
    ring_m = np.arange(0.5, 12.0, 0.5).astype(np.float32)
    pitch, roll, clear_m = rng.uniform(-0.5, 0.5), rng.uniform(-0.3, 0.3), rng.uniform(6.0, 15.0)
    ahead, down, right = math.cos(pitch), -math.sin(pitch), 0.02 * math.sin(roll)  # third row of R_optical_level
    edges_t = np.array([-0.12, -0.12 + 0.09 * rng.random(), 0.03, 0.12])
    direction = np.clip(np.searchsorted(edges_t, (np.arange(24) - 11.5) / F, side="right") - 1, 0, 2)
    asked = int(rng.integers(2, 9))
    block = asked + asked % 2
    blocks = -(-rows // block)
    # every second pair of rows of each column; an odd last row stands for the pair that it is half of
    u, v = np.meshgrid(np.arange(24), np.arange(rows), indexing="ij")
    weight = ((v // 2 + u) % 2 == 0) * np.where((v == rows - 1) & (rows % 2 == 1), 2, 1)
    looked = np.full((2, rows), 9, np.uint16)
    looked_at(rows, looked)
    np.testing.assert_array_equal(looked, weight[:2])
    cells, begin, dark = np.full(24 * (rows + 1) + 2, 7, np.uint16), np.full(blocks + 1, -1), np.full(blocks + 1, -1)
    samples = Samples(cells, begin, dark, np.full(rows, 5, np.uint16))
    for d in range(3):
        own = np.flatnonzero(direction == d)
        if len(own) == 0:
            continue
        look_at(codes, (own[0], own[-1] + 1), block, looked, samples)
        assert begin[0] == dark[0] == 0
        for b in range(blocks):
            part = (direction[:, None] == d) & (v // block == b)
            want = np.sort(np.repeat(codes[part], weight[part]))
            np.testing.assert_array_equal(np.sort(cells[begin[b] : begin[b + 1]]), want)
            assert dark[b + 1] - dark[b] == np.sum(want == 0)
    layers = np.array([-3.0, -1.0, 1.0, 3.0], np.float32)
    H = np.eye(3)
    H[2] = right / F, down / F, ahead - right * 11.5 / F - down * 44.5 / F
    g = view(cols=24, rows=rows)._replace(cv=44.5, cu=11.5, H=H)
    ground = NO_GROUND
    if rng.random() < 0.5:
        noise_per_m = 4.0 * KE * 1.3
        ground = Ground(
            seen=True, height_m=1.3, slope_x=0.02, slope_y=-0.1, blind_beyond_m=7.0, noise_per_m=noise_per_m
        )
    image = np.array([(40, 100, 1.0, 0.0, clear_m, 20.0, rng.uniform(0.1, 3.0))], SOURCE)[0]
    w = geometry.walk_settings(
        g, image, ground, KE, Params(profile_block_px=asked, profile_blank_m=rng.uniform(0.1, 1.0))
    )[0]
    behind = np.full((3, len(ring_m)), -1, np.int32)
    rings.blocking_codes(ring_m, edges_t, layers, w, behind)

    to_source = np.eye(3)  # an image of 40 x 100 pixels that is shifted and turned against the view
    to_source[0, 2], to_source[1] = rng.uniform(0.0, 15.0), [0.3 * rng.standard_normal(), 1.0, rng.uniform(-10.0, 20.0)]
    inside = np.abs(np.tensordot(to_source[1], np.stack([u, v, np.ones(u.shape)]), 1) - 49.5) <= 49.9999
    codes[~inside] = 0

    def depths(x: float, ts: np.ndarray, zs: list[float]) -> list[float]:
        return [ahead * x + right * t * x + down * z for t in ts for z in zs]

    def depth(x: float, ts: np.ndarray, zs: list[float]) -> float:
        return max(depths(x, ts, zs))

    grid = fs.ProfileGrid(edges_t, layers, ring_m, behind)
    start, to, end = fs.walk_view(codes, g._replace(H=to_source), image, grid, w)
    column_t = (np.arange(25) - 12.0) / F
    sides = naive_free.holes_of_all_sides(codes)
    for d in range(3):
        # the outermost directions take what lies beyond their edges
        overlaps = ((column_t[1:] > edges_t[d]) & (column_t[:-1] < edges_t[d + 1])) | (direction == d)
        for layer in range(3):
            from_m, to_m, why = naive_free.free_walk(
                codes, sides, weight, inside, direction, d, overlaps, layers[layer], layers[layer + 1], ring_m, 44.5, F, block, 0.8,
                lambda cells, x, zs=layers[layer : layer + 2]: sees_through(cells, x, depth(x, edges_t, zs) / x),
                lambda x, t=0.5 * (edges_t[d] + edges_t[d + 1]): geometry.lowest_clear(t, x, w),
                lambda x, z0, z1, ts=edges_t[d : d + 2]: depth(x, ts, [z0, z1]) <= clear_m, 0.1, w.blind_beyond_m,
                lambda x, z0, z1, ts=edges_t[d : d + 2]: min(depths(x, ts, [z0, z1])) <= w.near_m, w.profile_blank_m,
            )  # fmt: skip
            assert (start[d, layer], to[d, layer]) == (np.float32(from_m), to_m)
            assert FreeEnd(end[d, layer]).name == why


@pytest.mark.nojit
@given(st.floats(0.0001, 0.05), st.floats(0.0, 0.5), st.floats(50.0, 5000.0))
def test_what_a_code_sees_through_is_what_it_measures_behind(spread: float, cap: float, gain: float) -> None:
    x = gain / np.arange(2, 65536)
    reach = x - np.minimum(spread * x * x, cap * x)
    for ring_m in np.arange(0.4, 15.0, 0.7):
        behind = rings.least_blocking_code(gain, spread, cap, ring_m)
        np.testing.assert_array_equal(reach >= ring_m, np.arange(2, 65536) < behind)
        assert 2 <= behind <= 65535


def test_the_greatest_code_is_seen_through_at_no_distance() -> None:
    """It stands for its distance and for all that is nearer, such as the ground below a steep camera."""
    gain, codes = 80_000.0, np.arange(2, 65536)  # its own distance is 1.22 m
    np.testing.assert_array_equal(codes < rings.least_blocking_code(gain, 0.0, 0.0, 1.0), codes < 65535)
    np.testing.assert_array_equal(codes < rings.least_blocking_code(gain, 0.0, 0.0, 1.25), gain / codes >= 1.25)


@pytest.mark.nojit
@given(SEED)
def test_codes_are_counted_from_the_first_to_the_last_of_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.choice(np.array([0, 1, 2, 300, 301, 65535], np.uint16), 200)
    least, most = np.sort(rng.choice([0, 1, 2, 300, 65535], 2))
    first, end = np.sort(rng.integers(0, 201, 2))
    part = cells[first:end]
    assert count_codes(cells, first, end, least, most) == np.sum((part >= least) & (part <= most))


def test_more_cells_are_counted_than_a_narrow_number_holds() -> None:
    cells = np.full(150_000, 9, np.uint16)
    assert count_codes(cells, 1, 150_000, 9, 9) == 149_999


THICK: dict[str, float] = {"profile_layers": 7, "profile_layer_m": 2.0, "profile_outer_layers": 0}
"""Layers of 2 m: number 3 lies around the height of the camera."""


def profile(
    codes: np.ndarray,
    g: ViewGeometry,
    ground: Ground = NO_GROUND,
    clear_m: float = 19.0,
    min_range_m: float = 0.3,
    **params: float,
) -> FreeProfile:
    source = np.array([(*codes.shape, 1.0, 0.0, clear_m, 20.0, min_range_m)], SOURCE)
    walked = fs.WalkedView(codes=codes, geometry=g, source=source, ground=ground, ke_per_m=KE)
    seen = fs.observe_free(walked, Params(**{**THICK, **params}))
    no_planes = PlaneStops(plane_table(room=1)[:0], np.zeros(0, np.float32))
    return free_profile(seen, no_planes, DepthBias(0.0, 1.0, 0.0))


@pytest.mark.nojit
def test_the_nearest_rings_are_half_a_step_apart() -> None:
    found = np.zeros(60, np.float32)
    count = rings.place_rings(0.5, 12.0, found)
    want = np.concatenate([np.arange(1, 17) * 0.25, np.arange(4.5, 12.0, 0.5)])
    np.testing.assert_array_equal(found[:count], want.astype(np.float32))
    assert rings.place_rings(0.5, 0.25, found) == 0
    assert rings.place_rings(0.5, 12.0, found[:5]) == 5


@pytest.mark.parametrize("distance", [2.2, 5.0, 9.7, 16.0])
def test_a_wall_ends_the_free_range_less_than_a_ring_and_its_noise_before_it(distance: float) -> None:
    g = view(rows=120, cols=160)
    f = profile(np.full((160, 120), code(distance)[0]), g)
    # the layer about the camera, 2 m high, fits the view from 100 / 60 m on
    assert (f.free_from_m[:, 3] > 0).all()
    forward = f.free_to_m[:, 3] * np.cos(np.minimum(np.abs(f.azimuth_edges_rad[1:]), np.abs(f.azimuth_edges_rad[:-1])))
    assert (
        f.free_to_m[:, 3] * np.cos(np.maximum(np.abs(f.azimuth_edges_rad[1:]), np.abs(f.azimuth_edges_rad[:-1])))
        <= distance
    ).all()
    assert (forward >= distance - 0.5 - 2 * KE * distance**2 - 0.15).all()
    assert (f.end[:, 3] == FreeEnd.OBSTACLE).all()


def begins_at(codes: np.ndarray, layer: int = 3, min_range_m: float = 0.3, **params: float) -> np.ndarray:
    """Forward distance at which a layer begins to be free in each direction, m. Layer 3: that around the camera."""
    f = profile(codes, view(rows=codes.shape[1], cols=codes.shape[0]), min_range_m=min_range_m, **params)
    edges = np.abs(np.tan(f.azimuth_edges_rad.astype(float)))
    return f.free_from_m[:, layer] / np.sqrt(1.0 + np.maximum(edges[1:], edges[:-1]) ** 2)


@pytest.mark.parametrize(("rows", "begin_m"), [(120, 1.75), (130, 1.625), (134, 1.5)])
def test_a_free_range_begins_up_to_half_a_step_before_its_first_ring(rows: int, begin_m: float) -> None:
    """A layer of 2 m fits the view from 1.67, 1.54 and 1.49 m on; the rings are at 1.5 and 1.75 m."""
    np.testing.assert_allclose(begins_at(np.full((160, rows), 1, np.uint16)), begin_m, rtol=1e-5)


def test_one_free_ring_alone_gives_no_range() -> None:
    """A wall between the ring at 1.75 m and the next one at 2 m."""
    f = profile(np.full((160, 130), code(1.9)[0]), view(rows=130, cols=160))
    assert (f.free_to_m[:, 3] > 0.0).all()
    np.testing.assert_allclose(begins_at(np.full((160, 130), code(1.9)[0])), 1.75, rtol=1e-5)
    np.testing.assert_allclose(begins_at(np.full((160, 130), code(2.1)[0])), 1.625, rtol=1e-5)


def test_a_ring_in_view_that_is_not_free_is_not_halved() -> None:
    """A fifth of the cells at 1.5 m are unknown, and a little less at 1.625 m: something may be there."""
    codes = np.full((160, 134), 1, np.uint16)
    u, v = np.meshgrid(np.arange(160), np.arange(134), indexing="ij")
    codes[((u + v // 4) % 2 == 0) & ((v < 30) | (v >= 104))] = 0
    np.testing.assert_allclose(begins_at(codes), 1.75, rtol=1e-5)


def test_what_is_not_seen_through_at_the_middle_before_the_first_ring_is_not_free() -> None:
    codes = np.full((160, 130), 1, np.uint16)
    codes[:, :16] = codes[:, -16:] = code(1.2)[0]  # a quarter of the rows at the middle, less than a fifth at the ring
    np.testing.assert_allclose(begins_at(codes), 1.75, rtol=1e-5)


def test_a_column_that_is_unknown_at_the_middle_before_the_first_ring_is_not_free() -> None:
    """17 of the 32 blocks of rows at the middle, 15 of the 30 at the ring."""
    codes = np.full((160, 130), 1, np.uint16)
    codes[80, :64] = codes[80, 124:] = 0
    begins = begins_at(codes)
    assert (begins > 1.74).sum() == 1
    np.testing.assert_allclose(begins[begins < 1.74], 1.625, rtol=1e-5)


@pytest.mark.parametrize(("hole", "layer", "rows"), [(24, 7, 180), (260, 8, 420)])
def test_a_hole_at_the_middle_or_at_the_first_ring_may_hide_a_near_thing(hole: int, layer: int, rows: int) -> None:
    """The middle, 0.375 m, is nearer than 1.5 times the minimum range, the first ring, 0.5 m, is not. The first hole lies in
    the rows of the middle alone, the second in those of the ring alone."""
    thin = {name: getattr(Params(), name) for name in THICK}
    codes = np.full((160, rows), 1, np.uint16)
    np.testing.assert_allclose(begins_at(codes, layer, **thin), 0.375, rtol=1e-5)
    codes[78:82, hole : hole + 8] = 0
    begins = begins_at(codes, layer, **thin)
    assert (begins > 0.49).any()
    np.testing.assert_allclose(begins[[0, -1]], 0.375, rtol=1e-5)
    np.testing.assert_allclose(begins_at(codes, layer, min_range_m=0.2, **thin), 0.375, rtol=1e-5)


def test_unknown_and_field_of_view_are_distinguished() -> None:
    g = view(rows=120, cols=64)
    far = np.full((64, 120), 1, np.uint16)
    f = profile(far, g)
    assert (f.end[:, 3] == FreeEnd.MAX_RANGE).all()
    assert (f.free_to_m[:, 3] >= 18.5).all()
    assert (f.end[:, 0] == FreeEnd.NOT_SEEN).sum() == 0 or (f.free_to_m[f.end[:, 0] == FreeEnd.NOT_SEEN, 0] == 0).all()
    dark = profile(np.zeros((64, 120), np.uint16), g)
    assert (dark.free_to_m == 0).all()
    assert (dark.end[:, 3] == FreeEnd.UNKNOWN).all()
    spotted = far.copy()
    spotted[:, ::3] = 0  # a third unknown: not free
    assert (profile(spotted, g).free_to_m == 0).all()
    spotted[:, :] = 1
    spotted[:, ::8] = 0  # single pixels dropped: free
    assert (profile(spotted, g).free_to_m[:, 3] > 10).all()


@pytest.mark.parametrize(("across", "down"), [(2, 1), (1, 2), (3, 1), (1, 3), (2, 2)])
def test_no_pattern_of_unknown_cells_escapes_the_sampling(across: int, down: int) -> None:
    """Every second or third line, column or cell unknown: at least a quarter of the cells, so nothing is free."""
    g = view(rows=240, cols=640, f=450.0)  # some twenty columns in each direction but the last
    for shift in range(max(across, down)):
        codes = np.full((640, 240), 1, np.uint16)
        codes[shift % across :: across, shift % down :: down] = 0
        assert (profile(codes, g).free_to_m[:-1] == 0).all()


@pytest.mark.parametrize("column", [0, 80, 84, 159])
def test_a_column_without_a_measurement_is_not_free(column: int) -> None:
    """One unknown column of a direction: a pole or the end of a wall may be in it."""
    g = view(rows=120, cols=160)
    codes = np.full((160, 120), 1, np.uint16)
    codes[column] = 0
    f = profile(codes, g)
    own = np.flatnonzero(f.free_to_m[:, 3] == 0.0)
    edges = np.tan(f.azimuth_edges_rad.astype(float))
    assert len(own) == 1
    assert edges[own[0]] - 1e-6 <= (column - 79.5) / F <= edges[own[0] + 1] + 1e-6
    codes[column, ::4] = 1  # a quarter of it is seen: still hidden; with half of it seen it is not
    assert (profile(codes, g).free_to_m[:, 3] == 0.0).sum() == 1
    codes[column, 2::4] = 1
    assert (profile(codes, g).free_to_m[:, 3] > 10.0).all()


def test_a_chequered_pattern_of_unknown_cells_is_not_free() -> None:
    g = view(rows=240, cols=640, f=450.0)
    chequered = np.where(np.add.outer(np.arange(640), np.arange(240)) % 2 == 0, 0, 1).astype(np.uint16)
    assert (profile(chequered, g).free_to_m == 0).all()


def test_the_profile_spans_the_view_in_even_directions() -> None:
    g = view(rows=60, cols=160)
    f = profile(np.full((160, 60), 1, np.uint16), g)
    assert f.azimuth_edges_rad[0] == pytest.approx(math.atan(-80 / F))
    assert f.azimuth_edges_rad[-1] == pytest.approx(math.atan(80 / F))
    steps = np.diff(f.azimuth_edges_rad)
    np.testing.assert_allclose(steps[:-1], math.radians(2.5), rtol=1e-4)
    assert 0 < steps[-1] <= math.radians(2.5) + 1e-6
    np.testing.assert_allclose(f.layer_edges_m, np.arange(-7.0, 7.5, 2.0))


@pytest.mark.nojit
def test_layers_are_thin_around_the_camera_and_thick_above_and_below() -> None:
    edges = fs.layer_edges(Params())
    np.testing.assert_allclose(edges[3:13], np.arange(-2.25, 2.5, 0.5))
    np.testing.assert_allclose(edges[12:], np.linspace(2.25, 7.0, 4), rtol=1e-6)
    np.testing.assert_array_equal(edges, -edges[::-1])
    assert fs.layer_edges(Params(profile_layers=2, profile_layer_m=4.0, profile_reach_m=4.0)).tolist() == [-4, 0, 4]


def test_a_ball_between_floor_and_ceiling_fits_into_free_layers() -> None:
    """The ceiling 0.5 m above the camera, the floor 1.5 m below, a wall 6 m away: layers of 2 m are never free there."""
    rows = np.arange(240) - 119.5
    x = np.minimum(6.0, np.where(rows < 0.0, 0.5, 1.5) * F / np.abs(rows))
    codes = np.tile(code(x), (160, 1))
    g = view(rows=240, cols=160)
    assert (profile(codes, g).free_to_m == 0.0).all()
    thin = profile(codes, g, **{name: getattr(Params(), name) for name in THICK})
    inside = (thin.layer_edges_m[:-1] >= -0.5) & (thin.layer_edges_m[1:] <= 1.5)
    assert inside.sum() == 3
    assert (thin.free_to_m[:, inside] >= 4.5).all()
    outside = (thin.layer_edges_m[1:] <= -0.5) | (thin.layer_edges_m[:-1] >= 1.5)
    assert (thin.free_to_m[:, outside] == 0.0).all()


def test_layers_go_down_to_what_can_be_distinguished_from_the_ground() -> None:
    p = Params()
    ground = Ground(seen=True, height_m=2.0, slope_x=0.02, slope_y=-0.01, noise_per_m=4 * 0.005 * 2.0)
    w = geometry.walk_settings(view(), SEEN_TO_19_M, ground, 0.005, p)[0]
    for t in (0.0, 0.4):
        for x in (1.0, 10.0, 18.0):
            surface = 2.0 + 0.02 * x - 0.01 * t * x
            assert geometry.lowest_clear(t, x, w) == pytest.approx(surface - max(0.25, 4 * 0.005 * x * 2.0))
    assert geometry.lowest_clear(0.0, 10.0, geometry.walk_settings(view(), SEEN_TO_19_M, NO_GROUND, 0.005, p)[0]) > 1e5


def test_nothing_below_the_ground_is_free() -> None:
    g = view(rows=200, cols=64)
    far = np.full((64, 200), 1, np.uint16)
    assert (profile(far, g).free_to_m[:, 4] > 5).all()
    low = profile(far, g, Ground(seen=True, height_m=1.2, noise_per_m=4 * KE * 1.2))
    assert (low.free_to_m[:, 4:] == 0).all()
    assert (low.free_to_m[:, 3] > 5).all()
    # a layer cut by the ground is judged down to it
    assert (profile(far, g, Ground(seen=True, height_m=2.5, noise_per_m=4 * KE * 2.5)).free_to_m[:, 4] > 5).all()


def stopped(
    planes: np.ndarray,
    margin_m: list[float],
    edges_t: np.ndarray,
    layers: np.ndarray,
    *,
    pixel_t: float = 0.0,
    row_t: float = 0.0,
    range_m: float = 9.0,
) -> tuple[np.ndarray, np.ndarray]:
    """(free_to_m, end) of directions and layers that are free to range_m without these planes."""
    shape = len(edges_t) - 1, len(layers) - 1
    to, end = np.full(shape, range_m, np.float32), np.full(shape, 4, np.uint8)
    seen = fs.FreeObservation(np.arctan(edges_t), edges_t, pixel_t, row_t, layers, np.zeros_like(to), to, end)
    stop_at_planes(PlaneStops(planes[: len(margin_m)], np.array(margin_m, np.float32)), seen)
    return to, end


@pytest.mark.nojit
def test_no_plane_is_passed_and_its_margin_is_kept() -> None:
    planes = plane_table((5.0, -1.0, 6.0, 1.0, -0.5, 0.5), (3.0, 1.5, 3.0, 2.0, 1.5, 2.5), (1.0, -3.0, 1.0, 3.0, -9, 9))
    planes[2].support = -1  # dropped
    edges_t = np.linspace(-0.6, 0.6, 25)
    layers = np.array([-3.0, -1.0, 1.0, 3.0], np.float32)
    to, end = stopped(planes, [0.3, 0.1, 0.0], edges_t, layers)
    assert (to[:, 0] == 9.0).all()
    for d in range(24):
        ts = np.linspace(edges_t[d], edges_t[d + 1], 21)
        inside = ts[(ts >= -0.2) & (ts <= 1 / 6)]
        if len(inside) > 1:
            a, b = planes[0].a, planes[0].b
            assert to[d, 1] <= min(1.0 / (a + b * t) for t in inside) - 0.3 + 1e-5
            assert end[d, 1] == FreeEnd.OBSTACLE
        low = ts[(ts >= 0.5) & (ts <= 2 / 3)]
        assert to[d, 2] == pytest.approx(2.9) if len(low) > 1 else to[d, 2] in (pytest.approx(2.9), 9.0)


def test_a_plane_stops_a_pixel_more_on_either_side() -> None:
    planes = plane_table((5.0, -0.55, 5.0, 0.55, -0.5, 0.5))  # tangents -0.11..0.11
    edges_t, layers = np.linspace(-0.6, 0.6, 25), np.array([-1.0, 1.0], np.float32)
    for pixel_t, directions in ((0.0, range(9, 15)), (0.03, range(9, 15)), (0.05, range(8, 16))):
        to, _ = stopped(planes, [0.3], edges_t, layers, pixel_t=pixel_t)
        assert set(np.flatnonzero(to[:, 0] < 9.0)) == set(directions)
        np.testing.assert_allclose(to[list(directions), 0], 4.7, rtol=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_near_end_of_a_plane_seen_edge_on_is_a_pixel_nearer(mirrored: bool) -> None:
    """One pixel of a plane seen edge-on spans metres; the near end may lie in a pixel that was not measured."""
    near, far = (10.0, -0.5), (14.0, -0.42)  # tangents -0.05 and -0.03
    line = (near[0], -near[1], far[0], -far[1]) if mirrored else (*near, *far)
    planes = plane_table((*line, -0.5, 0.5))
    planes[0].t0, planes[0].t1 = min(planes[0].t0, planes[0].t1), max(planes[0].t0, planes[0].t1)
    edges_t, layers = np.linspace(-0.1, 0.1, 3), np.array([-1.0, 1.0], np.float32)
    to, _ = stopped(planes, [0.3], edges_t, layers, pixel_t=0.005, range_m=19.0)
    a, b = planes[0].a, planes[0].b
    outer = 0.055 if mirrored else -0.055
    assert to[int(mirrored), 0] == pytest.approx(1.0 / (a + b * outer) - 0.3, rel=1e-6)
    assert to[int(not mirrored), 0] == 19.0


def test_a_plane_stops_a_pixel_more_above_and_below() -> None:
    """At 5 m a row of 1/100 is 0.05 m high."""
    edges_t, layers = np.linspace(-0.1, 0.1, 3), np.arange(-1.0, 1.25, 0.25, np.float32)
    planes = plane_table((5.0, -1.0, 5.0, 1.0, -0.21, 0.21))
    for row_t, ended in ((0.0, range(3, 5)), (0.007, range(3, 5)), (0.01, range(2, 6))):
        to, _ = stopped(planes, [0.3], edges_t, layers, row_t=row_t)
        assert set(np.flatnonzero(to[0] < 4.8)) == set(ended)


def test_what_a_plane_of_another_layer_hides_is_not_free() -> None:
    planes = plane_table((2.0, -3.0, 2.0, 3.0, -0.5, 0.9))
    edges_t = np.linspace(-0.6, 0.6, 25)
    layers = np.array([-5.0, -3.0, -1.0, 1.0, 3.0], np.float32)
    to, end = stopped(planes, [0.3], edges_t, layers)
    np.testing.assert_allclose(to, np.tile([9.0, 4.0, 1.7, 2.0 / 0.9], (24, 1)), rtol=1e-6)
    np.testing.assert_array_equal(end, np.tile([4, FreeEnd.UNKNOWN, FreeEnd.OBSTACLE, FreeEnd.UNKNOWN], (24, 1)))
    # what lies wholly above or below the camera hides nothing of the layers nearer to its height
    for z in ([-2.5, -1.2], [1.2, 2.5]):
        planes = plane_table((2.0, -3.0, 2.0, 3.0, *z))
        to, _ = stopped(planes, [0.3], edges_t, layers)
        assert (to[:, 2] == 9.0).all()
        assert (to[:, 1 if z[0] > 0 else 3] == 9.0).all()


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, 0.0), (-0.3, 0.4)])
def test_free_ranges_before_a_wall_are_right_at_any_tilt(tilt: tuple[float, float]) -> None:
    model = extract(flat_wall(VIEW, 7.0, *tilt), VIEW, level(*tilt))
    f = model.free
    widest = np.maximum(np.abs(f.azimuth_edges_rad[1:]), np.abs(f.azimuth_edges_rad[:-1]))
    assert (f.free_to_m * np.cos(widest)[:, None] <= 7.0 + 1e-3).all()
    assert free_to(model, 0.0, 0.0) > 6.0


def test_columns_pooled_for_speed_hide_no_unknown() -> None:
    """Every second column unknown: pooled by their nearest they would look seen through."""
    depth = flat_wall(VIEW, 7.0)
    depth[:, ::2] = 0
    assert free_to(extract(depth, VIEW, column_step=2), 0.0, 0.0) == 0.0
    assert free_to(extract(flat_wall(VIEW, 7.0), VIEW, column_step=2), 0.0, 0.0) > 6.0
