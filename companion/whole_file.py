"""Writes a file completely, or leaves what was there, and replaces no file unasked."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def refuse_existing(*paths: Path, replace: bool) -> None:
    """Raises ValueError where one of the files exists and `replace` was not requested: it may be the only copy of a flight."""
    for path in paths:
        if not replace and os.path.lexists(path):
            raise ValueError(f"{path} exists; give -o another name, or --replace to replace it")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yields the path to write to, in the same folder and with the same suffix; afterwards it replaces `path`. Raises OSError,
    which names the file: it is then unchanged, as a device, which is not replaced."""
    if path.exists() and not path.is_file():
        raise FileExistsError(errno.EEXIST, "a directory or device, which is not replaced by a file", str(path))
    part = path.with_name(f".{path.stem}.part-{os.getpid()}{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        if error.errno is None:
            raise
        # the text of the system: some libraries put the number of the error into theirs
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    finally:
        with suppress(OSError):  # of the same cause, such as a folder that is a file
            part.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes, mode: int | None = None) -> None:
    """Replaces a file; text is written as UTF-8. After a power failure it is the old or the new one. mode: permissions; None:
    the usual ones. Raises OSError as `whole_file`."""
    with whole_file(path) as part, part.open("wb") as stream:
        stream.write(content.encode() if isinstance(content, str) else content)
        stream.flush()
        os.fsync(stream.fileno())  # the new name may be on the disk before the content
        if mode is not None:
            os.fchmod(stream.fileno(), mode)
