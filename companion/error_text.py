"""The text of an error for the user."""

from __future__ import annotations

from pathlib import Path


def error_text(error: Exception, output: Path | str | None = None) -> str:
    """The message of an error. For errors of the operating system: the file and what to check. output: of the command; it is
    named where the error names no file."""
    if isinstance(error, FileExistsError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; give another name"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check the path, its permissions and the free space"
    if isinstance(error, OSError):
        text = f"{'' if output is None else f'{output}: '}{error.strerror or error} while writing; check the free space"
        part = Path(f"{output}.active")
        if output is None or not part.exists():
            return text
        return f"{text}. The log that was begun is kept as {part} (`companion recover` reads it)"
    return str(error)
