"""The commands from a directory of images to pictures: files, output and status. Import, replay and view as installed, in
processes of their own."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import pytest

from companion.cli import main
from companion.importers.frames_csv import ATTITUDE, POSITION
from core.frames import rotation_from_quaternion
from core.types import AttitudeSample, DepthFrame
from drivers.logs.reader import McapRecording

from ...golden import recording_path
from ..recordings import events_of

COMMAND = Path(sys.executable).with_name("companion")
FRAMES = 10


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    status: int
    out: str
    err: str

    def json(self) -> dict[str, Any]:
        """The one object on stdout."""
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found


def companion(*arguments: str | Path, env: dict[str, str] | None = None, cwd: Path | None = None) -> Done:
    command = [str(COMMAND), *map(str, arguments)]
    environment = {**os.environ, **(env or {})}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=cwd)
    return Done(done.returncode, done.stdout, done.stderr)


class Typed:
    """Commands in the process of the test: each process of its own imports the service anew."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str | Path) -> Done:
        self._capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        return Done(status, *self._capsys.readouterr())


@pytest.fixture
def typed(capsys: pytest.CaptureFixture[str]) -> Typed:
    return Typed(capsys)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The golden stream `alley` as a directory of depth images."""
    path = tmp_path_factory.mktemp("alley")
    (path / "depth").mkdir()
    events = events_of(recording_path("alley"))
    attitudes = [e for e in events if isinstance(e, AttitudeSample)]
    with McapRecording(recording_path("alley")) as recording:
        k = recording.cameras[0].intrinsics
    names = ("width", "height", "fx", "fy", "cx", "cy")
    (path / "intrinsics.json").write_text(json.dumps({name: getattr(k, name) for name in names}))
    with (path / "frames.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["file", "t_ns", *ATTITUDE, *POSITION])
        for frame in (e for e in events if isinstance(e, DepthFrame)):
            name = f"depth/{frame.sequence:06d}.png"
            assert cv2.imwrite(str(path / name), frame.depth_mm)
            nearest = min(attitudes, key=lambda a: abs(a.t_ns - frame.t_exposure_ns))
            table.writerow([name, frame.t_exposure_ns, *euler_rad(nearest), 0.0, 0.0, -1.7])
    return path


def euler_rad(sample: AttitudeSample) -> tuple[float, float, float]:
    R = rotation_from_quaternion(sample.q_ned_frd_wxyz)
    roll = math.atan2(R[2, 1], R[2, 2])
    return roll, -math.asin(R[2, 0]), math.atan2(R[1, 0], R[0, 0])


@pytest.fixture(scope="session")
def flight(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder imported by the command."""
    out = tmp_path_factory.mktemp("flight") / "flight.mcap"
    done = companion("import", folder, "-o", out, "--json", "--ke", "0.0015")
    assert (done.status, done.err) == (0, "")
    report = done.json()
    assert (report["frames"], report["frames_named"], report["problems"]) == (FRAMES, FRAMES, [])
    return out


@pytest.fixture(scope="session")
def prisms(flight: Path) -> Path:
    """The flight replayed by the command."""
    out = flight.with_name("prisms.mcap")
    done = companion("replay", flight, "-o", out, "--json")
    assert (done.status, done.err) == (0, "")
    report = done.json()
    assert (report["frames"], report["valid"], report["dropped"], report["invalid"]) == (FRAMES, FRAMES, {}, {})
    assert report["ground_seen"] == FRAMES
    assert report["planes"] > FRAMES
    return out


@pytest.mark.process
def test_replay_checks_its_own_log(prisms: Path, typed: Typed) -> None:
    done = typed("replay", prisms, "--check", "--json")
    assert (done.status, done.err) == (0, "")
    check = done.json()["check"]
    assert (check["passed"], check["compared"], check["different"]) == (True, FRAMES, 0)
    people = typed("replay", prisms, "--check")
    assert people.status == 0
    assert f"check: {FRAMES} frames compared bit by bit: equal" in people.out


@pytest.mark.process
def test_a_check_that_fails(prisms: Path, typed: Typed, tmp_path: Path) -> None:
    """With other parameters than those of the log it reports the differences and exits with 1."""
    config = tmp_path / "other.toml"
    config.write_text("[extractor]\npassable_width_m = 1.0\n")
    done = typed("replay", prisms, "--check", "-c", config, "--json")
    assert done.status == 1
    check = done.json()["check"]
    assert check["different"] > 0
    assert not check["passed"]
    assert done.json()["problems"]
    assert f"check: {check['different']} of {FRAMES} frames differ; first: camera front, frame" in done.err


@pytest.mark.process
def test_info(prisms: Path, typed: Typed) -> None:
    done = typed("info", prisms, "--json")
    assert (done.status, done.err) == (0, "")
    printed = done.json()
    assert {t["topic"]: t["messages"] for t in printed["topics"]}["/camera/front/prisms"] == FRAMES
    assert "10 valid frames" in typed("info", prisms).out


@pytest.mark.process
def test_view(prisms: Path, tmp_path: Path) -> None:
    done = companion("view", prisms, "-o", tmp_path / "view", "--every", "5", "--json")
    assert (done.status, done.err) == (0, "")
    printed = done.json()
    assert (printed["frames"], printed["valid"], printed["damage"]) == (FRAMES, FRAMES, None)
    assert len(printed["pictures"]) == 2
    assert all(Path(p).stat().st_size > 10_000 for p in [*printed["pictures"], printed["page"]])


@pytest.mark.process
def test_a_cut_log_is_reported_by_all_and_recovered(prisms: Path, typed: Typed, tmp_path: Path) -> None:
    cut, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    cut.write_bytes(prisms.read_bytes()[: prisms.stat().st_size * 2 // 3])
    for arguments in (("info", cut), ("replay", cut), ("view", cut, "-o", tmp_path / "view", "--no-png")):
        done = typed(*arguments, "--json")
        assert done.status == 1
        assert done.json()
        assert done.err.startswith("companion: error: ")
        assert "companion recover" in done.err
        assert "Traceback" not in done.err
    done = typed("recover", cut, "-o", whole, "--json")
    assert done.status == 0
    assert done.json()["damage"]
    assert typed("info", whole).status == 0
    again = typed("replay", whole, "--check", "--json")
    assert again.status == 0
    assert 0 < again.json()["check"]["compared"] < FRAMES
    assert typed("recover", whole).out.startswith(f"{whole} is complete")


@pytest.mark.process
@pytest.mark.parametrize("in_process", [False, True])
@pytest.mark.parametrize(("arguments", "status"), [((), 2), (("replay", "absent.mcap"), 1)])
def test_a_failure_is_the_same_in_a_process_of_its_own(
    arguments: tuple[str, ...], status: int, in_process: bool, typed: Typed, in_folder: Path
) -> None:
    done = typed(*arguments) if in_process else companion(*arguments, cwd=in_folder)
    assert (done.status, done.out) == (status, "")
    assert "error: " in done.err
    assert "Traceback" not in done.err


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly",),
        ("replay",),
        ("import", "somewhere"),
        ("replay", "a.mcap", "--chek"),
        ("replay", "a.mcap", "--tolerance", "7"),
        ("view", "a.mcap", "-o", "x", "--every", "0"),
    ],
)
def test_wrong_use(arguments: tuple[str, ...], typed: Typed, in_folder: Path) -> None:
    done = typed(*arguments)
    assert (done.status, done.out) == (2, "")
    assert "error: " in done.err
    assert not list(in_folder.iterdir())


@pytest.mark.parametrize(
    ("arguments", "cause", "remedy"),
    [
        (("replay", "absent.mcap"), "absent.mcap: the file does not exist", "check the path"),
        (("info", "text.mcap"), "text.mcap: not an MCAP file", "give a log that was recorded as MCAP"),
        (("import", "absent", "-o", "x.mcap"), "absent: does not exist", "expected a directory with intrinsics.json"),
        (
            ("import", "empty", "-o", "x.mcap"),
            "intrinsics.json: cannot be read",
            "it must contain width, height, fx, fy",
        ),
        (("replay", "text.mcap", "-o", "text.mcap"), "would overwrite this input", "give -o another name"),
        (("check-config", "wrong.toml"), "passable_widht_m: no such key", "did you mean passable_width_m?"),
    ],
)
def test_failures(arguments: tuple[str, ...], cause: str, remedy: str, typed: Typed, in_folder: Path) -> None:
    (in_folder / "empty").mkdir()
    (in_folder / "text.mcap").write_text("this is no log\n")
    (in_folder / "wrong.toml").write_text("[extractor]\npassable_widht_m = 2.0\n")
    done = typed(*arguments)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith("companion: error: ")
    assert cause in done.err
    assert remedy in done.err
    assert not (in_folder / "x.mcap").exists()


@pytest.mark.process
def test_a_cache_that_cannot_be_written_is_named_as_it_was_given(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cache = tmp_path / "file" / "cache"
    done = companion("warmup", env={"NUMBA_CACHE_DIR": str(cache)})
    assert (done.status, done.out) == (1, "")
    assert f"compiled kernels cannot be stored in {cache}, " in done.err
    assert "set NUMBA_CACHE_DIR to a folder" in done.err


def kernels_in(cache: Path) -> dict[str, int]:
    """Machine code in a cache -> when it was written."""
    return {f.name: f.stat().st_mtime_ns for f in cache.rglob("*.nbc")}


CALLED = {"level.level_into", "ground.search_ground", "strip_search.strips_of_view", "plane_shaping.shape_planes"}
"""Some of the kernels that Python calls, which alone are compiled where the others are in the cache."""


@pytest.mark.slow
def test_the_same_bytes_with_fresh_and_with_cached_kernels(flight: Path, prisms: Path, tmp_path: Path) -> None:
    """Every fourth kernel and some more compiled in this very run, beside callers and called ones from the cache; all read
    from the cache that it left; and (the fixture) from that of long ago. All of them compiled anew: the soak below."""
    warm = Path(os.environ["NUMBA_CACHE_DIR"])
    half_written = shutil.ignore_patterns("*.tmp.*")  # another worker may compile just now
    cache = shutil.copytree(warm, tmp_path / "cache" / warm.name, ignore=half_written).parent
    for k, index in enumerate(sorted(cache.rglob("*.nbi"))):
        if k % 4 == 0 or index.name.split("-")[0] in CALLED:
            index.unlink()
    before = kernels_in(cache)
    logs = [tmp_path / "fresh.mcap", tmp_path / "cached.mcap"]
    assert companion("replay", flight, "-o", logs[0], env={"NUMBA_CACHE_DIR": str(cache)}).status == 0
    first = kernels_in(cache)
    assert sum(first[name] != before.get(name) for name in first) >= len(CALLED)
    assert companion("replay", flight, "-o", logs[1], env={"NUMBA_CACHE_DIR": str(cache)}).status == 0
    assert kernels_in(cache) == first, "the second run compiled again"
    assert logs[0].read_bytes() == logs[1].read_bytes() == prisms.read_bytes()


@pytest.mark.soak
def test_the_same_bytes_with_all_kernels_fresh(flight: Path, prisms: Path, tmp_path: Path) -> None:
    log = tmp_path / "fresh.mcap"
    assert companion("replay", flight, "-o", log, env={"NUMBA_CACHE_DIR": str(tmp_path / "cache")}).status == 0
    assert len(kernels_in(tmp_path / "cache")) > 10
    assert log.read_bytes() == prisms.read_bytes()
