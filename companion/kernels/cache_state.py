"""The cache of compiled kernels: where it is, what is in it, whether it can be written, and repair of damaged files."""

from __future__ import annotations

import contextlib
import logging
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .child_process import WarmupError
from .jit_cache import COMPLETE, VARIABLE, base_of, is_temporary_copy, no_place_text, unwritable_bases
from .manifest import CACHED, MANIFEST, damaged_kernels, delete_kernels, write_manifest
from .processor import processor
from .run_kernels import MODES

log = logging.getLogger("companion")


def cache_folder() -> Path:
    """Returns the directory that `use_own_cache` has set. Raises WarmupError without one."""
    named = os.environ.get(VARIABLE)
    if not named:
        raise WarmupError(
            no_place_text() or f"{VARIABLE} is not set, since numba was imported first: import companion before numba"
        )
    return Path(named)


def cached_files(folder: Path) -> list[Path]:
    return [file for pattern in CACHED for file in folder.rglob(pattern)]


def delete_all(folder: Path) -> int:
    """Deletes all kernels. Returns the number of files."""
    files = cached_files(folder)
    for file in files:
        file.unlink(missing_ok=True)
    return len(files)


def cache_warning(modes: Sequence[str]) -> str:
    """Returns a warning with a remedy if kernels of these groups are missing and cannot be stored, otherwise "".

    Each process would compile its own kernels then."""
    named = os.environ.get(VARIABLE, "")
    missing = incomplete_modes(Path(named), modes)
    if not is_temporary_copy(Path(named)) or not missing:
        return ""
    places = " or ".join(map(str, unwritable_bases())) or "their cache"
    return (
        f"compiled kernels cannot be stored in {places}, and those of {', '.join(missing)} are missing: each command compiles "
        f"them again, which takes minutes; set {VARIABLE} to a folder that this user may write"
    )


def check_cache_place() -> None:
    """Raises WarmupError if the cache directory cannot be written: numba's own error names neither the directory nor
    a remedy."""
    folder = cache_folder()
    if is_temporary_copy(folder) and (warning := cache_warning(MODES)):
        raise WarmupError(warning)
    base = base_of(folder)  # the value that the user has set
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            pass
    except OSError as error:
        raise WarmupError(
            f"{VARIABLE} = {base} cannot be written ({error.strerror}); "
            "name a directory that this user may write, or unset it"
        ) from error


def discard_damaged() -> int:
    """Deletes the kernels that differ from the manifest, and the marks that all are cached.

    A cache that cannot be written is left unchanged. Returns the number of deleted files."""
    named = os.environ.get(VARIABLE)
    damaged = damaged_kernels(Path(named)) if named else []
    if not named or not damaged:
        return 0
    try:
        for mode in MODES:
            (Path(named) / (COMPLETE + mode)).unlink(missing_ok=True)
        deleted = delete_kernels(damaged)
        (Path(named) / MANIFEST).unlink(missing_ok=True)
        write_manifest(Path(named))
    except OSError as error:
        log.warning("compiled kernels in %s are damaged and cannot be deleted (%s)", named, error.strerror)
        return 0
    return deleted


def incomplete_modes(folder: Path, modes: Sequence[str]) -> list[str]:
    """Returns the groups that are not marked as compiled for this processor."""
    if not folder.is_dir():
        return []
    here = processor()
    return [mode for mode in modes if _marked_for(folder / (COMPLETE + mode)) != here]


def _marked_for(mark: Path) -> str | None:
    try:
        return mark.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def mark_complete(*modes: str) -> None:
    named = os.environ.get(VARIABLE)
    if named:
        with contextlib.suppress(OSError):
            write_manifest(Path(named))  # first: it brings the kernels to the disk
            for mode in modes:
                (Path(named) / (COMPLETE + mode)).write_text(processor(), encoding="utf-8")
