"""Files of flights and of datasets, local or at a URL that fsspec knows (s3://, gs://, https://)."""

from __future__ import annotations

import fnmatch
import glob
import importlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from drivers.base import DeviceNotFound, DriverError
from drivers.optional_library import install_command
from drivers.regular_file import regular

LOG_NAMES: Final = ("*.mcap", "*.mcap.active")
LOGS: Final = "logs"
"""Folder in a dataset for replayed logs."""
UNFINISHED: Final = ".unfinished"
"""Folder in a local dataset for files that are being written; readers of Parquet skip names that begin with a dot."""
_GLOB_CHARACTERS: Final = frozenset("*?[")


_LIBRARIES: Final = {
    "s3": "s3fs>=2024.2",
    "gs": "gcsfs",  # no extra: it is not locked with the others
    "http": "fsspec[http]>=2024.2",
    "https": "fsspec[http]>=2024.2",
}
"""Packages for addresses; each installs fsspec too."""


@dataclass(frozen=True, slots=True, order=True)
class StoredFile:
    """A log file."""

    location: str  # an absolute path or a URL
    size: int

    @property
    def name(self) -> str:
        """The last part of the location."""
        return self.location.rsplit("/", 1)[-1]

    @property
    def folder(self) -> str:
        """The location without the name."""
        return self.location.rpartition("/")[0]


def is_url(location: str) -> bool:
    """Whether a location needs fsspec."""
    return "://" in location


def file_system(location: str) -> tuple[Any, str]:
    """(file system of fsspec, path in it) of a URL. Raises DeviceNotFound where a library for it is missing."""
    try:
        fsspec = importlib.import_module("fsspec")
        system, path = fsspec.core.url_to_fs(location)
    except ImportError as error:
        library = _LIBRARIES.get(location.partition("://")[0], "fsspec>=2024.2")
        raise DeviceNotFound(
            f"{location}: the library for this kind of address is not installed ({error}); run {install_command(library)}"
        ) from error
    except ValueError as error:
        raise DeviceNotFound(
            f"{location}: {error}; use a local path or an address such as s3://bucket/folder"
        ) from error
    return system, path


@contextmanager
def reaching(location: str) -> Iterator[None]:
    """Raises DeviceNotFound, with the remedy, for an error of the library of an address. Errors of local files, and
    FileNotFoundError, are passed on."""
    try:
        yield
    except (DriverError, ValueError):  # of a damaged table too
        raise
    except Exception as error:  # these libraries have no class of errors in common
        if isinstance(error, FileNotFoundError) or (isinstance(error, OSError) and error.filename is not None):
            raise
        cause = str(error) or type(error).__name__
        raise DeviceNotFound(
            f"{location}: cannot be reached ({cause}); check the address, the access to it, and the network"
        ) from error


def find_logs(location: str, on_unread: Callable[[str], None]) -> list[StoredFile]:
    """The logs at a location: a file, a folder with everything below it, or a pattern with *, ? or [ of such files and
    folders. on_unread takes the text on a file or folder that cannot be read. Raises DeviceNotFound where there is none."""
    found = list(_remote_logs(location) if is_url(location) else _local_logs(location, on_unread))
    if not found:
        raise DeviceNotFound(f"{location}: {_why_none(location)}")
    for file in found:
        utf8_name(file.location)
    return sorted(found)


def _why_none(location: str) -> str:
    """Why there is no log at a location, with the remedy."""
    path = Path(location)
    if not is_url(location) and path.exists() and not path.is_dir():
        return "a pipe, socket or device; save its content as a file"
    return "no log (*.mcap) found; check the path and its permissions"


def utf8_name(location: str) -> str:
    """The location. Raises ValueError where it is not UTF-8, as the texts of a table are."""
    try:
        location.encode()
    except UnicodeEncodeError as error:
        raise ValueError(
            f"{location}: this name is not UTF-8, which the tables need; rename the file or folder"
        ) from error
    return location


def is_result(location: str, output: str) -> bool:
    """Whether a log was written by a run into the dataset `output`. Both are absolute paths or URLs."""
    base = output.rstrip("/")
    return location.startswith((f"{base}/{LOGS}/vehicle=", f"{base}/{UNFINISHED}/"))


def _local_logs(location: str, on_unread: Callable[[str], None]) -> Iterator[StoredFile]:
    path = Path(location)
    matches = [path]
    if not path.exists():
        matches = [Path(p) for p in glob.glob(location, recursive=True)] if _GLOB_CHARACTERS & set(location) else []
    paths: dict[Path, None] = {}  # each once: "**" matches a folder and what is in it
    for match in matches:
        paths.update(dict.fromkeys(_logs_below(match, on_unread) if match.is_dir() else [match]))
    for found in paths:
        try:
            size = regular(found).stat().st_size
        except OSError as error:  # a link to a disk that is not mounted, a folder that may not be searched, a pipe
            on_unread(f"{found}: cannot be read ({error.strerror}): it is left out")
        else:
            if found.is_file():
                yield StoredFile(str(found.resolve()), size)


def _logs_below(folder: Path, on_unread: Callable[[str], None]) -> list[Path]:
    def left_out(error: OSError) -> None:
        on_unread(
            f"{error.filename}: cannot be read ({error.strerror}): logs in it are left out; check its permissions"
        )

    found_in = ((Path(below), names) for below, _, names in os.walk(folder, onerror=left_out))
    return [below / name for below, names in found_in for name in names if _is_log(name)]


def _is_log(name: str) -> bool:
    return any(fnmatch.fnmatch(name, pattern) for pattern in LOG_NAMES)


def _remote_logs(location: str) -> Iterator[StoredFile]:
    system, path = file_system(location)
    try:
        with reaching(location):
            if _GLOB_CHARACTERS & set(path):
                listed = system.glob(path, detail=True)
            elif system.isdir(path):
                listed = system.find(path, detail=True)
            else:
                listed = {path: system.info(path)}
    except FileNotFoundError:
        return
    for name, info in listed.items():
        if info["type"] == "file" and (_is_log(name) or name == path):
            if info["size"] is None:  # by it a changed log is recognised
                raise DeviceNotFound(
                    f"{location}: the size of this file is not known, as that of a page; give the address of a log, or copy the "
                    "logs to this computer"
                )
            yield StoredFile(system.unstrip_protocol(name), int(info["size"]))


@contextmanager
def local_copy(file: StoredFile, folder: Path) -> Iterator[Path]:
    """A path to read a file from: its own, or that of a copy in `folder`, which is deleted afterwards."""
    if not is_url(file.location):
        yield Path(file.location)
        return
    system, path = file_system(file.location)
    copy = folder / file.name
    try:
        with reaching(file.location):
            system.get_file(path, str(copy))
        yield copy
    finally:
        copy.unlink(missing_ok=True)


def publish(temporary: Path, destination: str) -> None:
    """Moves a complete local file to its destination in one step: another process sees all of it or nothing. Object
    stores show an object once its upload is complete."""
    with temporary.open("rb") as stream:
        os.fsync(stream.fileno())
    if not is_url(destination):
        os.replace(temporary, destination)
        return
    system, path = file_system(destination)
    with reaching(destination):
        system.put_file(str(temporary), path)
    temporary.unlink()
