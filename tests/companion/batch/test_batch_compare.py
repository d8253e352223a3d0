"""`companion batch --compare`: what a new version or configuration changed over a fleet."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.batch import comparison_pictures
from companion.batch.comparison import Dataset, FlightDifference, compare_flight, difference_kind, unmatched
from companion.batch.conditions import find_hits
from companion.batch.flights import find_flights
from companion.batch.jobs import BatchOptions, FlightTask, Outcome
from companion.batch.task import run_task
from companion.cli import main
from companion.config.loader import Config
from companion.log.provenance import software
from core.params import Params

from ..fleet import write_fleet

pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")

COARSE = BatchOptions(config=Config(extractor=Params(min_support_px=100)), planes=True)


@pytest.fixture(scope="module")
def datasets(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A fleet with the recorded configuration, and with one that needs many pixels for a strip."""
    fleet = write_fleet(tmp_path_factory.mktemp("fleet"))
    outputs = tmp_path_factory.mktemp("a"), tmp_path_factory.mktemp("b")
    for output, options in zip(outputs, (BatchOptions(planes=True), COARSE), strict=True):
        for flight in find_flights([str(fleet)]):
            assert isinstance(run_task(FlightTask(flight, str(output), options, software())), Outcome)
    return outputs


@pytest.fixture(scope="module")
def compared(datasets: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of their comparison, beside a picture of the user."""
    folder = tmp_path_factory.mktemp("compared")
    (folder / "01_holiday.png").write_bytes(b"a picture of the user")
    assert main(["batch", "--compare", *map(str, datasets), "-o", str(folder)]) == 0
    return folder


def row(digest: str, nearest_m: float | None = 5.0, valid: bool = True) -> dict[str, Any]:
    return {"digest": digest, "nearest_m": nearest_m, "valid": valid}


@pytest.mark.parametrize(
    ("a", "b", "kind"),
    [
        (row("1"), row("1"), ""),
        (row("1"), row("2"), "changed"),
        (row("1", 5.0), row("2", 5.4), "changed"),
        (row("1", 5.0), row("2", 5.6), "missed"),
        (row("1", 20.0), row("2", 21.0), "changed"),
        (row("1", 5.0), row("2", None), "missed"),
        (row("1", 5.6), row("2", 5.0), "phantom"),
        (row("1", None), row("2", 3.0), "phantom"),
        (row("1", None), row("2", None), "changed"),
        (row("1", 5.0), row("2", None, valid=False), "newly_blind"),
        (row("1", None, valid=False), row("2", 5.0), "newly_valid"),
    ],
)
def test_the_kind_of_a_difference(a: dict[str, Any], b: dict[str, Any], kind: str) -> None:
    assert difference_kind(a, b) == kind


def test_a_plane_has_a_counterpart_near_its_middle_and_height() -> None:
    plane = np.array([[4.0, -1.0, 4.0, 1.0, -1.0, 1.0]])
    assert unmatched(plane, plane) == 0
    assert unmatched(plane, plane + np.array([0.4, 0, 0.4, 0, 0, 0])) == 0
    assert unmatched(plane, plane + np.array([0.6, 0, 0.6, 0, 0, 0])) == 1
    assert unmatched(plane, plane + np.array([0, 0, 0, 0, 2.0, 2.0])) == 1
    assert unmatched(plane, np.zeros((0, 6))) == 1
    assert unmatched(np.zeros((0, 6)), plane) == 0


def test_a_lost_obstacle_ranks_before_a_new_one() -> None:
    lost = FlightDifference("v", "lost", frames=100, missed=3, changed=3)
    new = FlightDifference("v", "new", frames=100, phantom=20, changed=20)
    assert lost.score < new.score < FlightDifference("v", "more", frames=100, missed=5, changed=5).score


def test_equal_datasets_have_no_difference(
    datasets: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = str(datasets[0])
    assert main(["batch", "--compare", a, a, "-o", str(tmp_path), "--no-pictures"]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["flights"], report["flights_changed"], report["look_at"]) == (3, 0, [])
    assert report["total"]["missed_planes"] == 0
    assert not (tmp_path / "look.parquet").exists()
    assert "look.parquet" not in capsys.readouterr().out


def test_without_matplotlib_nothing_is_compared(
    datasets: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The comparison of a fleet takes minutes, and failed at its first picture."""
    monkeypatch.setitem(sys.modules, "matplotlib.backends.backend_agg", None)
    assert main(["batch", "--compare", *map(str, datasets), "-o", str(tmp_path / "out")]) == 1
    assert "matplotlib>=3.8', or give --no-pictures" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_another_configuration_is_compared_frame_by_frame(datasets: tuple[Path, Path], compared: Path) -> None:
    report = json.loads((compared / "report.json").read_text())
    total = report["total"]
    assert total["changed"] > 0
    assert total["planes_per_frame_b"] < total["planes_per_frame_a"]
    assert total["missed_planes"] > total["phantom_planes"]
    assert total["blind_s_a"] == total["blind_s_b"] == pytest.approx(0.3)
    scores = [flight["score"] for flight in report["look_at"]]
    assert scores == sorted(scores, reverse=True)
    assert len(list(compared.glob("0[0-9]_*.png"))) == len(scores) + 1 == 4
    assert (compared / "overview.png").exists()
    changed = sum(f["kind"] != "changed" for f in _look(compared))
    assert changed == sum(total[k] for k in ("missed", "phantom", "newly_blind", "newly_valid")) > 0
    assert len(find_hits(str(datasets[1]), str(compared / "look.parquet"))) == changed


def test_the_report_names_the_command_that_cuts_out_what_changed(
    datasets: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = map(str, datasets)
    assert main(["batch", "--compare", a, b, "-o", str(tmp_path), "--no-pictures"]) == 0
    assert f"next: companion find {b} {tmp_path / 'look.parquet'} -o CLIPS" in capsys.readouterr().out


def _look(folder: Path) -> list[dict[str, Any]]:
    parquet = pytest.importorskip("pyarrow.parquet")
    rows: list[dict[str, Any]] = parquet.read_table(folder / "look.parquet").to_pylist()
    return rows


def test_the_reverse_comparison_exchanges_missed_and_phantom(datasets: tuple[Path, Path]) -> None:
    a, b = (Dataset(str(path)) for path in datasets)
    for name in sorted(a.names):
        there, back = compare_flight(a, b, name), compare_flight(b, a, name)
        assert (there.missed, there.phantom) == (back.phantom, back.missed)
        assert (there.missed_planes, there.phantom_planes) == (back.phantom_planes, back.missed_planes)


def test_each_picture_names_both_datasets(
    datasets: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They named A and B only. The end of a long path is shown."""
    titles = []
    monkeypatch.setattr(comparison_pictures, "save_figure", lambda figure, path: titles.append(figure.get_suptitle()))
    a, long = map(str, (datasets[0], tmp_path / ("x" * 150) / "new$results$"))
    shutil.copytree(datasets[1], long)
    assert main(["batch", "--compare", a, long, "-o", str(tmp_path / "report")]) == 0
    assert len(titles) == 4
    for title in titles:
        assert title.endswith(f"A: {a}\nB: ...{long[-120:]}")


def test_a_report_replaces_the_pictures_of_an_earlier_report_only(
    datasets: tuple[Path, Path], compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each file like 01_*.png in the folder was deleted."""
    folder = shutil.copytree(compared, tmp_path / "copy")
    a = str(datasets[0])
    assert main(["batch", "--compare", a, a, "-o", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((folder / "report.json").read_text())
    assert sorted(path.name for path in folder.iterdir()) == [
        "01_holiday.png",
        "flights.parquet",
        "overview.png",
        "report.json",
    ]


def test_wrong_uses_are_explained(
    datasets: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = str(datasets[0])
    assert main(["batch", "--compare", a, str(tmp_path / "none"), "-o", str(tmp_path)]) == 1
    assert "there is no such table; give the output folder of `companion batch`" in capsys.readouterr().err
    assert main(["batch", "logs", "--compare", a, a, "-o", str(tmp_path)]) == 2
    assert "leave out logs" in capsys.readouterr().err
