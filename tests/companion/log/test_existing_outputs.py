"""Files that are at the place of an output: no command replaces one, unless `--replace` is given."""

from __future__ import annotations

import fcntl
import shutil
from pathlib import Path

import pytest

from companion.cli import main
from companion.log.log_file import UnfinishedLogError, open_locked
from companion.log.log_writer import LogWriter
from core.types import DepthFrame
from drivers.logs.record_scanner import MAGIC

from ..recordings import write_folder
from ..small_recordings import flight, write_flight

LOG = Path(__file__).parents[2] / "data" / "street.mcap"
RECORDED = MAGIC + b"the only copy of a flight"
WRITERS = {
    "import": ("FOLDER -o OUT.mcap", "OUT.mcap"),
    "replay": ("LOG -o OUT.mcap", "OUT.mcap"),
    "recover": ("CUT -o OUT.mcap", "OUT.mcap"),
    "recover, flight": ("cut.mcap.active", "cut.mcap"),
    "recover, no name": ("CUT", "cut.recovered.mcap"),
    "export, npz": ("RESULTS -f npz -o OUT.npz", "OUT.npz"),
    "export, gltf": ("RESULTS -f gltf -o OUT.glb", "OUT.glb"),
    "export, csv": ("RESULTS -f csv -o FOLDER", "rec/frames.csv"),
    "configs": ("oak -o OUT.toml", "OUT.toml"),
    "setup": ("--yes --no-doctor --camera simulated --autopilot none -o OUT.toml", "OUT.toml"),
}
"""Command, and the case of it -> (arguments, file at the place of an output). RESULTS is a log with prisms, CUT a damaged
one."""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "prisms.mcap"
    assert main(["replay", str(LOG), "-o", str(path)]) == 0
    return path


@pytest.mark.parametrize("there", [False, True], ids=["new", "replaced"])
@pytest.mark.parametrize("command", ["import", "replay"])
def test_without_a_usable_frame_no_log_is_written(
    command: str, there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A good log was replaced by one without a frame."""
    monkeypatch.chdir(tmp_path)
    source, output = Path("source"), Path("out.mcap")
    if command == "import":
        write_folder(source, 12)
        for image in source.rglob("*.png"):
            image.write_bytes(b"damaged")
    else:
        write_flight(source, [event for event in flight(3) if not isinstance(event, DepthFrame)])
    if there:
        output.write_bytes(RECORDED)
        output.with_suffix(".files.csv").write_text("sequence,file\n0,a.png\n")
    before = {path: path.read_bytes() for path in Path().glob("out*")}
    assert main([command, str(source), "-o", "out.mcap", *(["--replace"] if there else [])]) == 1
    ended = capsys.readouterr()
    expected = "no frame could be used" if command == "import" else "no depth image in the input"
    assert expected in ended.err
    assert "out.mcap was not written" in ended.err
    assert "written: out.mcap" not in ended.out
    assert {path: path.read_bytes() for path in Path().glob("out*")} == before


@pytest.mark.parametrize("output", [".", "/", "there"])
@pytest.mark.parametrize("command", ["replay", "recover", "import"])
def test_a_directory_is_no_place_of_a_log(
    command: str, output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`PosixPath('.') has an empty name`."""
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    source = write_folder(tmp_path / "rec") if command == "import" else LOG
    assert main([command, str(source), "-o", output, "--replace"]) == 1
    assert f"{output}: is a directory; give -o the name of a file" in capsys.readouterr().err


@pytest.mark.parametrize("words", ["view -o", "demo --fast -o"])
def test_a_file_is_no_directory(words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`File exists; check the path, its permissions and the free space`."""
    (there := tmp_path / "there").touch()
    name, *options = words.split()
    assert main([name, *([str(LOG)] if name == "view" else []), *options, str(there)]) == 1
    assert capsys.readouterr().err == f"companion: error: {there}: File exists; give another name\n"


@pytest.mark.parametrize("written", [False, True], ids=["interrupted", "being written"])
@pytest.mark.parametrize("options", [[], ["--replace"]], ids=["kept", "replaced"])
@pytest.mark.parametrize("command", ["import", "replay"])
def test_an_unfinished_log_is_never_replaced(
    command: str, options: list[str], written: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--replace` emptied it at once: the flight of a killed recording was lost, also where the new log then failed."""
    source = write_folder(tmp_path / "rec") if command == "import" else LOG
    out, unfinished = tmp_path / "out.mcap", tmp_path / "out.mcap.active"
    unfinished.write_bytes(RECORDED)
    with unfinished.open("rb") as stream:
        if written:
            fcntl.flock(stream, fcntl.LOCK_EX)
        assert main([command, str(source), "-o", str(out), *options]) == 1
    expected = (
        f"{unfinished}: another process writes it; wait for its end, or give another name"
        if written
        else f"{unfinished} exists, an unfinished log, which --replace does not replace: complete it with `companion recover "
        f"{unfinished}`, or delete it, or give -o another name"
    )
    assert capsys.readouterr().err == f"companion: error: {expected}\n"
    assert unfinished.read_bytes() == RECORDED
    assert not out.exists()


def test_an_unfinished_log_that_appears_while_another_is_prepared_is_kept(tmp_path: Path) -> None:
    (tmp_path / "out.mcap.active").write_bytes(RECORDED)
    with pytest.raises(UnfinishedLogError):
        LogWriter(tmp_path / "out.mcap")
    with pytest.raises(UnfinishedLogError):
        open_locked(tmp_path / "out.mcap.active", replace=False)
    assert (tmp_path / "out.mcap.active").read_bytes() == RECORDED


@pytest.mark.parametrize("case", WRITERS)
def test_a_file_is_replaced_on_request_only(
    case: str, results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, name = WRITERS[case]
    monkeypatch.chdir(tmp_path)
    shutil.copy(results, "prisms.mcap")
    Path("cut.mcap").write_bytes(LOG.read_bytes()[:-50])
    Path("cut.mcap.active").write_bytes(LOG.read_bytes()[:-50])
    write_folder(Path("rec"))
    places = {"FOLDER": "rec", "LOG": str(LOG), "RESULTS": "prisms.mcap", "CUT": "cut.mcap"}
    words = [case.partition(",")[0], *(places.get(word, word) for word in arguments.split())]
    there = Path(name)
    if not there.exists():
        there.write_bytes(RECORDED)
    before = there.read_bytes()
    assert main(words) == 1
    assert f"{there} exists; give -o another name, or --replace" in capsys.readouterr().err
    assert there.read_bytes() == before
    assert not list(Path().glob("*.part-*"))
    assert main([*words, "--replace"]) == 0
    assert not there.exists() or there.read_bytes() != before
