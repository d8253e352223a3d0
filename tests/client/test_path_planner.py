"""The example of path planning: occupied space is never entered, unknown space by its policy, narrow gaps not at all."""

from __future__ import annotations

import runpy
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from core.types import Ground
from osape_client.query.space import Occupancy, PlacedModel, Space

from .test_queries import HERE, model, profile, sampled_distance

ROOT = Path(__file__).resolve().parents[2]
BOUNDS = [[-1.0, -8.0, -0.9], [14.0, 8.0, 0.9]]
GOAL = [11.0, 0.0, 0.0]


def wall_with_gap(width_m: float, at_m: float = 3.0) -> list[tuple[float, ...]]:
    """6 m ahead, as wide as the bounds, its gap aside."""
    return [
        (6.0, -9.0, 6.0, at_m - width_m / 2, -3.0, 3.0),
        (6.0, at_m + width_m / 2, 6.0, 9.0, -3.0, 3.0),
    ]


def room(pp: ModuleType, planes: list[tuple[float, ...]], unknown: str, far_m: float = 0.0):
    space = Space([PlacedModel(model(*planes, margin=0.1, free=profile(1.0, far_m)), HERE)])
    return pp.Room(space=space, radius_m=0.5, start=np.zeros(3), been_m=2.5, unknown=pp.Unknown(unknown))


OTHERS = [pytest.param(name, marks=pytest.mark.slow) for name in ("rrt", "prm")]


@pytest.mark.parametrize("planner", ["rrt-connect", *OTHERS])
def test_through_the_gap_that_is_wide_enough(pp: ModuleType, planner: str) -> None:
    planes = wall_with_gap(2.4)
    path = pp.plan(room(pp, planes, "allow"), GOAL, BOUNDS, planner=planner, tries=6)
    assert path[0] == pytest.approx([0.0, 0.0, 0.0])
    assert path[-1] == pytest.approx(GOAL)
    for a, b in pairwise(path):
        assert min(sampled_distance(np.array(p), a, b) for p in planes) > 0.6


@pytest.mark.parametrize("planner", ["rrt-connect", *OTHERS])
def test_not_through_the_gap_that_is_too_narrow(pp: ModuleType, planner: str) -> None:
    with pytest.raises(pp.NoPath, match="no path"):
        pp.plan(room(pp, wall_with_gap(1.1), "allow"), GOAL, BOUNDS, planner=planner, tries=2, questions=500)


def test_no_path_dives_under_a_wall_through_the_ground(pp: ModuleType) -> None:
    wall = model((6.0, -9.0, 6.0, 9.0, -3.0, 1.5), margin=0.1, free=profile(1.0, 14.0))
    ground = Ground(
        seen=True, height_m=1.8, tolerance_m=0.25, noise_per_m=0.01, seen_from_m=(0.5,) * 16, seen_to_m=(14.0,) * 16
    )
    bounds = [[0.0, -4.0, -0.9], [14.0, 4.0, 6.0]]
    for model_of_frame, error in ((replace(wall, ground=ground), "no path"), (wall, "")):
        space = Space([PlacedModel(model_of_frame, HERE)])
        mine = pp.Room(space=space, radius_m=0.3, start=np.zeros(3), been_m=2.5, unknown=pp.Unknown.ALLOW)
        if error:
            with pytest.raises(pp.NoPath, match=error):
                pp.plan(mine, [9.0, 0.0, 0.0], bounds, tries=2, questions=400)
            with pytest.raises(pp.NoPath, match=r"goal .* is occupied"):
                pp.plan(mine, [9.0, 0.0, 2.2], bounds)
        else:  # the wall alone does not stop it
            assert len(pp.plan(mine, [9.0, 0.0, 0.0], bounds, tries=3)) > 2


def test_unknown_is_avoided_or_has_its_price(pp: ModuleType) -> None:
    seen, unseen = room(pp, [], "avoid", far_m=8.0), [9.5, 0.0, 0.0]
    path = pp.plan(seen, [6.0, 2.0, 0.0], BOUNDS, tries=10)
    along = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(path)])
    along = along[np.linalg.norm(along, axis=1) > 2.5]
    assert (seen.space.points(along, 0.49) == Occupancy.FREE).all()
    with pytest.raises(pp.NoPath, match=r"goal \[9.5, 0.0, 0.0\] is unknown"):
        pp.plan(seen, unseen, BOUNDS)
    allowed = room(pp, [], "allow", far_m=8.0)
    assert pp.plan(allowed, unseen, BOUNDS, tries=10)[-1] == pytest.approx(unseen)
    # 0 to 7.5 m seen or come from (a ball of 0.5 m within 8 m), the rest at five times its length, in pieces of half a metre
    assert 7.0 + 2.0 * 5 <= allowed.price([0, 0, 0], unseen)[0] + 1e-9 <= 7.5 + 2.5 * 5 + 0.5


def test_an_obstacle_close_by_stays_one_where_the_vehicle_came_from(pp: ModuleType) -> None:
    close = room(pp, [(1.5, -1.0, 1.5, 1.0, -1.0, 1.0)], "avoid")
    assert close.price([0, 0, 0], [2.4, 0, 0])[0] == np.inf
    assert close.price([0, 0, 0], [-2.4, 0, 0])[0] == pytest.approx(2.4)
    assert close.price([0, 0, 0], [-2.6, 0, 0])[0] == np.inf


def test_blind_is_nowhere_to_fly(pp: ModuleType) -> None:
    blind = pp.Room(space=Space([]), radius_m=0.5, start=np.zeros(3))
    with pytest.raises(pp.NoPath, match=r"start .* is unknown"):
        pp.plan(blind, GOAL, BOUNDS)


@pytest.mark.slow  # the script's planner is tested above
def test_the_script_draws_a_path_through_the_window(pp: ModuleType, tmp_path: Path) -> None:
    picture = tmp_path / "path.png"
    command = [sys.executable, ROOT / "examples" / "plan_path.py", "--unknown", "allow", "--goal", "10", "0", "0"]
    run = subprocess.run([*command, "-o", picture], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    assert 10.0 <= float(run.stdout.split()[3]) < 14.0
    assert picture.stat().st_size > 10_000
    run = subprocess.run(
        [*command[:2], "--goal", "10", "6", "0"], capture_output=True, text=True, timeout=300, check=False
    )
    assert (run.returncode, "unknown" in run.stderr) == (1, True), run.stderr


REMEDIES = {"ompl": "pip install 'ompl>=2.0'", "matplotlib": "pip install 'matplotlib>=3.8'"}


@pytest.mark.parametrize(
    ("script", "library"),
    [
        ("plan_path.py", "ompl"),
        ("plan_world.py", "matplotlib"),
        ("plan_path.py", "matplotlib"),
        ("plan_world.py", "ompl"),
    ],
)
def test_a_missing_library_is_named_with_its_remedy(
    script: str, library: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if library != "ompl":
        pytest.importorskip("ompl", reason="the extra `planner` is not installed")
    for name in [name for name in sys.modules if name.split(".")[0] == library or name == "path_planner"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setattr(sys, "argv", [script])
    monkeypatch.syspath_prepend(ROOT / "examples")
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(ROOT / "examples" / script), run_name="__main__")
    assert end.value.code, "the status would be 0"
    printed = f"{end.value.code}\n{capsys.readouterr().err}"
    assert library in printed
    assert REMEDIES[library] in printed


@pytest.mark.parametrize("script", ["plan_path.py", "plan_world.py"])
def test_a_log_that_does_not_exist_is_named(
    pp: ModuleType, script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [script, str(tmp_path / "none.mcap")])
    monkeypatch.syspath_prepend(ROOT / "examples")
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(ROOT / "examples" / script), run_name="__main__")
    assert end.value.code == 1
    assert "none.mcap" in capsys.readouterr().err


@pytest.mark.parametrize("planner", ["rrt-connect", pytest.param("rrt", marks=pytest.mark.slow)])
def test_the_same_seed_gives_the_same_path_whatever_ran_before(pp: ModuleType, planner: str) -> None:
    mine = room(pp, wall_with_gap(2.4), "allow")
    first, other, again = (pp.plan(mine, GOAL, BOUNDS, planner=planner, tries=2, seed=seed) for seed in (3, 4, 3))
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)
