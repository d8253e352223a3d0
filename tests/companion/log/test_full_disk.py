"""Commands that write a log onto a full disk: the next run starts, and nothing that was recorded is lost."""

from __future__ import annotations

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.cli import main
from companion.config.service import RecordParams
from companion.error_text import error_text
from companion.log.log_directory import files_of
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.log.repair import repair_file
from companion.pipeline.state import PipelineState
from drivers.logs.reader import McapRecording
from tests.waiting import until

from ..recordings import write_folder
from ..small_recordings import INFO, MS
from .test_disk_space import noise

LOG = Path(__file__).parents[2] / "data" / "street.mcap"


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Writes beyond this size of a file fail, as on a disk that is full (EFBIG in place of ENOSPC)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def imported(folder: Path) -> list[str]:
    """The words of an import that writes some 100 kB."""
    return ["import", str(write_folder(folder / "rec")), "-o", str(folder / "out.mcap")]


def replayed(folder: Path) -> list[str]:
    """The words of a replay that writes 1 MB."""
    return ["replay", str(LOG), "-o", str(folder / "out.mcap")]


@pytest.mark.parametrize("words_of", [imported, replayed])
@pytest.mark.parametrize("share", [0.2, 0.999], ids=["within", "at the end"])
def test_the_next_run_starts_after_a_full_disk(
    words_of: object, share: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unfinished OUT.mcap.active stayed, took the rest of the disk, and the next run refused it."""
    assert callable(words_of)
    words, out = words_of(tmp_path), tmp_path / "out.mcap"
    assert main(words) == 0
    whole = out.read_bytes()
    out.unlink()
    capsys.readouterr()
    with files_up_to(round(len(whole) * share)):
        assert main(words) == 1
    err = capsys.readouterr().err
    assert f"{out}: File too large" in err
    assert "another disk" in err
    assert not list(tmp_path.glob("out.mcap*"))
    assert main(words) == 0
    assert out.read_bytes() == whole


def test_an_earlier_output_is_kept_by_a_full_disk(tmp_path: Path) -> None:
    """It is the only copy until the new one is complete."""
    words, out = replayed(tmp_path), tmp_path / "out.mcap"
    out.write_bytes(LOG.read_bytes())
    with files_up_to(200_000):
        assert main([*words, "--replace"]) == 1
    assert out.read_bytes() == LOG.read_bytes()
    assert list(tmp_path.glob("out.mcap*")) == [out]


@pytest.mark.parametrize("number", [errno.EIO, errno.EROFS])
def test_another_fault_of_the_disk_keeps_what_was_written(number: int, tmp_path: Path) -> None:
    """The source may be on the same failing disk: what was read of it is kept."""

    def write() -> None:
        with LogWriter(tmp_path / "a.mcap") as log:
            log.begin(run_info("live"), (INFO,))
            raise OSError(number, os.strerror(number))

    with pytest.raises(OSError, match=os.strerror(number)):
        write()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap.active"]
    assert "companion recover" in error_text(OSError(number, os.strerror(number)), tmp_path / "a.mcap")


def test_a_file_that_is_too_large_for_its_disk_is_not_a_lack_of_space() -> None:
    """FAT32 limits a file to 4 GB. The remedy was to check the free space."""
    text = error_text(OSError(errno.EFBIG, os.strerror(errno.EFBIG)), "/usb/out.mcap")
    assert text.startswith("/usb/out.mcap: File too large")
    assert "FAT32" in text
    assert "free space" not in text


@pytest.mark.process
def test_the_recorder_keeps_what_a_limit_of_the_file_size_ends(tmp_path: Path) -> None:
    """The next start repairs it. The remedy was to check the mount and the rights."""
    recorder = Recorder(tmp_path, run_info("live"), RecordParams(least_free_mb=1.0))
    with files_up_to(1_000_000):
        recorder.open()
        for k in range(5):
            if recorder.wants_begin:
                recorder.begin((k + 2) * 33 * MS, (INFO,), PipelineState())
            recorder.event(noise(k))
        assert until(lambda: bool(recorder.status.fault), 60.0)
        assert "File too large; its disk, or a limit of this process" in recorder.status.fault
        assert "file_mb" in recorder.status.fault
        recorder.close()
    (unfinished,) = files_of(tmp_path)
    assert unfinished.active
    assert "messages recovered" in repair_file(unfinished.path)
    (log,) = files_of(tmp_path)
    with McapRecording(log.path) as recording:
        assert [item.sequence for item in recording.messages("depth")][:1] == [0]
