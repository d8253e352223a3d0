"""The one command: what it is asked for, and that its table and its JSON say the same."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.fidelity import FAMILIES, cases, family_of, frames_of, main, parse
from benchmarks.rows import Case
from drivers.scene_library import SCENES


def test_every_scene_of_the_library_but_the_flight_has_a_family() -> None:
    assert sorted(n for names in FAMILIES.values() for n in names) == sorted(n for n in SCENES if n != "demo")
    assert family_of("trees") == "unstructured"


def test_the_command_line_makes_its_cases() -> None:
    args = parse(["--scenes", "unstructured,wall", "--tilts", "0:0,30:-10", "--ke", "0.0015,0.005", "--told", "0.003"])
    made = list(cases(args))
    assert len(made) == 4 * 2 * 2
    assert {c.told_per_m for c in made} == {0.003}
    assert {(c.roll_deg, c.pitch_deg) for c in made} == {(0.0, 0.0), (30.0, -10.0)}
    assert {c.told_per_m == c.ke_per_m for c in cases(parse(["--quick"]))} == {True}


@pytest.mark.parametrize("wrong", [["--scenes", "nowhere"], ["--tilts", "30"], ["--ke", "much"]])
def test_wrong_use_ends_with_status_two(wrong: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        parse(wrong)
    assert stop.value.code == 2
    assert wrong[0] in capsys.readouterr().err


def test_frames_of_a_case_differ_in_noise_only_and_stay_below_the_ceiling() -> None:
    case = Case(
        scene="tunnel", roll_deg=5, pitch_deg=0, ke_per_m=0.005, told_per_m=0.002, height_m=9.0, seed=1, width=160
    )
    first, second = frames_of(case, 2)
    assert (first.depth_mm != second.depth_mm).mean() > 0.3
    assert (first.truth.depth_m == second.truth.depth_m).all()
    assert first.position_ned_m[2] == -2.2
    assert first.info.ke_per_m == 0.002


def test_table_and_json_of_a_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.json"
    args = ["--scenes", "window,poles", "--tilts", "0:0", "--ke", "0.0015", "--width", "160", "--no-faults"]
    assert main([*args, "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    rows = json.loads(out.read_text())
    assert [row["case"]["scene"] for row in rows] == ["window", "poles"]
    for row in rows:
        assert row["valid"]
        assert row["score"]["obstacle_rays"] > 100
        assert f"{row['score']['mean_m']:.3f}" in printed
        assert [g["cell_m"] for g in row["grids"]] == [0.1, 0.2, 0.4, 0.8]
    assert len(rows[0]["openings"]) == 2
    assert "2.90 x 2.10 ->" in printed
    assert rows[1]["recall"][0]["name"].startswith("pole at 4")
    assert "poles, mean of 1 cases: pole at 4 m" in printed
    assert "worst of structured" in printed
    assert "worst of thin" in printed


def test_a_frame_that_says_nothing_is_counted_and_not_scored(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenes", "open,stones", "--tilts", "0:30", "--ke", "0.0015", "--width", "160", "--no-grids"]) == 0
    printed = capsys.readouterr().out
    assert "INVALID" in printed
    assert "worst of ground, ke 0.0015 (0 cases)" in printed
    assert "1 more gave no valid model: open +0/+30" in printed
