"""Repairs unfinished files of earlier runs, one at a time, in a process of the lowest priority.

The recorder starts it once the flight is being recorded: copying a file of 512 MB takes many seconds, during which the
recorder's thread could not write. An unfinished file is deleted only when its complete copy is on the disk: a kill at
any moment loses nothing, and the next start begins the copy again. One that is damaged before its end is kept as .damaged, since
the copy lacks what could not be read."""

from __future__ import annotations

import fcntl
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from drivers.base import DriverError
from drivers.logs.written import is_being_written

from ..console import counted, print_line
from ..stop_signal import end_with_parent
from .log_directory import delete_unfinished_copies, files_of
from .log_file import ACTIVE, DAMAGED
from .recover import copy_readable

log = logging.getLogger("companion")

CHILD: Final = "import os; os.nice(19); from companion.log.repair import run_child; run_child()"
LEFT: Final = "left as it is"


def leftovers(folder: Path, running: str) -> list[Path]:
    """Unfinished files of flights other than the running one, oldest first."""
    return [f.path for f in files_of(folder) if f.active and f.flight != running]


def repair_file(path: Path) -> str:
    """Completes an unfinished file; returns the result as text. Where that fails, or another process writes or repairs
    the file, it is left as it is."""
    target = path.with_name(path.name.removesuffix(ACTIVE))
    try:
        with path.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)  # not while it is written
            if os.fstat(stream.fileno()).st_size == 0:  # the power failed before the first second was written
                path.unlink()
                return f"{path.name}: empty, deleted"
            result = copy_readable(path, target)
            if result.output is None:
                os.replace(path, target)  # it was complete except for its name
            elif all(damage.end for damage in result.damages):
                _sync_folder(path.parent)  # the copy's name must be on the disk before the original is deleted
                path.unlink()
            else:
                kept = path.with_name(target.name + DAMAGED)
                os.replace(path, kept)
                place = next(damage for damage in result.damages if not damage.end)
                return (
                    f"{target.name}: {counted(result.messages, 'message')} recovered; {kept.name} is the original, kept because it "
                    f"is damaged at byte {place.offset} ({place.cause})"
                )
    except BlockingIOError:
        return f"{path.name}: {LEFT} (another process writes or repairs it)"
    except (DriverError, ValueError, OSError) as error:
        return f"{path.name}: {LEFT} ({error})"
    return f"{target.name}: {counted(result.messages, 'message')} recovered"


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Repairs:
    """Repairs beside a recording. Call `begin`, then `step` repeatedly, and `stop` at the end, from one thread."""

    def __init__(self, folder: Path, command: tuple[str, ...] = (sys.executable, "-c", CHILD)) -> None:
        self._folder, self._command = folder, command
        self._waiting: list[Path] = []
        self._process: subprocess.Popen[str] | None = None
        self._path: Path | None = None
        self.results: list[str] = []

    @property
    def repairing(self) -> str:
        """Name of the file being repaired; empty: none."""
        return self._path.name if self._path is not None else ""

    @property
    def fault(self) -> str:
        """Files that could not be repaired, as text; empty: none."""
        return "; ".join(s for s in self.results if LEFT in s)

    def begin(self, running: str) -> None:
        """Lists the files to repair and deletes unfinished copies of an earlier repair. Raises OSError where the directory
        cannot be read."""
        delete_unfinished_copies(self._folder)
        self._waiting = leftovers(self._folder, running)

    def step(self, room_for: Callable[[int], bool]) -> None:
        """Takes the result of a finished repair, or starts the next. room_for: whether a copy of that many bytes may be
        written."""
        if self._process is not None:
            if self._process.poll() is not None:
                self._take_result()
        elif self._waiting:
            path = self._waiting.pop(0)
            try:
                self._start(path, room_for)
            except OSError as error:
                self._add_result(f"{path.name}: {LEFT} ({error.strerror or error}; the next start tries again)")

    def _start(self, path: Path, room_for: Callable[[int], bool]) -> None:
        try:
            size = path.stat().st_size
            if is_being_written(path):
                return  # by another service
        except FileNotFoundError:
            return  # the file was deleted to free disk space
        if not room_for(size):
            self._add_result(
                f"{path.name}: {LEFT} (no space for a copy of {size / 1e6:.0f} MB; run `companion recover` with an "
                "output on another disk)"
            )
            return
        log.info("log: repairing %s, %.0f MB, left unfinished by an earlier run", path.name, size / 1e6)
        # the child ends when its standard input closes, which shows that this process has ended; Ctrl-C in a terminal
        # does not reach its process group
        self._process = subprocess.Popen(
            [*self._command, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, process_group=0
        )
        self._path = path

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
        """Stops the repair of a file that was deleted to free disk space."""
        if self._path in paths:
            self.stop("its file was deleted to free disk space")

    def stop(self, why: str = "") -> bool:
        """Stops a repair; returns whether one was running. The unfinished file stays, its copy is deleted. why:
        reported if not empty."""
        if self._process is None:
            return False
        if why:
            self._add_result(f"{self.repairing}: {LEFT} ({why})")
        self._process.kill()
        self._process.communicate()
        self._process = self._path = None
        delete_unfinished_copies(self._folder)
        return True


def run_child() -> None:
    """The child process: repairs the file named on its command line and prints the result."""
    end_with_parent()  # the next start repairs again
    print_line(repair_file(Path(sys.argv[1])))
