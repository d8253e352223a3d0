"""What killed runs left behind is made whole, one file at a time, in a process of the lowest priority.

The recorder starts it once the running flight is being recorded: copying a file of 512 MB takes many seconds, in which
the recorder's own thread would write nothing. An unfinished file is deleted only when its whole copy is on the disk, so
that a kill at any moment loses nothing: the next start begins the copy anew."""

from __future__ import annotations

import fcntl
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from drivers.base import DriverError

from ..console import print_line
from .log_directory import files_of, recovering_files
from .log_writer import ACTIVE
from .recover import recover

log = logging.getLogger("companion")

CHILD: Final = "import os; os.nice(19); from companion.log.repair import run_child; run_child()"
LEFT: Final = "left as it is"


def leftovers(folder: Path, running: str) -> list[Path]:
    """Unfinished files of other flights than the running one, oldest first."""
    return [f.path for f in files_of(folder) if f.active and f.flight != running]


def repair_file(path: Path) -> str:
    """Makes a whole file of an unfinished one; returns what was done, in words. Where that fails, and while another
    process writes or repairs the file, it stays as it is."""
    target = path.with_name(path.name.removesuffix(ACTIVE))
    try:
        with path.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            result = recover(path, target)
            if result.output is None:
                os.replace(path, target)  # it was whole, only its name was missing
            else:
                _sync_folder(path.parent)  # the copy has its name on the disk before the original goes
                path.unlink()
    except BlockingIOError:
        return f"{path.name}: {LEFT} (another process writes or repairs it)"
    except (DriverError, ValueError, OSError) as error:
        return f"{path.name}: {LEFT} ({error})"
    return f"{target.name}: {result.messages} messages recovered"


def repair(folder: Path, running: str) -> list[str]:
    """`repair_file` of all `leftovers`, here and now."""
    return [repair_file(path) for path in leftovers(folder, running)]


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Repairs:
    """Repairs beside a recording. `begin`, then `step` again and again, and `stop` at the end; from one thread."""

    def __init__(self, folder: Path, command: tuple[str, ...] = (sys.executable, "-c", CHILD)) -> None:
        self._folder, self._command = folder, command
        self._waiting: list[Path] = []
        self._process: subprocess.Popen[str] | None = None
        self._path: Path | None = None
        self.results: list[str] = []

    @property
    def repairing(self) -> str:
        """Name of the file that is being repaired, empty: none is."""
        return self._path.name if self._path is not None else ""

    @property
    def fault(self) -> str:
        """Which files could not be repaired, in words; empty: none."""
        return "; ".join(s for s in self.results if LEFT in s)

    def begin(self, running: str) -> None:
        """Looks for what is to be repaired, and deletes copies that an earlier repair did not finish."""
        for path in recovering_files(self._folder):
            path.unlink(missing_ok=True)
        self._waiting = leftovers(self._folder, running)

    def step(self, room_for: Callable[[int], bool]) -> None:
        """Takes the result of a repair that has ended, or starts the next. room_for: whether a copy of so many bytes
        may be written."""
        if self._process is not None:
            if self._process.poll() is not None:
                self._take_result()
        elif self._waiting:
            self._start(self._waiting.pop(0), room_for)

    def _start(self, path: Path, room_for: Callable[[int], bool]) -> None:
        try:
            size = path.stat().st_size
        except FileNotFoundError:
            return  # it made room for another
        if not room_for(size):
            self._add_result(
                f"{path.name}: {LEFT} (no room for a copy of {size / 1e6:.0f} MB; `companion recover` makes one)"
            )
            return
        log.info("log: repairs %s, %.0f MB, which a killed run left, beside the recording", path.name, size / 1e6)
        self._path = path
        # the open end of its standard input tells the child that this process lives
        self._process = subprocess.Popen(
            [*self._command, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def _take_result(self) -> None:
        assert self._process is not None
        assert self._path is not None
        text, _ = self._process.communicate()
        name, code = self._path.name, self._process.returncode
        self._process = self._path = None
        self._add_result(text.strip() or f"{name}: {LEFT} (its repair ended with status {code})")

    def _add_result(self, text: str) -> None:
        self.results.append(text)
        log.log(logging.WARNING if LEFT in text else logging.INFO, "log: %s", text)

    def files_deleted(self, paths: list[Path]) -> None:
        """These files were deleted to make room: their repair ends."""
        if self._path in paths:
            self.stop("its file was deleted to make room")

    def stop(self, why: str = "") -> bool:
        """Ends a repair at once; whether there was one. The unfinished file stays, its copy is deleted. why: to be said."""
        if self._process is None:
            return False
        if why:
            self._add_result(f"{self.repairing}: {LEFT} ({why})")
        self._process.kill()
        self._process.communicate()
        self._process = self._path = None
        for path in recovering_files(self._folder):
            path.unlink(missing_ok=True)
        return True


def run_child() -> None:
    """The child process: repairs the file that its command line names, and says on standard output what was done."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    print_line(repair_file(Path(sys.argv[1])))


def _end_with_parent() -> None:
    """Ends this process when the recorder's is gone: the next start repairs by itself."""
    while os.read(0, 1):  # not through sys.stdin, whose lock would be held when this process ends by itself
        pass
    os._exit(1)
