"""The truth check of free space and sectors for cameras of other sizes, lenses, attitudes and defects."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.free_space import campaign, rigs
from benchmarks.free_space.rigs import judge_rig, random_rig, view_of
from benchmarks.free_space.unusual_frames import unusual_frame
from companion.autopilot.polar_histogram import SectorScan, SectorState, scan
from companion.config.avoidance import AvoidParams
from core.extractor import Extractor
from core.types import Intrinsics
from drivers.simulation.scenes import SceneBuilder

NUMBERS = range(24)


def test_an_unusual_frame_is_the_same_again() -> None:
    for number in NUMBERS:
        one, other = unusual_frame(2, number).frame, unusual_frame(2, number).frame
        np.testing.assert_array_equal(one.depth_mm, other.depth_mm)
        assert one.info == other.info


def test_the_cameras_differ_from_those_of_the_random_frames() -> None:
    frames = [unusual_frame(2, number) for number in NUMBERS]
    of: list[Intrinsics] = [r.frame.info.intrinsics for r in frames]
    assert any(k.height > k.width for k in of)
    assert any(abs(k.fy / k.fx - 1.0) > 0.1 for k in of)
    assert any(abs(k.cx / k.width - 0.5) > 0.2 for k in of)
    assert any(k.width > 2.2 * k.fx for k in of)  # 95 degrees and more
    assert any(abs(r.roll_deg) > 60.0 for r in frames)
    assert any(abs(r.pitch_deg) > 40.0 for r in frames)
    assert any(math.hypot(r.frame.scene.ground.slope_x, r.frame.scene.ground.slope_y) > 0.2 for r in frames)


def test_what_unusual_cameras_call_free_is_free_whatever_was_seen_before() -> None:
    """One extractor that saw other images, and a new one, give the same model."""
    used, cells, valid = Extractor(), 0, 0
    for number in NUMBERS:
        r = unusual_frame(2, number)
        if r.frame.depth_mm.size > 100_000:
            continue
        wrong, claimed, is_valid, _ = campaign.judge(r, used, below_ground=False)
        assert wrong == [], number
        frame = r.frame
        one, _ = used.extract(frame.depth_mm, frame.info, frame.R_level_optical)
        other, _ = Extractor().extract(frame.depth_mm, frame.info, frame.R_level_optical)
        np.testing.assert_array_equal(one.planes, other.planes)
        np.testing.assert_array_equal(one.free.free_to_m, other.free.free_to_m)
        cells, valid = cells + claimed, valid + is_valid
    assert cells > 500
    assert valid > 10


def test_no_sector_of_a_rig_reaches_into_a_solid() -> None:
    extractor, judged = Extractor(), 0
    for number in range(12):
        counts = judge_rig(random_rig(2, number), extractor)
        assert counts.wrong == (), number
        judged += counts.clear + counts.obstacles
    assert judged > 20


def test_a_sector_that_reaches_into_a_solid_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A box 5 m ahead of a vehicle whose sectors are all clear to 8 m, or at an obstacle of 8 m."""
    s = SceneBuilder("box")
    s.box("box", 6.0, 0.0, 2.0, 2.0, 9.0)
    rig = replace(
        random_rig(2, 0),
        scene=s.build(),
        place_m=np.array([0.0, 0.0, -4.0]),
        R_ned_frd=np.eye(3),
        heading_rad=0.0,
        avoid=AvoidParams(max_distance_m=8.0, near_m=1.0, radius_m=0.0),
    )
    for state, distance_m in ((SectorState.CLEAR, math.inf), (SectorState.OBSTACLE, 8.0)):

        def reached(*_: object, state: int = state, distance_m: float = distance_m) -> SectorScan:
            found = scan([], rig.avoid)
            return replace(
                found, state=np.full_like(found.state, state), distance_m=np.full_like(found.distance_m, distance_m)
            )

        monkeypatch.setattr(rigs, "scan", reached)
        counts = judge_rig(rig, Extractor())
        assert {sector for sector, _, _ in counts.wrong} == {70, 71, 0, 1, 2}
        assert min(at for _, at, _ in counts.wrong) == pytest.approx(5.0, abs=0.01)
        assert counts.clear + counts.obstacles == 72


def test_the_view_of_a_rig_is_placed_as_its_camera_is_mounted() -> None:
    """A wall around the vehicle: the planes that its cameras see stand at the wall."""
    s = SceneBuilder("room")
    for x, y, length, width in (
        (5.0, 0.0, 0.2, 10.0),
        (-5.0, 0.0, 0.2, 10.0),
        (0.0, 5.0, 10.0, 0.2),
        (0.0, -5.0, 10.0, 0.2),
    ):
        s.box("wall", x, y, length, width, 40.0, base=-20.0)
    rig = replace(random_rig(2, 5), scene=s.build(), place_m=np.zeros(3))
    c, s_ = math.cos(rig.heading_rad), math.sin(rig.heading_rad)
    planes = np.concatenate([view_of(rig, camera, Extractor()).model.planes for camera in rig.cameras])
    assert len(planes) > 0
    for k in (0, 2):
        north, east = c * planes[:, k] - s_ * planes[:, k + 1], s_ * planes[:, k] + c * planes[:, k + 1]
        # a plane may reach beyond a corner
        assert np.median(np.abs(np.maximum(np.abs(north), np.abs(east)) - 4.9)) < 0.05
