"""Every peer on a wall of which all is known, and what the run makes of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.fidelity.metrics import rays_of
from benchmarks.fidelity.result import Case
from benchmarks.peers import octomap as peer_octomap
from benchmarks.peers import open3d_patches as peer_open3d
from benchmarks.peers.cloud import Cloud, cloud_of
from benchmarks.peers.methods import Grid, Ours, Peer
from benchmarks.peers.open3d_patches import rectangle
from benchmarks.peers.participants import SAFE, contestants
from benchmarks.peers.run import CLOUD, Figures, figures, run_case, time_peers
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered, camera_info, render

KE = 0.0015
INFO = camera_info(160, 120, ke_per_m=KE)
WALL_X = 8.07
"""No multiple of any cell size."""
CASE = Case(scene="wall", ke_per_m=KE, configured_ke_per_m=KE, seed=1, width=160)
PEERS, ABSENT = contestants()


def peer(name: str) -> Peer:
    """The peer of that name; skips where its library is not installed."""
    found = [p for p in PEERS if p.name == name]
    if not found:
        library = next((part for part in dict(ABSENT) if name.startswith(part)), name)
        pytest.skip(f"{library} is not installed (extra peers)")
    return found[0]


def wall_frame() -> Rendered:
    """A wall 6 m wide and 4 m high, straight across the view 8.07 m ahead; the camera 2 m above the ground."""
    b = SceneBuilder("test")
    b.ground()
    b.wall("wall", (WALL_X, -3.0), (WALL_X, 3.0), 4.0, thickness=0.01)
    return render(b.build(), INFO)


def judged(name: str, frame: Rendered) -> Figures:
    p, cloud = peer(name), cloud_of(frame, KE)
    p.forget()
    return figures(p, CASE, frame, rays_of(frame, KE), p.model(p.build(frame, cloud)), True)


NAMES = [
    SAFE,
    "3DP grid 0.1 m",
    "3DP grid 0.8 m",
    "3DP grid 0.8 m, not simplified",
    "OctoMap 0.1 m",
    "OctoMap 0.4 m",
    "Open3D planar patches",
    "Open3D VoxelGrid 0.1 m",
    "Open3D VoxelGrid 0.4 m",
]


@pytest.mark.parametrize("name", NAMES)
def test_each_peer_stands_for_the_wall_where_it_is(name: str) -> None:
    found = judged(name, wall_frame())
    cell = next((c for c in (0.1, 0.2, 0.4, 0.8) if f"{c} m" in name), 0.1)
    assert found.obstacle_rays > 2500
    assert found.missed == 0
    assert found.phantom == 0
    assert found.body_mean_m <= found.mean_m <= 0.75 * cell
    assert found.p95_m < 1.1 * cell
    assert found.phantom_open <= 0.001 * found.open_rays
    # what is built around a wall of 6 x 3.75 m: a plane, four sides in two layers, or cubes of its face
    expected = {"planes": (1, 9), "patches": (1, 3)}.get(found.unit, (0.7 * 22.5 / cell**2, 1.5 * 22.5 / cell**2))
    assert expected[0] <= found.primitives <= expected[1] or "OctoMap 0.1" in name
    assert found.facing <= found.primitives
    assert found.bytes > 0


def test_one_mode_of_ours_beside_the_other_and_an_empty_frame() -> None:
    frame = wall_frame()
    nothing = replace(frame, depth_mm=np.zeros_like(frame.depth_mm))
    for mode in ("safe", "paper"):
        assert judged(f"OSAPE, {mode}", frame).primitives >= 1
        built = Ours(mode).build(nothing, cloud_of(nothing, KE))
        assert not built.valid


@pytest.mark.parametrize("name", [n for n in NAMES if "OSAPE" not in n])
def test_nothing_seen_is_nothing_built_and_all_is_missed(name: str) -> None:
    frame, p = wall_frame(), peer(name)
    built = p.build(frame, Cloud(np.zeros((0, 3)), 2.0, INFO.intrinsics.fx))
    found = figures(p, CASE, frame, rays_of(frame, KE), p.model(built), True)
    assert found.primitives == 0
    assert found.bytes == 0
    assert found.missed == found.obstacle_rays
    assert found.open_stopped == 0
    assert math.isinf(found.mean_m)


def test_octomap_leaves_come_apart_into_their_smallest_cubes() -> None:
    centres, sizes = np.array([[0.05, 0.05, -0.05], [0.3, 0.1, 0.1]]), np.array([0.1, 0.2])
    cubes = peer_octomap.small_cubes(centres, sizes, 0.1)
    assert sorted(map(tuple, cubes.tolist())) == sorted(
        [(0, 0, -1), *[(x, y, z) for x in (2, 3) for y in (0, 1) for z in (0, 1)]]
    )


def test_octomap_bytes_are_of_what_is_occupied_alone() -> None:
    p = peer("OctoMap 0.4 m")
    cloud = cloud_of(wall_frame(), KE)
    tree = p.build(wall_frame(), cloud)
    assert 0 < p.model(tree).bytes < len(tree.writeBinary())


def test_voxels_are_exactly_the_cubes_that_hold_a_point() -> None:
    p = peer("Open3D VoxelGrid 0.4 m")
    points = np.array([[5.0, 0.0, 0.1], [5.0, 0.1, 0.1], [6.0, 1.0, -1.0]])
    model = p.model(p.build(wall_frame(), Cloud(points, 2.0, INFO.intrinsics.fx)))
    assert model.primitives == 2
    assert model.bytes == 12
    np.testing.assert_allclose(model.body(points), 0.0, atol=1e-6)
    assert model.body(np.array([[5.0, 0.05, 1.0]]))[0] == pytest.approx(
        0.6
    )  # cubes from half a side beside the least point


def test_the_middle_rectangle_of_an_oriented_box() -> None:
    c, s = math.cos(0.3), math.sin(0.3)
    axes = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    patch = rectangle(np.array([1.0, 2.0, 3.0]), axes, np.array([4.0, 2.0, 0.5]))
    np.testing.assert_allclose(patch[:3] + 0.5 * (patch[3:6] + patch[6:]), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(np.linalg.norm(patch[3:6]), 4.0)
    np.testing.assert_allclose(np.cross(patch[3:6], patch[6:]) / 8.0, axes[:, 2])


def test_a_missing_library_is_reported_and_not_fatal(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(f"No module named {name!r}")

    for module in (peer_octomap, peer_open3d):
        monkeypatch.setattr(module.importlib, "import_module", absent)
    found, missing = contestants()
    assert {p.unit for p in found} == {"planes"}
    assert [name for name, _ in missing] == ["OctoMap", "Open3D"]
    assert all("not installed" in why for _, why in missing)


def test_a_case_gives_every_peer_the_same_rays() -> None:
    found = run_case(CASE, [Ours("safe"), Grid(0.4)])
    assert [f.peer for f in found] == [SAFE, "3DP grid 0.4 m"]
    assert found[0].obstacle_rays == found[1].obstacle_rays > 1000
    assert all(f.valid and f.family == "structured" for f in found)
    assert found[0].mean_m < found[1].mean_m


def test_a_grid_of_all_pixels_is_made_of_mismatches_too() -> None:
    found = run_case(
        replace(CASE, scene="street"), [Grid(0.8), Grid(0.8, sorted_pixels=False), Grid(0.8, simplified=False)]
    )
    sorted_out, everything, rough = (f.primitives for f in found)
    assert everything > 1.3 * sorted_out
    assert rough > sorted_out


def test_times_are_of_every_peer_on_every_kind_of_frame() -> None:
    peers = [Ours("safe"), Grid(0.4)]
    timings = time_peers(peers, {"a": [CASE], "b": [replace(CASE, scene="trees")]}, 3, 60.0)
    assert [(t.kind, t.peer) for t in timings] == [(k, n) for k in "ab" for n in (SAFE, "3DP grid 0.4 m", CLOUD)]
    assert all(len(t.times) == 3 and t.times.cpu() > 0.0 for t in timings)
    one = time_peers(peers[1:], {"a": [CASE]}, 12, 0.0)
    assert {len(t.times) for t in one} == {3}  # out of budget
