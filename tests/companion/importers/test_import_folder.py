"""Directories of depth PNGs: the resulting log, and the report of each possible fault."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from companion.cli import main
from companion.importers.png import millimetres, read_depth_png
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.base import BadData
from drivers.logs.reader import McapRecording

from ..recordings import HEADING, HEIGHT, WIDTH, depth_image, events_of, frames_of, row, tilt, write_folder


def imported(folder: Path, *arguments: str) -> tuple[int, Path]:
    out = folder.parent / "out.mcap"
    return main(["import", str(folder), "-o", str(out), *arguments]), out


def test_a_good_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out = imported(write_folder(tmp_path / "rec"))
    assert status == 0
    assert "20 frames over 1.9 s, 20 attitudes, 20 positions" in capsys.readouterr().out
    events = events_of(out)
    frames = [e for e in events if isinstance(e, DepthFrame)]
    attitudes = [e for e in events if isinstance(e, AttitudeSample)]
    poses = [e for e in events if isinstance(e, PoseSample)]
    assert [f.sequence for f in frames] == list(range(20))
    assert [f.t_exposure_ns for f in frames] == [i * 100_000_000 for i in range(20)]
    assert {f.t_arrival_ns - f.t_exposure_ns for f in frames} == {50_000_000}
    assert np.array_equal(frames[7].depth_mm, depth_image(7))
    roll, pitch = tilt(0.7)
    assert attitudes[7].t_ns == attitudes[7].t_arrival_ns == 700_000_000
    assert attitudes[7].q_ned_frd_wxyz == pytest.approx(quaternion_from_euler(roll, pitch, 0.1), abs=1e-6)
    assert poses[7].position_ned_m == (0.7, 0.0, -1.5)
    arrivals = [e.t_arrival_ns for e in events]
    assert arrivals == sorted(arrivals)


def test_a_table_of_the_user_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The list of files took its place, without a word."""
    folder = write_folder(tmp_path / "rec")
    listed = tmp_path / "out.files.csv"
    listed.write_text("flight,pilot\n1,A. B.\n")
    status, out = imported(folder)
    assert status == 1
    assert f"{listed}: exists and is no list of `companion import`" in capsys.readouterr().err
    assert listed.read_text() == "flight,pilot\n1,A. B.\n"
    assert not out.exists()
    listed.unlink()
    assert imported(folder)[0] == 0
    out.unlink()
    assert imported(folder)[0] == 0  # an own list without its log is replaced
    assert listed.read_text().startswith("sequence,file\n0,depth/000000.png\n")


def test_the_same_folder_gives_the_same_bytes(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "rec")
    first = imported(folder)[1].read_bytes()
    assert imported(folder)[1].read_bytes() == first


def test_options_reach_the_log(tmp_path: Path) -> None:
    config = tmp_path / "c.toml"
    config.write_text('[[camera]]\nname = "nose"\npitch_deg = -10\nmax_range_m = 9\n')
    arguments = [
        "--mount",
        "0,-20,5",
        "--lever-arm",
        "0.1,0,-0.05",
        "--ke",
        "0.002",
        "--min-range-m",
        "0.5",
        "--frame-latency-ms",
        "80",
    ]
    status, out = imported(write_folder(tmp_path / "rec", 3), "-c", str(config), *arguments)
    assert status == 0
    with McapRecording(out) as recording:
        (info,) = recording.cameras
    assert info.camera == "nose"
    assert (info.mount.pitch_rad, info.mount.yaw_rad) == pytest.approx((math.radians(-20), math.radians(5)))
    assert (info.mount.x_m, info.mount.z_m) == (0.1, -0.05)
    assert (info.min_range_m, info.max_range_m, info.ke_per_m) == (0.5, 9.0, 0.002)
    assert frames_of(out)[0].t_arrival_ns == 80_000_000


def test_json_is_one_object(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 4)
    (folder / "depth" / "000002.png").unlink()
    status, out = imported(folder, "--json")
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert status == 1
    assert (summary["frames"], summary["frames_named"], summary["output"]) == (3, 4, str(out))
    assert "000002.png" in summary["problems"][0]
    assert "3 of 4 frames kept" in captured.err


def spoilt(folder: Path, what: str) -> None:
    png = folder / "depth" / "000005.png"
    whole = png.read_bytes()
    images = {
        "8 bit": np.zeros((HEIGHT, WIDTH), np.uint8),
        "RGB": np.zeros((HEIGHT, WIDTH, 3), np.uint16),
        "other size": np.zeros((HEIGHT, WIDTH + 2), np.uint16),
    }
    if what in images:
        assert cv2.imwrite(str(png), images[what])
    elif what == "missing":
        png.unlink()
    elif what == "cut":
        png.write_bytes(whole[: len(whole) // 2])
    elif what == "flipped":
        png.write_bytes(whole[:200] + bytes([whole[200] ^ 1]) + whole[201:])
    else:
        png.write_bytes(b"hello")


@pytest.mark.parametrize(
    ("what", "cause"),
    [
        ("8 bit", "8-bit grey, expected 16-bit grey"),
        ("RGB", "16-bit RGB, expected 16-bit grey"),
        ("other size", "66x48 pixels, but intrinsics.json is for 64x48"),
        ("missing", "cannot be read"),
        ("cut", "incomplete"),
        ("flipped", "wrong checksum"),
        ("no png", "not a PNG"),
    ],
)
def test_one_bad_image_costs_itself_only(
    what: str, cause: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 10)
    spoilt(folder, what)
    status, out = imported(folder)
    summary = capsys.readouterr().err
    assert status == 1
    assert cause in summary
    assert "line 7" in summary
    assert "000005.png" in summary
    assert "9 of 10 frames kept" in summary
    assert [f.sequence for f in frames_of(out)] == [0, 1, 2, 3, 4, 6, 7, 8, 9]


def rows_with(changes: dict[int, str | None], count: int = 10) -> list[str]:
    """The rows of `count` frames, some replaced or (None) left out."""
    return [r for i in range(count) if (r := changes.get(i, row(i))) is not None]


@pytest.mark.parametrize(
    ("changes", "cause", "kept"),
    [
        ({4: row(4).replace("-1.5", "-1.5").replace(f"{tilt(0.4)[0]:.6f}", "nan")}, "line 6", 10),
        ({4: "depth/000004.png,400000000,,,,,,"}, "1 row without a usable attitude (line 6)", 10),
        ({3: "depth/000003.png,300000000,1,2", 4: "depth/000004.png,400000000"}, "(line 5-6)", 10),
        ({4: "depth/000004.png,soon,0,0,0,0,0,0"}, "line 6: t_ns 'soon' is not a whole number", 9),
        ({4: ",400000000,0,0,0,0,0,0"}, "line 6: file is empty", 9),
        ({4: "depth/000004.png,100,0,0,0,0,0,0"}, "line 6: its time 100 ns is out of order", 9),
        ({4: "depth/000004.png,99999999999999,0,0,0,0,0,0"}, "line 6: its time 99999999999999 ns is out of order", 9),
        ({4: "depth/00\0004.png,400000000,0,0,0,0,0,0"}, "is not a file name; row left out", 9),
        ({4: "depth/000004.png,400000000,0,57.3,0,0,0,0"}, "more than a full turn (line 6)", 10),
        ({4: "depth/000004.png,400000000,0,0,0,0,nan,0"}, "1 row without a usable position (line 6)", 10),
        ({4: "depth/000004.png,9" + "9" * 30 + ",0,0,0,0,0,0"}, "out of range", 9),
        ({4: None, 5: None}, "2 images in depth/ without a usable row (000004.png, 000005.png)", 8),
    ],
)
def test_bad_rows_are_reported_with_their_lines(
    changes: dict[int, str | None], cause: str, kept: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = len(rows_with(changes))
    status, out = imported(write_folder(tmp_path / "rec", 10, rows_with(changes)))
    summary = capsys.readouterr().err
    assert status == 1
    assert cause in summary
    assert f"{kept} of {there} frames kept" in summary
    assert len(frames_of(out)) == kept


def test_times_that_fit_into_no_log_are_an_error_of_the_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was `Value out of range: 9223372037427387903`, and a part of a log was left."""
    first, last = (
        row(0).replace("png,0,", f"png,{1 - (1 << 62)},"),
        row(19).replace(",1900000000,", f",{(1 << 62) - 1},"),
    )
    folder = write_folder(tmp_path / "rec", 20, [first, *map(row, range(1, 19)), last])
    status, _ = imported(folder)
    assert status == 1
    err = capsys.readouterr().err
    assert "frames.csv: times from -4611686018427387903 ns to 4611686018427387903 ns do not fit into one log" in err
    assert "correct the first or the last stamp" in err
    assert [path.name for path in tmp_path.iterdir()] == ["rec"]


def test_a_pause_is_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = rows_with(dict.fromkeys(range(2, 9)), 20)
    folder = write_folder(tmp_path / "rec", 20, rows)
    for number in range(2, 9):
        (folder / "depth" / f"{number:06d}.png").unlink()
    status, out = imported(folder)
    assert status == 0
    assert "warning: " in (summary := capsys.readouterr().err)
    assert "lines 3-4: a pause of 0.80 s (median: 0.100 s)" in summary
    assert len(frames_of(out)) == 13
    assert imported(folder, "--replace", "--json")[0] == 0
    captured = capsys.readouterr()
    assert captured.err == summary  # the warnings, and no notes, as without --json
    assert json.loads(captured.out)["warnings"] == summary.removeprefix("companion: warning: ").splitlines()


def test_a_frames_number_leads_to_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out = imported(write_folder(tmp_path / "rec", 4))
    assert status == 0
    lines = out.with_suffix(".files.csv").read_text().splitlines()
    assert lines[0] == "sequence,file"
    assert f"{frames_of(out)[2].sequence},depth/000002.png" in lines
    assert "out.files.csv" in capsys.readouterr().out


def test_names_with_any_character_lead_to_their_files(tmp_path: Path) -> None:
    """A comma, a quote or a line end in a name broke the table."""
    names = ["a,b.png", 'say "c".png', "ü  x.png", "-n\nl.png"]
    folder = tmp_path / "rec"
    write_folder(folder, len(names))
    for number, name in enumerate(names):
        (folder / f"depth/{number:06d}.png").rename(folder / name)
    with (folder / "frames.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = [[name, *row(number).split(",")[1:]] for number, name in enumerate(names)]
        csv.writer(stream).writerows([HEADING.split(","), *rows])
    status, out = imported(folder)
    assert status == 0
    with out.with_suffix(".files.csv").open(newline="", encoding="utf-8") as stream:
        assert [(r["sequence"], r["file"]) for r in csv.DictReader(stream)] == [
            (str(n), f) for n, f in enumerate(names)
        ]


@pytest.mark.parametrize("how", ["link to itself", "NUL in the right image"])
def test_a_name_that_is_no_file_costs_its_own_frame(
    how: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 4)
    if how == "link to itself":
        (folder / "depth/000002.png").unlink()
        (folder / "depth/000002.png").symlink_to("000002.png")
    else:
        lines = (folder / "frames.csv").read_text().splitlines()
        lines = [f"{line},{right}" for line, right in zip(lines, ["file_right", "", "", "a\0b", ""], strict=True)]
        (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    status, out = imported(folder)
    assert status == 1
    assert "line 4: " in capsys.readouterr().err
    assert [f.sequence for f in frames_of(out)] == [0, 1, 3]


def test_the_import_reports_the_measured_share_and_range(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out = imported(write_folder(tmp_path / "rec", 3), "--json")
    assert status == 0
    depth = json.loads(capsys.readouterr().out)["depth"]
    images = [f.depth_mm for f in frames_of(out)]
    assert depth["measured_share"] == pytest.approx(np.mean([i[4::8, 4::8] > 0 for i in images]), abs=1e-3)
    assert depth["reach_m"] == pytest.approx(np.percentile(np.stack(images)[:, 4::8, 4::8], 95) / 1000, abs=0.2)


def test_a_row_without_attitude_keeps_its_frame_and_invents_nothing(tmp_path: Path) -> None:
    _, out = imported(write_folder(tmp_path / "rec", 10, rows_with({4: "depth/000004.png,400000000,nan,nan,nan,,,"})))
    events = events_of(out)
    assert 400_000_000 in [e.t_exposure_ns for e in events if isinstance(e, DepthFrame)]
    assert 400_000_000 not in [e.t_ns for e in events if isinstance(e, AttitudeSample)]


def test_an_attitude_in_degrees_is_not_used(tmp_path: Path) -> None:
    _, out = imported(write_folder(tmp_path / "rec", 10, rows_with({4: "depth/000004.png,400000000,0,57.3,0,0,0,0"})))
    events = events_of(out)
    assert 400_000_000 in [e.t_exposure_ns for e in events if isinstance(e, DepthFrame)]
    # the small angles of a file in degrees look like radians
    assert not any(isinstance(e, AttitudeSample) for e in events)


def test_a_column_that_stands_there_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row(i) + ",5" for i in range(3)]
    assert imported(write_folder(tmp_path / "rec", 3, rows, heading=HEADING + ",t_ns"))[0] == 1
    assert "column t_ns is duplicated" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["frames.csv", "", "."])
def test_an_output_that_would_destroy_something(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 3)
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert main(["import", str(folder), "-o", str(folder / name)]) == 1
    assert "-o" in capsys.readouterr().err
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_a_binary_file_in_place_of_the_list_is_not_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 3)
    (folder / "frames.csv").write_bytes(bytes(100_000))
    assert imported(folder)[0] == 1
    message = capsys.readouterr().err
    assert "frames.csv line 1: column file, t_ns is missing" in message
    assert len(message) < 1000
    assert message.replace("\n", " ").isprintable()


def test_columns_that_are_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "a", 3, ["depth/000000.png,0.1"], heading="file,roll_rad")
    assert imported(folder)[0] == 1
    assert "line 1: column t_ns is missing (found: ['file', 'roll_rad'])" in capsys.readouterr().err
    folder = write_folder(tmp_path / "semicolons", 3, ["depth/000000.png;1"], heading="file;t_ns")
    assert imported(folder)[0] == 1
    assert "separated by commas" in capsys.readouterr().err
    (folder / "frames.csv").write_bytes("file,t_ns\n".encode("utf-16"))
    assert imported(folder)[0] == 1
    assert "save it as CSV with commas, in UTF-8" in capsys.readouterr().err
    folder = write_folder(
        tmp_path / "b",
        3,
        [f"depth/{i:06d}.png,{i}00000000,0,0" for i in range(3)],
        heading="file,t_ns,roll_rad,yaw_rad",
    )
    status, out = imported(folder)
    assert status == 1
    assert "column pitch_rad is missing: no frame has an attitude" in capsys.readouterr().err
    assert len(frames_of(out)) == 3


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"fx": None}, "fx is missing"),
        ({"width": math.inf}, "width is inf; expected a whole number"),
        ({"width": math.nan}, "width is nan; expected a whole number"),
        ({"height": 48.5}, "height is 48.5; expected a whole number"),
        ({"fx": 10**400}, "too large"),
        ({"fx": "wide"}, "fx is 'wide'; expected a number"),
        ({"fx": 2.0}, "do not fit an image 64 px wide"),
        ({"cx": 400.0}, "principal point"),
        ({"depth_unit_mm": -1}, "depth_unit_mm = -1"),
        ({"invalid": "0"}, "invalid = '0'"),
    ],
)
def test_intrinsics_that_do_not_fit(
    change: dict[str, object], cause: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "rec", 2)
    path = folder / "intrinsics.json"
    content = json.loads(path.read_text()) | change
    path.write_text(json.dumps({k: v for k, v in content.items() if v is not None}))
    assert imported(folder)[0] == 1
    summary = capsys.readouterr().err
    assert cause in summary
    assert "intrinsics.json" in summary


def test_intrinsics_of_another_resolution(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 12)
    path = folder / "intrinsics.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"width": 128, "height": 96}))
    status, out = imported(folder)
    summary = capsys.readouterr().err
    assert status == 1
    assert "64x48 pixels, but intrinsics.json is for 128x96" in summary
    assert "... and 4 more: image" in summary
    assert "no frame could be used" in summary
    assert not out.exists()


def test_broken_json_and_nothing_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec", 1)
    (folder / "intrinsics.json").write_text("{")
    assert imported(folder)[0] == 1
    message = capsys.readouterr().err
    assert "not valid JSON" in message
    assert 'expected an object such as {"width": 640' in message
    (folder / "intrinsics.json").write_text("[" * 100_000)
    assert imported(folder)[0] == 1
    assert "nested too deeply" in capsys.readouterr().err
    assert imported(tmp_path / "none")[0] == 1
    assert "does not exist" in capsys.readouterr().err
    (folder / "frames.csv").write_text(HEADING + "\n")
    (folder / "intrinsics.json").unlink()
    assert imported(folder)[0] == 1
    assert "intrinsics.json: cannot be read" in capsys.readouterr().err


def test_units_and_invalid_values(tmp_path: Path) -> None:
    raw = np.array([[0, 1, 2000, 65533, 65534, 65535] * 8] * 16, np.uint16)
    path = tmp_path / "a.png"
    assert cv2.imwrite(str(path), raw)
    size = (48, 16)
    # a recorder's 65534 was a measurement beyond use or nonsense, never this project's "far"
    assert read_depth_png(path, size)[0, :6].tolist() == [0, 1, 2000, 65533, 0, 0]
    assert read_depth_png(path, size, invalid=(0, 2000))[0, :6].tolist() == [0, 1, 0, 65533, 0, 0]
    assert read_depth_png(path, size, unit_mm=0.1)[0, :6].tolist() == [0, 0, 200, 6553, 6553, 0]
    assert read_depth_png(path, size, unit_mm=10.0)[0, :6].tolist() == [0, 10, 20000, 0, 0, 0]
    with pytest.raises(BadData):
        read_depth_png(path, (16, 48))


def test_far_is_never_made_up() -> None:
    every = np.arange(65536, dtype=np.uint16)
    for unit in (0.25, 1.0, 1.00001, 3.0):
        assert millimetres(every, unit).max() <= 65533
