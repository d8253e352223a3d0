"""The comparison of a recorded stereo pair with measured disparities."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.open_air.recorded_pair import WIDTH, load
from benchmarks.open_air.recorded_truth import inside_cells, load_truth, main, match_lines
from core.types import CameraInfo
from tests.core.views import VIEW, extract, flat_wall, level

SHIFT_PX = 12
HEIGHT = 200


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A random texture at one disparity."""
    texture = np.random.Generator(np.random.PCG64(5)).integers(0, 256, (HEIGHT, WIDTH + SHIFT_PX)).astype(np.uint8)
    texture = np.asarray(cv2.GaussianBlur(texture, (5, 5), 1.2), np.uint8)
    left, right = tmp_path / "left.png", tmp_path / "right.png"
    cv2.imwrite(str(left), texture[:, :WIDTH])
    cv2.imwrite(str(right), texture[:, SHIFT_PX:])
    return left, right


def truth(folder: Path, disparity_px: float, height: int = HEIGHT) -> Path:
    path = folder / "truth.png"
    image = np.zeros((height, WIDTH), np.uint16)
    image[10:-10:7, 150:-150:11] = round(256 * disparity_px)
    cv2.imwrite(str(path), image)
    return path


def test_matches_are_compared_in_the_size_of_the_reduced_images(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    for path in pair:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(path), cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST))
    points = load_truth(truth(tmp_path, SHIFT_PX), load(*pair, 700.0, 0.1))
    assert points.disparity_px == pytest.approx(np.full(len(points.u), SHIFT_PX))
    assert points.u.min() == 150.0
    assert points.v.min() == 10.0
    rows, columns = points.pixels((HEIGHT, WIDTH))
    assert rows.max() < HEIGHT
    assert columns.max() < WIDTH


@pytest.mark.parametrize(("disparity_px", "median"), [(SHIFT_PX, "+0.00"), (SHIFT_PX + 0.5, "-0.50")])
def test_an_offset_of_the_calibration_is_the_median(
    tmp_path: Path, pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str], disparity_px: float, median: str
) -> None:
    arguments = [*map(str, pair), str(truth(tmp_path, disparity_px)), "--f-px", "350", "--baseline-m", "0.12"]
    assert main([*arguments, "--centre-px", "335.5", "99.5", "--bias-px", "0"]) == 0
    rows = [line.split("|") for line in capsys.readouterr().out.splitlines()]
    everything = next(row for row in rows if "1 to 96" in row[1])
    assert everything[4].strip() == median
    assert float(everything[3]) > 90.0
    assert any("no ground was found" in row[2] for row in rows if len(row) > 3)


def test_outliers_count_on_the_side_on_which_they_are() -> None:
    error_px = np.array([0.0, 0.1, -0.1, 2.5, 3.0, -4.0, 99.0])
    matched = np.array([True] * 6 + [False])
    lines = list(match_lines(error_px, matched, np.full(7, 10.0)))
    everything = lines[2].split("|")
    assert [everything[2].strip(), everything[3].strip()] == ["7", "85.7"]
    assert [everything[6].strip(), everything[7].strip()] == ["33.33", "16.67"]


def test_points_in_free_cells_are_counted_away_from_their_ends() -> None:
    model = extract(flat_wall(VIEW, 8.0), VIEW, level())
    assert isinstance(VIEW, CameraInfo)
    end_m = float(model.free.free_to_m[model.free.free_to_m > 0.0].min())
    points = np.array([[x, 0.1, 0.1] for x in (4.0, end_m - 0.1, 9.0)])
    assert inside_cells(model, points, np.full(3, 0.3)) == (1, 0)
    assert inside_cells(model, points, np.zeros(3)) == (2, 0)


@pytest.mark.parametrize(("name", "fault"), [("none.png", "not a 16-bit"), ("truth.png", "does not fit")])
def test_a_truth_that_does_not_fit_is_refused(
    tmp_path: Path, pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str], name: str, fault: str
) -> None:
    truth(tmp_path, SHIFT_PX, height=HEIGHT // 2)
    arguments = [*map(str, pair), str(tmp_path / name), "--f-px", "350", "--baseline-m", "0.12"]
    assert main([*arguments, "--centre-px", "335.5", "99.5"]) == 1
    assert fault in capsys.readouterr().err
