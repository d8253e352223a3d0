"""The cache of compiled kernels: where it is, what is in it, whether it can be written, and repair of damaged files."""

from __future__ import annotations

import contextlib
import logging
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from .child_process import WarmupError
from .jit_cache import COMPLETE, VARIABLE, base_of, is_temporary_copy, unwritable_bases
from .manifest import CACHED, MANIFEST, damaged_kernels, delete_kernels, write_manifest
from .processor import processor
from .run_kernels import MODES

log = logging.getLogger("companion")


def cache_folders() -> list[Path]:
    """Returns the directories of numba's cache for these sources.

    They are NUMBA_CACHE_DIR as set by jit_cache; otherwise (numba imported before this package) the directories beside
    the sources and in the user's cache."""
    named = os.environ.get(VARIABLE)
    if named:
        return [Path(named)]
    root = Path(__file__).resolve().parents[2]
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "numba"
    return [root / "core" / "__pycache__", root / "drivers" / "__pycache__", user]


def cached_files(folders: list[Path]) -> Iterator[Path]:
    for folder in folders:
        for pattern in CACHED:
            yield from folder.rglob(pattern)


def delete_all(folders: list[Path]) -> int:
    files = list(cached_files(folders))
    for file in files:
        file.unlink(missing_ok=True)
    return len(files)


def cache_warning(modes: Sequence[str]) -> str:
    """Returns a warning with a remedy if kernels of these groups are missing and cannot be stored, otherwise "".

    Each process would compile its own kernels then."""
    folder = cache_folders()[0]
    missing = incomplete_modes(folder, modes)
    if not is_temporary_copy(folder) or not missing:
        return ""
    places = " or ".join(map(str, unwritable_bases())) or "their cache"
    return (
        f"compiled kernels cannot be stored in {places}, and those of {', '.join(missing)} are missing: each command compiles "
        f"them again, which takes minutes; set {VARIABLE} to a folder that this user may write"
    )


def check_cache_place() -> None:
    """Raises WarmupError if the cache directory cannot be written: numba's own error names neither the directory nor
    a remedy."""
    named = os.environ.get(VARIABLE)
    if not named:
        return
    if is_temporary_copy(Path(named)) and (warning := cache_warning(MODES)):
        raise WarmupError(warning)
    named = str(base_of(Path(named)))  # the value that the user has set
    try:
        Path(named).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=named):
            pass
    except OSError as error:
        raise WarmupError(
            f"{VARIABLE} = {named} cannot be written ({error.strerror}); "
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
