"""The file of a log on the disk: its temporary name, its lock, and what an output must not replace.

A log is written as FILE.active and renamed when complete. A killed process leaves the .active file, which `companion
recover` completes."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Final

from mcap.writer import CompressionType, Writer

from drivers.logs.record_scanner import MAGIC
from drivers.logs.written import is_being_written

from ..whole_file import refuse_existing
from .mcap_writer import McapWriter

LIBRARY: Final = "osape-companion log 1"
"""In the file's header; a constant, so that a newer MCAP library does not change the bytes."""
CHUNK_BYTES: Final = 1 << 20
ACTIVE: Final = ".active"
RECOVERING: Final = ".recovering"
"""Suffix after ACTIVE of a file that a repair is writing."""
RECOVERED: Final = ".recovered.mcap"
"""End of the name of a log that `companion recover` has made, in place of .mcap."""
DAMAGED: Final = ".damaged"
"""Suffix of an original that a repair could not copy completely."""


class FileInUseError(ValueError):
    """Another process writes this file."""


class UnfinishedLogError(ValueError):
    """A file holds the log of a process that was interrupted."""

    def __init__(self, path: Path) -> None:
        super().__init__(
            f"{path} exists, an unfinished log, which --replace does not replace: complete it with `companion recover {path}`, "
            "or delete it, or give -o another name"
        )


def open_locked(path: Path, *, replace: bool) -> BinaryIO:
    """Opens a file for writing; no other process can do so, repair or delete it meanwhile. A file with content is emptied, or
    refused without `replace`. Raises OSError, FileInUseError where another process has it open, and UnfinishedLogError."""
    stream = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o666), "wb")
    try:
        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not os.path.samestat(os.stat(path), os.fstat(stream.fileno())):
            raise BlockingIOError  # the other process has just completed and renamed it
    except (BlockingIOError, FileNotFoundError) as error:
        stream.close()
        raise _in_use(path) from error
    except OSError:
        pass  # some network file systems have no locks
    if os.fstat(stream.fileno()).st_size:  # a device cannot be emptied
        if not replace:
            stream.close()
            raise UnfinishedLogError(path)
        stream.truncate(0)
    return stream


def _in_use(path: Path) -> FileInUseError:
    return FileInUseError(f"{path}: another process writes it; wait for its end, or give another name")


def refuse_output(path: Path, *inputs: Path, replace: bool) -> None:
    """Raises ValueError where writing a log to `path` would overwrite an input (also by the temporary name) or an unfinished
    log, and as `refuse_target`."""
    active = Path(f"{path}{ACTIVE}")  # with_name raises ValueError for the directory "."
    # Path.resolve raises RuntimeError for a link to itself
    taken = {os.path.realpath(path), os.path.realpath(active)}
    for given in inputs:
        if os.path.realpath(given) in taken:
            raise ValueError(
                f"{given}: writing {path} would overwrite this input, or its unfinished log would have the same name; "
                "give -o another name"
            )
    refuse_target(path, replace=replace)
    if active.is_file() and active.stat().st_size:
        raise _in_use(active) if is_being_written(active) else UnfinishedLogError(active)


def refuse_target(path: Path, *, replace: bool) -> None:
    """Raises ValueError for a directory, a device, or a file that is not a log; without `replace` also for a log."""
    if path.is_dir():
        raise ValueError(f"{path}: is a directory; give -o the name of a file, such as {path / 'out.mcap'}")
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: a device, pipe or socket, which the log would replace; give -o the name of a file")
    if path.is_file() and path.stat().st_size:
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise ValueError(f"{path}: exists and is not a log; it is not overwritten; give -o another name")
    refuse_existing(path, replace=replace)


def start_writer(stream: BinaryIO) -> Writer:
    """A started writer for MCAP files of any content. LogWriter is faster for logs of this software."""
    writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start(profile="", library=LIBRARY)
    return writer


def finish_file(writer: McapWriter | Writer, stream: BinaryIO, active: Path, path: Path) -> None:
    """Finishes the file, flushes it to the disk and renames it."""
    finish: Callable[[], None] = writer.finish
    finish()
    stream.truncate()
    os.fsync(stream.fileno())
    os.replace(active, path)  # before the lock ends: `open_locked` of another process would empty the file
    stream.close()
