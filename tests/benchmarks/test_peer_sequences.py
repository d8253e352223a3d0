"""The comparison of methods that merge frames: their input, the judge, one run and the page, without other libraries."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.peers import section as peers_section
from benchmarks.peers.sequences import mapper
from benchmarks.peers.sequences import section as sequences_section
from benchmarks.peers.sequences.frame_input import POSES, FrameInput, frame_input, sorted_depth_m
from benchmarks.peers.sequences.judge import Figures, Subject, figures, newest_view, views_aside
from benchmarks.peers.sequences.mapper import MapModel, cube_model, plane_model
from benchmarks.peers.sequences.ours import FRAME, TRACKS, WORLD
from benchmarks.peers.sequences.plots import draw
from benchmarks.peers.sequences.run import OURS, Case, makers, run_case
from benchmarks.peers.sequences.tables import groups, pooled, sentences, summary_table
from benchmarks.tracking.sequences import Exposure, Pose, exposures, hovering
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import PERFECT

KE = 1e-4
"""Hardly any noise."""
WALL_X = 8.07
"""No multiple of any cell size."""
WALL = np.array([[WALL_X, -3.0, WALL_X, 3.0, -4.0, 0.0]])
"""In ned, as a model has it."""
SUBJECT = Subject(method="any", unit="planes", scene="wall", ke_per_m=KE, pose="true pose", cpu_ms=1.0)


def away(e: Exposure) -> tuple[float, tuple[float, float, float]]:
    """A pose that is off by 1.3 m and 0.2 rad."""
    x, y, z = e.position_m.tolist()
    return e.heading_rad + 0.2, (x + 1.2, y - 0.5, z)


def wall_frames(count: int = 1, ke_per_m: float = KE) -> list[Exposure]:
    """A wall 6 m wide and 4 m high 8.07 m north of a still camera, 2 m above the ground, without image faults."""
    b = SceneBuilder("test")
    b.ground()
    b.wall("wall", (WALL_X, -3.0), (WALL_X, 3.0), 4.0, thickness=0.01)
    return list(exposures(hovering(b.build()), count, ke_per_m, width=160, sensor=PERFECT))


def given(e: Exposure, pose: Pose = POSES["true pose"]) -> FrameInput:
    return frame_input(e, sorted_depth_m(e.rendered, e.info.ke_per_m), pose)


def judged(model: MapModel, frame: FrameInput, flown: Sequence[Exposure] = ()) -> Figures:
    e = frame.exposure
    ke = e.info.ke_per_m
    aside = views_aside(e, ke, [f.rendered for f in flown])
    return figures(SUBJECT, model, frame, newest_view(e, ke), aside)


def displaced(planes: NDArray[np.float64], frame: FrameInput) -> NDArray[np.float64]:
    """Planes of the true ned in the reported ned of a frame."""
    e, out = frame.exposure, planes.copy()
    turn = frame.heading_rad - e.heading_rad
    c, s = math.cos(turn), math.sin(turn)
    for i in (0, 2):
        off = planes[:, i : i + 2] - e.position_m[:2]
        out[:, i : i + 2] = off @ np.array([[c, s], [-s, c]]) + frame.position_m[:2]
    return out


def test_points_are_where_the_reported_pose_puts_them_and_heights_are_true() -> None:
    e = wall_frames()[0]
    true, off = given(e), given(e, away)
    points = true.points_m()
    high = true.above_ground_m(points) > 0.3
    np.testing.assert_allclose(points[high, 0], WALL_X, atol=0.06)
    assert 1000 < high.sum() < len(points)  # the ground is among the points
    np.testing.assert_allclose(true.above_ground_m(np.array([[5.0, 1.0, -0.7]])), [0.7])
    np.testing.assert_allclose(off.above_ground_m(off.points_m()), true.above_ground_m(points), atol=1e-9)
    moved = displaced(np.column_stack([points[:, :2], points[:, :2], points[:, 2:], points[:, 2:]]), off)
    np.testing.assert_allclose(off.points_m()[:, :2], moved[:, :2], atol=1e-9)


def test_an_exact_map_misses_nothing_and_an_empty_one_all() -> None:
    e = wall_frames()[0]
    found = judged(plane_model(WALL, 24), given(e))
    assert found.obstacle_rays > 2000
    assert (found.missed, found.phantom, found.open_stopped) == (0, 0, 0)
    assert found.error_m < 0.02
    empty = judged(plane_model(np.zeros((0, 6)), 0), given(e))
    assert empty.missed == empty.obstacle_rays == found.obstacle_rays
    assert math.isnan(empty.error_m)


def test_a_plane_where_nothing_is_counts_as_phantom_and_gives_the_bias() -> None:
    e = wall_frames()[0]
    near = WALL - np.array([3.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    found = judged(plane_model(near, 24), given(e))
    assert found.phantom > 0.9 * found.obstacle_rays
    assert found.missed == 0
    assert found.open_stopped > 0
    assert found.bias_m == pytest.approx(-3.0, abs=0.4)


def test_an_error_of_the_pose_that_all_frames_share_costs_nothing() -> None:
    e = wall_frames()[0]
    off = given(e, away)
    true, shifted = judged(plane_model(WALL, 24), given(e)), judged(plane_model(displaced(WALL, off), 24), off)
    for name in ("missed", "phantom", "open_stopped", "aside_missed"):
        assert getattr(shifted, name) == getattr(true, name)
    assert shifted.error_m == pytest.approx(true.error_m, abs=1e-6)
    assert judged(plane_model(WALL, 24), off).missed > 0  # the same planes in the wrong place


def test_missed_aside_counts_only_what_two_frames_had_in_view() -> None:
    frames = wall_frames(2)
    empty = plane_model(np.zeros((0, 6)), 0)
    seen = judged(empty, given(frames[-1]), frames)
    assert seen.aside_rays == seen.aside_missed > 100
    assert judged(plane_model(WALL, 24), given(frames[-1]), frames).aside_missed == 0
    assert judged(empty, given(frames[-1]), frames[:1]).aside_rays == 0


def test_cubes_stop_rays_at_their_near_face_and_those_of_the_ground_are_taken_out() -> None:
    frame = given(wall_frames()[0])
    cubes = np.array([[40, 0, -10], [20, 0, -2], [20, 0, -1]])  # 0.2 m: at 8 m; two of less than 0.54 m at 4 m
    model = cube_model(cubes, 0.2, frame, 7)
    assert (model.primitives, model.bytes) == (1, 7)
    depth = model.stops(frame.position_m, frame.exposure.info.intrinsics, frame.R_ned_optical)
    assert np.isfinite(depth).sum() < 20
    assert depth[np.isfinite(depth)].min() == pytest.approx(8.0)
    inside = model.stops(np.array([8.1, 0.1, -1.9]), frame.exposure.info.intrinsics, frame.R_ned_optical)
    assert not inside.any()


def test_one_flight_gives_a_row_for_each_pose_method_and_number_of_frames() -> None:
    case = Case(scene="alley", ke_per_m=0.0015, seed=1, judged=(2, 4), width=160)
    rows = run_case(case, OURS)
    assert [(r.frames, r.pose, r.method) for r in rows] == [
        (n, pose, method) for n in (2, 4) for pose in POSES for method in (FRAME, TRACKS, WORLD)
    ]
    assert len({r.obstacle_rays for r in rows if r.frames == 4}) == 1
    assert all(r.cpu_ms > 0.0 and r.bytes > 100 and r.primitives > 0 for r in rows)
    assert all(r.missed < 0.05 * r.obstacle_rays for r in rows)
    alone = [r for r in rows if r.method == FRAME and r.frames == 4]
    assert alone[0].missed == alone[1].missed  # a frame alone is placed by its own pose


def row(**changes: Any) -> Figures:
    """A row with round figures."""
    base = Figures(
        method=FRAME,
        unit="planes",
        scene="street",
        ke_per_m=KE,
        pose="true pose",
        frames=10,
        primitives=10,
        bytes=1000,
        missed=10,
        phantom=30,
        open_stopped=20,
        obstacle_rays=1000,
        open_rays=2000,
        aside_missed=50,
        aside_rays=500,
        error_m=0.1,
        error_p95_m=0.5,
        bias_m=-0.1,
        cpu_ms=5.0,
    )
    return dataclasses.replace(base, **changes)


def rows_of_a_page() -> list[Figures]:
    return [
        row(ke_per_m=ke, pose=pose, method=method, frames=frames, scene=scene)
        for ke in sequences_section.KES
        for pose in POSES
        for method in (FRAME, TRACKS)
        for frames in (10, 50)
        for scene in ("street", "trees")
    ]


def test_scenes_are_pooled_by_rays_with_the_worst_one_and_medians() -> None:
    p = pooled([row(), row(scene="trees", missed=0, obstacle_rays=3000, open_rays=0, error_m=math.nan, primitives=30)])
    assert p.missed == pytest.approx((10 / 4000, 10 / 1000))
    assert p.open_stopped == pytest.approx((20 / 2000, 20 / 2000))
    assert p.phantom == pytest.approx((60 / 6000, 30 / 3000))
    assert (p.primitives, p.error_m) == (20, 0.1)
    assert math.isnan(pooled([row(aside_rays=0, aside_missed=0)]).aside_missed[0])


def test_tables_have_a_line_for_each_method_and_say_where_there_is_no_figure() -> None:
    rows = [row(), row(method=TRACKS, frames=50, aside_rays=0), row(pose="drift 5 %", missed=500), row(ke_per_m=0.005)]
    lines = summary_table(rows, KE, "true pose").splitlines()
    assert len(lines) == 4
    assert lines[2].startswith(
        f"| {FRAME} | 10 | 10 planes | 1,000 | 1.00 (1.0) | 1.00 (1.0) | 1.00 (1.0) | 10.00 (10.0)"
    )
    assert "nan" not in lines[3]
    assert len(groups(rows)) == 4


def test_sentences_name_the_others_that_are_no_worse_and_those_that_are_nearer() -> None:
    rows = [row(), row(method="A", missed=9, error_m=0.2), row(method="B", missed=11, error_m=0.05)]
    assert sentences(rows, 10, (FRAME, TRACKS)) == [
        f"ke {KE:g}, true pose, {FRAME}: miss no more, and stop no more rays where nothing is and over the open: A; "
        "smaller median error along the ray: B."
    ]
    assert "open: none" in sentences([row(), row(method="A", phantom=31)], 10, (FRAME,))[0]
    assert sentences(rows, 50, (FRAME,)) == []


def test_the_page_has_all_tables_and_names_what_was_not_run() -> None:
    text = sequences_section.text(sequences_section.BRIEF, rows_of_a_page(), [("wavemap", "not installed")])
    assert text.startswith(f"{sequences_section.HEADING}\n")
    assert text.count("\n### ") == 5
    assert "**wavemap was not run**: not installed." in text
    assert "street, trees, tunnel, movers" in text
    assert not any(line.startswith("# ") for line in text.splitlines())


def test_plans_hold_what_was_promised_of_them() -> None:
    for plan in (sequences_section.FULL, sequences_section.BRIEF):
        assert {"street", "trees", "tunnel", "movers"} <= set(plan.scenes)
        assert (plan.judged, plan.kes) == ((10, 50), (0.0015, 0.005))
        assert {c.seed for c in sequences_section.cases(plan)} == {100}


def test_missing_libraries_are_reported_and_ours_remain(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(mapper.importlib, "import_module", absent)
    found, missing = makers()
    assert [make().name for make in found] == [FRAME, TRACKS, WORLD]
    assert [name for name, _ in missing] == ["OctoMap", "Open3D TSDF", "wavemap"]
    assert all("not installed" in why for _, why in missing)


def test_one_part_of_the_page_is_replaced_and_the_other_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "peers.md").write_text(
        f"# Beside others\n\nframes of old\n\n{sequences_section.HEADING}\n\nold flights\n"
    )
    monkeypatch.setattr(peers_section, "sequences", lambda out, plan: f"{sequences_section.HEADING}\n\nnew flights")
    assert peers_section.main(["--brief", "--only", "sequences", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "peers.md").read_text()
    assert text.startswith("# Beside others\n\nframes of old\n\n## Sequences")
    assert "python -m benchmarks.peers.section --brief --only sequences" in text
    assert "new flights" in text
    assert "old flights" not in text
    monkeypatch.setattr(peers_section, "compared", lambda out, effort: "new frames")
    assert peers_section.main(["--brief", "--only", "frames", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "peers.md").read_text()
    assert "frames of old" not in text
    assert text.index("new frames") < text.index("new flights")


@pytest.mark.slow
def test_the_picture_is_drawn(tmp_path: Path) -> None:
    draw(tmp_path / "a.png", rows_of_a_page())
    picture = cv2.imread(str(tmp_path / "a.png"))
    assert picture is not None
    assert picture.shape[0] > 300
    assert picture.std() > 10.0
