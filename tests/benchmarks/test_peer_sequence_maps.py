"""Each library that merges frames, on a wall of which all is known. Skipped where it is not installed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.peers.sequences import octomap, tsdf, wavemap
from benchmarks.peers.sequences.mapper import Mapper
from tests.benchmarks.test_peer_sequences import away, given, judged, wall_frames

LIBRARIES = {"pyoctomap": octomap.makers, "open3d": tsdf.makers, "pywavemap": wavemap.makers}
KE, SIGMA_M = 0.0015, 0.1
"""Noise, and its standard deviation at the wall."""
NAMES = [
    ("pyoctomap", "OctoMap 0.1 m", 0.1),
    ("pyoctomap", "OctoMap 0.2 m", 0.2),
    ("open3d", "Open3D TSDF 0.1 m", 0.1),
    ("open3d", "Open3D TSDF 0.2 m", 0.2),
    ("pywavemap", "wavemap 0.1 m", 0.1),
    ("pywavemap", "wavemap 0.2 m", 0.2),
]


def mapper(library: str, name: str) -> Mapper:
    pytest.importorskip(library)
    found = LIBRARIES[library]()
    assert not isinstance(found, str)
    makers: list[Callable[[], Mapper]] = found
    return next(m for m in (make() for make in makers) if m.name == name)


@pytest.mark.parametrize(("library", "name", "cell_m"), NAMES)
def test_a_wall_is_where_it_is_under_a_true_and_under_a_wrong_pose(library: str, name: str, cell_m: float) -> None:
    frames = wall_frames(5, KE)
    true, off = mapper(library, name), mapper(library, name)
    for e in frames:
        true.add(given(e))
        off.add(given(e, away))
    for m, frame in ((true, given(frames[-1])), (off, given(frames[-1], away))):
        found = judged(m.model(frame), frame, frames)
        # a mesh ends within a voxel of the edges of the wall
        assert found.missed < (0.15 if library == "open3d" else 0.01) * found.obstacle_rays
        assert found.phantom == 0
        assert found.open_stopped < 0.05 * found.open_rays
        assert found.error_m < 1.1 * cell_m + 3.0 * SIGMA_M
        assert found.bytes > 100
        assert found.primitives > 100


@pytest.mark.parametrize(("library", "name", "cell_m"), NAMES)
def test_pixels_without_a_measurement_make_no_obstacle(library: str, name: str, cell_m: float) -> None:
    m, e = mapper(library, name), wall_frames()[0]
    blind = np.zeros((120, 160), np.float32)
    for _ in range(4):
        frame = given(e)
        frame.depth_m[:, :] = blind
        m.add(frame)
    found = judged(m.model(frame), frame)
    assert found.phantom == 0
    assert found.open_stopped == 0
    assert found.missed == found.obstacle_rays


def test_a_surface_of_too_few_observations_is_no_surface() -> None:
    m, e = mapper("open3d", "Open3D TSDF 0.1 m"), wall_frames()[0]
    m.add(given(e))
    assert judged(m.model(given(e)), given(e)).primitives == 0
