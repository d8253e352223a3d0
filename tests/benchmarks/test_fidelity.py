"""The command: the requested cases, and equal content of its table and its JSON."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from benchmarks.fidelity import matrix
from benchmarks.fidelity.case import FAULTS, frames_of
from benchmarks.fidelity.matrix import PARTS
from benchmarks.fidelity.result import Case
from benchmarks.fidelity.run import asked, main, parse
from benchmarks.scenes.catalogue import FAMILIES, HELD_OUT_SEEDS, SCENES


def case(scene: str, ke: float = 0.005, faults: str = "all") -> Case:
    return Case(scene=scene, ke_per_m=ke, configured_ke_per_m=0.002, seed=1, width=160, height_m=9.0, faults=faults)


def test_the_command_line_makes_its_cases() -> None:
    args = parse(
        ["--scenes", "unstructured,wall", "--tilts", "0:0,30:-10", "--ke", "0.0015,0.005", "--configured-ke", "0.003"]
    )
    made = asked(args)
    assert len(made) == (len(FAMILIES["unstructured"]) + 1) * 2 * 2
    assert {c.configured_ke_per_m for c in made} == {0.003}
    assert {(c.roll_deg, c.pitch_deg) for c in made} == {(0.0, 0.0), (30.0, -10.0)}
    assert {c.faults for c in made} == {"all"}
    assert {c.configured_ke_per_m == c.ke_per_m for c in asked(parse(["--quick"]))} == {True}
    assert {c.faults for c in asked(parse(["--quick", "--no-faults"]))} == {"none"}
    assert len(asked(parse(["--quick", "--faults", "none,holes"]))) == 2 * len(asked(parse(["--quick"])))


def test_tuning_seeds_unless_the_held_out_are_asked_for() -> None:
    assert {c.seed for c in asked(parse(["--quick", "--seeds", "3"]))} == {0, 1, 2}
    assert {c.seed for c in asked(parse(["--quick", "--seeds", "3", "--held-out"]))} == set(HELD_OUT_SEEDS[:3])
    assert {c.seed for c in asked(parse(["--part", "configured", "--held-out"]))} == set(
        HELD_OUT_SEEDS[:3]
    )  # three tilts
    assert {c.seed for c in asked(parse(["--quick", "--seed", "3,103"]))} == {3, 103}


def test_a_parameter_is_set_by_name() -> None:
    args = parse(["--set", "line_tolerance_m=0.2", "--set", "estimate_noise=false", "--set", "link_gap_px=3"])
    assert (args.params.line_tolerance_m, args.params.estimate_noise, args.params.link_gap_px) == (0.2, False, 3)


@pytest.mark.parametrize(
    "wrong",
    [
        ("--scenes", "nowhere", "no scene 'nowhere'"),
        ("--tilts", "30", "--tilts"),
        ("--ke", "much", "--ke"),
        ("--faults", "rain", "no faults 'rain'; there are none, dropout"),
        ("--part", "half", "no part 'half'; there are base"),
        ("--seeds", "101", "--seeds: expected 1..100"),
        ("--set", "colour=red", "colour=red: expected NAME=VALUE"),
        ("--set", "line_tolerance_m=99", "line_tolerance_m = 99.0: expected 0.02..1.0 m"),
    ],
)
def test_wrong_use_ends_with_status_two(wrong: tuple[str, str, str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        parse(list(wrong[:2]))
    assert stop.value.code == 2
    assert wrong[2] in capsys.readouterr().err


def test_the_parts_of_the_matrix_vary_what_they_name() -> None:
    made = {name: list(part.make([198, 199])) for name, part in PARTS.items()}
    assert {c.seed for cases in made.values() for c in cases} <= set(HELD_OUT_SEEDS)
    assert len({c.seed for c in made["base"] if c.scene == "trees"}) == 18
    assert {c.scene for c in made["base"]} == set(SCENES)
    assert len(made["base"]) == len(SCENES) * 9 * 2 * 2
    assert {c.ke_per_m for c in made["base"]} == {0.0015, 0.005}
    assert {c.ke_per_m for c in made["noise"]} == {0.008, 0.01}
    assert {c.faults for c in made["faults"]} == set(FAULTS)
    assert {c.height_m for c in made["heights"]} >= {0.7, 10.0}
    assert {round(c.configured_ke_per_m / c.ke_per_m, 2) for c in made["configured"]} == {0.33, 1.0, 3.0}
    for cases in made.values():
        assert len(set(cases)) == len(cases)


def test_frames_of_a_case_differ_in_noise_only_and_stay_below_the_ceiling() -> None:
    first, second = frames_of(case("tunnel"), 2)
    assert (first.depth_mm != second.depth_mm).mean() > 0.3
    assert first.truth is second.truth
    assert first.position_ned_m[2] == -2.2
    assert first.info.ke_per_m == 0.002


def test_faults_one_by_one() -> None:
    """Against the image with noise alone: dropout and holes only take away, mismatches and flying pixels change."""
    clean = frames_of(case("street", 1e-5, "none"), 1)[0]
    seen = (clean.truth.depth_m > 0.3) & (clean.truth.depth_m < 19.9)
    assert (clean.depth_mm[seen] > 0).all()
    lost, off, other = {}, {}, {}
    for name in FAULTS:
        frame = frames_of(case("street", 1e-5, name), 1)[0]
        held = seen & (frame.depth_mm > 0)
        other[name] = int((frame.depth_mm != clean.depth_mm).sum())
        lost[name] = 1.0 - held.sum() / seen.sum()
        off[name] = float(np.mean(np.abs(frame.depth_mm[held] / 1000.0 - frame.truth.depth_m[held]) > 0.05))
    assert lost["dropout"] == pytest.approx(0.05, abs=0.01)
    assert 0.0 < lost["holes"] < 0.1
    assert lost["none"] == 0.0
    assert lost["flying"] < 0.005  # between something and what lies beyond the range
    assert 30 <= other["mismatches"] <= 40  # 0.2 % in blocks of four, which may overlap
    assert off["flying"] > 0.001
    assert off["none"] == off["dropout"] == off["holes"] == 0.0
    assert lost["all"] > lost["dropout"]
    assert off["all"] > off["mismatches"]


@pytest.mark.slow
def test_table_and_json_of_a_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.json"
    args = [
        "--scenes",
        "window,poles",
        "--tilts",
        "0:0",
        "--ke",
        "0.0015",
        "--width",
        "160",
        "--no-faults",
        "--jobs",
        "1",
    ]
    assert main([*args, "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    rows = json.loads(out.read_text())
    assert [row["case"]["scene"] for row in rows] == ["window", "poles"]
    for row in rows:
        assert row["valid"]
        assert row["score"]["obstacle_rays"] > 100
        assert sum(row["by_range"]["obstacle"]) == row["score"]["obstacle_rays"]
        assert f"{row['score']['mean_m']:.3f}" in printed
        assert [g["cell_m"] for g in row["grids"]] == [0.1, 0.2, 0.4, 0.8]
    assert rows[0]["openings"][0]["true_width_m"] == pytest.approx(2.9)
    assert "2.90 x 2.10 ->" in printed
    assert rows[1]["recall"][0]["name"].startswith("pole at 4")
    assert "worst of structured" in printed
    assert "worst of thin" in printed


SMALL = ["--scenes", "wall,no_ground", "--tilts", "0:0,0:-10", "--ke", "0.005", "--width", "64", "--no-grids"]


class HandedOver:
    """A pool of one that works in this process, with all that goes to and fro packed as for another one."""

    made_with: ClassVar[list[int]] = []

    def __init__(self, count: int, start: Callable[..., None], settings: tuple[object, ...]) -> None:
        self.made_with.append(count)
        start(*pickle.loads(pickle.dumps(settings)))

    def __enter__(self) -> HandedOver:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def imap(self, work: Callable[[object], object], groups: list[object]) -> Iterator[object]:
        return (pickle.loads(pickle.dumps(work(pickle.loads(pickle.dumps(g))))) for g in groups)


def by_jobs(folder: Path) -> list[str]:
    texts = []
    for jobs in ("1", "2"):
        out = folder / f"{jobs}.json"
        assert main([*SMALL, "--jobs", jobs, "--json", str(out)]) == 0
        texts.append(out.read_text())
    return texts


def test_more_jobs_give_the_rows_of_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    HandedOver.made_with.clear()
    monkeypatch.setattr(matrix.multiprocessing, "get_context", lambda _: SimpleNamespace(Pool=HandedOver))
    monkeypatch.setattr(matrix.os, "environ", {})
    one, two = by_jobs(tmp_path)
    assert one == two
    assert HandedOver.made_with == [2]
    assert matrix.os.environ["NUMBA_NUM_THREADS"] == "1"
    assert "4/4" in capsys.readouterr().err


@pytest.mark.soak
def test_two_processes_give_the_rows_of_one(tmp_path: Path) -> None:
    """New interpreters compile everything where nothing is compiled yet: minutes."""
    one, two = by_jobs(tmp_path)
    assert one == two


def test_an_invalid_frame_is_counted_and_not_scored(capsys: pytest.CaptureFixture[str]) -> None:
    args = [
        "--scenes",
        "open,stones",
        "--tilts",
        "0:30",
        "--ke",
        "0.0015",
        "--width",
        "160",
        "--no-grids",
        "--jobs",
        "1",
    ]
    assert main(args) == 0
    printed = capsys.readouterr().out
    assert "INVALID" in printed
    assert "worst of ground, ke 0.0015 (0 cases)" in printed
    assert "1 more gave no valid model: open +0/+30" in printed
