"""The text of an error for the user."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Final

_NO_SPACE: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_TOO_LARGE: Final = (
    "its disk, or `ulimit -f`, allows no larger file; give a path on another disk (FAT32 takes 4 GB a file at most)"
)


def is_no_space(error: BaseException | None) -> bool:
    """Whether a file could not be written for lack of space: on the disk, of a quota, or of a limit of the file's size."""
    return isinstance(error, OSError) and error.errno in _NO_SPACE


def error_text(error: Exception, output: Path | str | None = None) -> str:
    """The message of an error. For errors of the operating system: the file and what to check. output: of the command; it is
    named where the error names no file."""
    if isinstance(error, FileExistsError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; give another name"
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return f"{error.filename or output or 'the output'}: {error.strerror}: {_TOO_LARGE}"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check the path, its permissions and the free space"
    if isinstance(error, OSError):
        text = f"{'' if output is None else f'{output}: '}{error.strerror or error} while writing; check the free space"
        if output is not None and error.errno in _NO_SPACE:
            text += ", or give -o a path on another disk"
        part = Path(f"{output}.active")
        if output is None or not part.exists():
            return text
        return f"{text}. The log that was begun is kept as {part} (`companion recover` reads it)"
    return str(error)
