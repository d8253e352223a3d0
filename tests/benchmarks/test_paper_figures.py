"""The computation behind each figure of the paper, on cases with a known answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.markdown import table
from benchmarks.paper import (
    interval as paper_interval,
)
from benchmarks.paper import (
    openings as paper_openings,
)
from benchmarks.paper import (
    shapes as paper_shapes,
)
from benchmarks.paper import (
    storage as paper_storage,
)
from benchmarks.paper import (
    tilt as paper_tilt,
)
from benchmarks.paper import (
    time as paper_time,
)
from benchmarks.paper.cases import (
    CAMERA,
    EXACT,
    Figures,
    frames_of,
    measure,
    middle,
    number,
    percent,
    worst,
    zed_info,
)
from benchmarks.paper.interval import IntervalRow, skip_columns, thin_kept
from benchmarks.paper.openings import OpeningRow, opening_scene, sizes
from benchmarks.paper.shapes import in_ned, points_in_ned, shape_scene, views
from benchmarks.paper.tilt import TiltRow
from benchmarks.paper.time import TimeRow, interleaved
from core.params import Params
from drivers.simulation.source import Rendered

FRAME = Figures(
    scene="a",
    family="structured",
    condition="camera",
    seed=1,
    method="safe",
    planes=10,
    bytes=80,
    mean_m=0.1,
    missed=0.01,
    phantom=0.0,
    open_stopped=0.2,
)


def test_figures_of_tables() -> None:
    assert (middle([1.0, math.nan, 3.0]), worst([1.0, math.nan, 3.0])) == (2.0, 3.0)
    assert math.isnan(middle([]))
    assert math.isnan(worst([math.nan]))
    assert (number(1.256), number(math.nan), number(math.inf), percent(0.1234)) == ("1.26", "-", "∞", "12.3")
    assert table(["a", "b"], [["x", "1"]]) == "| a | b |\n|---|---:|\n| x | 1 |"
    assert table(["a"], []) == "| a |\n|---|"


def facade(opening: str, holes_closed: bool, condition: Any = EXACT) -> tuple[Rendered, np.ndarray]:
    """A frame before the opening and the planes of a perfect model of its facade, in level_cam."""
    frame = frames_of(
        opening_scene(opening, 6.0, 3), condition, 3, position_ned_m=(0.0, 0.0, -1.5), count=1, info=zed_info(0.0015)
    )[0]
    o = frame.scene.openings[0]
    along = (np.array(o.b_m) - o.a_m) / math.dist(o.a_m, o.b_m)
    far_left, far_right = np.array(o.a_m) - 5.0 * along, np.array(o.b_m) + 5.0 * along
    sides = [(far_left, o.a_m, -5.5, 0.0), (o.b_m, far_right, -5.5, 0.0), (o.a_m, o.b_m, -5.5, o.top_m)]
    sides.append((o.a_m, o.b_m, o.top_m if holes_closed else o.bottom_m, 1e-3 if o.bottom_m == 0.0 else 0.0))
    planes = np.array([[*a, *b, top + 1.5, bottom + 1.5] for a, b, top, bottom in sides])  # the camera is 1.5 m up
    return frame, planes


@pytest.mark.parametrize(("opening", "size"), [("window", (2.9, 2.1)), ("corridor", (5.8, 2.2))])
def test_a_perfect_model_gives_the_true_opening(opening: str, size: tuple[float, float]) -> None:
    frame, planes = facade(opening, holes_closed=False)
    found = sizes(frame, planes)[0]
    assert (found.width_m, found.height_m) == (pytest.approx(size[0], abs=0.02), pytest.approx(size[1], abs=0.02))
    assert found.free_share == pytest.approx(1.0)
    shut = sizes(*facade(opening, holes_closed=True))[0]
    assert shut.free_share == pytest.approx(0.0)


def test_the_ground_closes_a_passage_from_below() -> None:
    frame, planes = facade("corridor", holes_closed=False)
    assert sizes(frame, planes[:3])[0].height_m == pytest.approx(2.2, abs=0.02)  # nothing below the ground is free


def test_unknown_names_are_reported() -> None:
    with pytest.raises(ValueError, match="no opening 'door'"):
        opening_scene("door", 6.0, 0)
    with pytest.raises(ValueError, match="no shape 'cube'"):
        shape_scene("cube", 0)


def test_the_views_of_a_shape_agree_on_where_it_is() -> None:
    scene = shape_scene("cylinder", 5)
    radius = float(scene.rows[scene.label == 0][0][6])
    for frames in views(scene, EXACT, 5)[::3]:
        frame = frames[-1]
        points = points_in_ned(frame, frame.truth.obstacle(0.6) & (frame.truth.height_m < 3.3))
        off = np.hypot(points[:, 0] - 8.0, points[:, 1])
        assert np.abs(off - radius).max() < 1e-6
        # and so do planes: one through the camera's own centre line, 7 m ahead of it
        ahead = np.array([[7.0, -1.0, 7.0, 1.0, -1.0, 1.0]])
        mid = in_ned(ahead, frame)[0]
        centre = (mid[:2] + mid[2:4]) / 2.0
        assert np.hypot(*(centre - [8.0, 0.0])) == pytest.approx(1.0)
        assert mid[4:].tolist() == pytest.approx([-3.0, -1.0])


def test_skipped_columns_hold_nothing() -> None:
    frame = frames_of(shape_scene("sphere", 1), EXACT, 1, count=1)[0]
    thinned = skip_columns(frame, 4).depth_mm
    kept = np.arange(640) % 4 == 2
    assert (thinned[:, ~kept] == 0).all()
    assert (thinned[:, kept] == frame.depth_mm[:, kept]).all()
    assert (skip_columns(frame, 1).depth_mm == frame.depth_mm).all()


def test_an_invalid_frame_is_silent_not_blind() -> None:
    frame = frames_of(shape_scene("sphere", 1), EXACT, 1, count=1)[0]
    nothing = replace(frame, depth_mm=np.zeros_like(frame.depth_mm))
    found = measure([nothing], EXACT, "sphere", 1, Params())
    assert found.silent
    assert all(math.isnan(v) for v in (found.mean_m, found.missed, found.phantom, found.open_stopped))
    seen = measure([frame], EXACT, "sphere", 1, Params())
    assert not seen.silent
    assert seen.missed < 0.01


def interval(step: int, ke: float, error: float, columns: str = "pooled", **change: Any) -> IntervalRow:
    thin = change.pop("thin", math.nan)
    return IntervalRow(
        step=step, ke_per_m=ke, columns=columns, thin=thin, figures=replace(FRAME, mean_m=error, **change)
    )


def test_poles_are_averaged_and_kept_apart_from_the_errors() -> None:
    rows = [interval(1, 0.0, 0.1), interval(1, 0.0, 9.0, "skipped", scene="poles", family="thin", thin=0.5)]
    rows.append(interval(1, 0.0, 9.0, "skipped", scene="poles", family="thin", thin=1.0))
    assert thin_kept(rows, 1, "skipped") == 0.75
    assert math.isnan(thin_kept(rows, 1, "pooled"))
    assert [f.mean_m for f in paper_interval.of(rows, "safe", 1, 0.0)] == [0.1]
    assert paper_interval.noises(rows) == [0.0]


def test_runs_are_interleaved_after_warm_up() -> None:
    seen: list[str] = []

    def job(name: str) -> Callable[[], None]:
        return lambda: seen.append(name)

    times = interleaved([job("a"), job("b")], runs=3, warm_up=1)
    assert seen == ["a", "b", "a", "b", "a", "b", "a", "b"]
    assert [len(t) for t in times] == [3, 3]


def timed(method: str, step: int, kind: str) -> TimeRow:
    return TimeRow(
        kind=kind,
        method=method,
        step=step,
        size="640x480",
        cpu_ms=10.0 / step,
        cpu_sd_ms=1.0,
        cpu_p99_ms=12.0,
        wall_ms=11.0,
        runs=7,
    )


def test_tables_show_the_printed_figures_beside_ours() -> None:
    rows = [timed(m, s, k) for m in ("safe", "paper") for s in (1, 4) for k in ("structured", "foliage")]
    text = paper_time.tables(rows)
    assert "18.6 | 3.0" in text
    assert "226.1" in text
    assert "| 89 |" in text
    assert "| structured | ours (safe) | 640x480 | 10.0 | 1.0 | 12.0 | 11.0 |" in text
    assert "| 4 | 2.5 | 2.5 | 2.5 | 2.5 |" in text
    opening = OpeningRow(
        opening="window",
        condition="exact",
        method="safe",
        distance_m=6.0,
        seed=1,
        width_m=2.5,
        height_m=2.0,
        free_share=0.8,
    )
    shown = paper_openings.tables([opening, replace(opening, width_m=2.7)])
    assert "| window | printed | its drone | 2.7 | 2 | - |" in shown
    assert "2.50 / 2.60 / 2.70" in shown


@pytest.mark.slow
def test_every_figure_is_drawn(tmp_path: Path) -> None:
    times = [timed(m, s, k) for m in ("safe", "grid 0.1 m") for s in (1, 4) for k in ("structured", "foliage")]
    tilts = [
        TiltRow(axis=axis, angle_deg=a, figures=replace(FRAME, method=m, condition=CAMERA.name))
        for axis in ("roll", "pitch")
        for a in (-30.0, 0.0)
        for m in ("safe", "paper", "grid 0.1 m")
    ]
    opening = OpeningRow(
        opening="corridor",
        condition="exact",
        method="safe",
        distance_m=6.0,
        seed=1,
        width_m=2.5,
        height_m=2.0,
        free_share=0.8,
    )
    paper_time.draw(times, tmp_path / "time.png")
    paper_tilt.draw(tilts, tmp_path / "tilt.png")
    paper_storage.draw([FRAME], tmp_path / "storage.png", "planes", "planes", log=True)
    paper_interval.draw([interval(1, 0.0, 0.1), interval(4, 0.0, 0.2)], tmp_path / "interval.png")
    paper_openings.draw([opening], tmp_path / "openings.png")
    for name in ("time", "tilt", "storage", "interval", "openings"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert "| camera | roll +30° | ours (safe) | - |" in paper_tilt.tables(tilts)
    assert "| camera | level | ours (safe) | 0.100 |" in paper_tilt.tables(tilts)


def test_the_table_of_shapes_gives_medians_and_worst() -> None:
    row = paper_shapes.ShapeRow(
        shape="sphere", method="safe", seed=1, planes=2, mean_m=0.1, p95_m=0.2, missed=0.0, open_stopped=0.02,
        grid_planes=10, grid_error_m=0.3, around_planes=16, around_error_m=0.05,
    )  # fmt: skip
    text = paper_shapes.tables([row, replace(row, mean_m=0.3, missed=0.01), replace(row, mean_m=0.2)])
    assert "| sphere | ours (safe) | 2 | 10 | 0.200 | 0.300 | 0.300 | 1.00 | 2.0 | 16 | 0.050 |" in text
