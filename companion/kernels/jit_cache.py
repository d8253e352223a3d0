"""Keeps compiled kernels in one directory per state of the sources, made as a whole before numba uses it.

numba checks only if a cached kernel's own file has changed. A kernel contains the machine code of the kernels that it
calls in other files, and would keep the old code after a change there. Therefore the directory of a state is named by
a hash of all sources, of numba's version and of the processor (`source_key`). In it each module has a folder that is
named by the import closure of the module (`kernel_folder`).

A missing directory is filled at another place and then renamed: one that exists is whole. It is filled with

- copies of the kernels of the same state, if a directory is complete (has all kernels of a group): that of the
  installation (`SHARED`), or one that cannot be written;
- otherwise links to the folders of older states of modules with the same import closure, so that a change compiles only
  the kernels of the changed file and of the files that import it.

The folder of a module is taken from one directory and not merged with others: numba finds machine code by the name
of its file, and would run that of other arguments.

numba writes to the directory from which it reads, and refuses to import a module with kernels where it cannot write.
If no directory can be written, or filled as on a full disk, a temporary one with links is used.

numba reads its variables when it is imported: `companion/__init__.py` calls `use_own_cache` first."""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from .manifest import Manifest, read_manifest, write_manifest
from .module_folder import place_kernels
from .processor import use_level
from .source_state import Closure, content_hash, import_closures, module_name, source_key, text_hash
from .state_folders import base_of, hold, is_state, is_trusted, is_writable, make_temporary, older_states, prune

VARIABLE: Final = "NUMBA_CACHE_DIR"
LOCATOR_VARIABLE: Final = "NUMBA_CACHE_LOCATOR_CLASSES"
LOCATOR: Final = "companion.kernels.cache_locator.SourceCacheLocator"
ROOT: Final = Path(__file__).resolve().parents[2]
SHARED: Final = Path(sys.prefix) / "share" / "osape-companion" / "kernels"
"""Kernels that were compiled with the installation, for all users of this environment."""
_unwritable: list[Path] = []
"""The directories that this process tried and cannot use, if none can be used."""


def use_own_cache() -> Path | None:
    """Sets NUMBA_CACHE_DIR to the directory of the present state of the sources, and numba's processor to a level.

    The directory is below the previous value of NUMBA_CACHE_DIR, otherwise below the user's cache, otherwise below a
    temporary directory, which child processes use too.

    Returns:
        The directory; None: it was not changed, because numba is already imported or not even a temporary directory
        can be made: see `no_place_text`."""
    if "numba" in sys.modules:
        return None
    use_level()
    named = os.environ.get(VARIABLE)
    bases = [base_of(Path(named))] if named else _usual_bases()
    name = f"kernels-{source_key(ROOT)}"
    complete = next((f for base in (*bases, SHARED) if _is_complete(f := base / name)), None)
    folder = next((f for base in bases if _is_ready(f := base / name, complete)), None)
    if folder is None:
        _unwritable[:] = bases
        folder = _temporary(name, complete)
    if folder is not None:
        os.environ |= {VARIABLE: str(folder), LOCATOR_VARIABLE: LOCATOR}
    return folder


def _usual_bases() -> list[Path]:
    """Returns the user's cache and, as a second choice, the directory beside the sources, as numba does."""
    beside = ROOT / "core" / "__pycache__"
    home = Path(os.path.expanduser("~"))
    named = os.environ.get("XDG_CACHE_HOME")
    if not named and home in (Path("~"), Path("/"), Path()):  # a service may have no home directory
        return [beside]
    return [(Path(named) if named else home / ".cache") / "osape-companion", beside]


def _is_complete(folder: Path) -> bool:
    manifest = read_manifest(folder) if is_trusted(folder) else None
    return manifest is not None and len(manifest.groups) > 0


def _is_ready(folder: Path, complete: Path | None) -> bool:
    """Makes the directory of a state if it is missing. Returns False if it cannot be written or filled."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        if not folder.is_dir():
            _make(folder, complete)
        if not (is_trusted(folder) and is_writable(folder)):
            return False
        hold(folder)
        prune(folder)
    except OSError:
        return False
    return True


def _make(folder: Path, complete: Path | None) -> None:
    """Makes the directory of a state as a whole, unless another process does. Raises OSError."""
    part = make_temporary(folder.parent) / folder.name
    try:
        if complete is not None:
            _fill(part, complete, shutil.copy2)
        else:
            _fill_from_older(part, older_states(folder))
        part.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise
    finally:
        shutil.rmtree(part.parent, ignore_errors=True)


def _temporary(name: str, complete: Path | None) -> Path | None:
    """Returns a temporary directory with symbolic links to the kernels of `complete`; None if it cannot be made.

    That of a service is below its RUNTIME_DIRECTORY, which is in memory, if that can be written."""
    for place in (os.environ.get("RUNTIME_DIRECTORY"), None):
        with contextlib.suppress(OSError):
            folder = make_temporary(Path(place or tempfile.gettempdir())) / name
            _fill(folder, complete, os.symlink)
            return folder
    return None


def _fill(folder: Path, complete: Path | None, place: Callable[[Path, Path], object]) -> None:
    """Makes a directory with the kernels of another one of the same state. Raises OSError.

    place: puts the file of the first path, or a link to it, at the second one."""
    folder.mkdir()
    manifest = (read_manifest(complete) if complete else None) or Manifest(import_closures(ROOT))
    for module in {Path(name).parent for name in manifest.files}:
        if complete and (complete / module).is_dir():
            place_kernels(complete / module, folder / module, place)
    write_manifest(folder, manifest)


def _fill_from_older(folder: Path, older: list[Path]) -> None:
    """Makes a directory with hard links to the kernels of those modules whose import closure has not changed. Raises
    OSError.

    numba replaces its files by renaming, so that an older directory never changes. Kernels of a module that cannot be
    linked are compiled again."""
    folder.mkdir()
    closures = import_closures(ROOT)
    missing = {_folder_name(module, key) for module, (key, _) in closures.items()}
    files: dict[str, tuple[int, str]] = {}
    for other in older:
        # before the files are linked: one that another process replaces meanwhile is newer than its entry, so not damaged
        entries = (read_manifest(other) or Manifest()).files
        found = {name for name in missing if (other / name).is_dir()}
        for name in found:
            try:
                place_kernels(other / name, folder / name, os.link)
            except OSError:
                shutil.rmtree(folder / name, ignore_errors=True)
        files |= {path: entry for path, entry in entries.items() if (folder / path).exists()}
        missing -= found
    write_manifest(folder, Manifest(closures, files=files))


@functools.cache
def kernel_folder(source: Path, state: Path) -> str:
    """Returns the folder of the kernels of a source file in the directory of a state, named by what they are made of.

    It is the import closure of the file, as the directory has it. For a file that was changed since the directory was
    made, and for one outside of core, it is the content; outside of this software also the path."""
    content = content_hash(source)
    if not source.is_relative_to(ROOT):
        return _folder_name(source.stem, text_hash(f"{source} {content}"))
    module = module_name(source.relative_to(ROOT))
    key, known = _closures_in(state).get(module, ("", ""))
    return _folder_name(module, key if known == content else content)


def _folder_name(module: str, key: str) -> str:
    return f"{module}-{key}"


@functools.cache
def _closures_in(state: Path) -> dict[str, Closure]:
    return (read_manifest(state) or Manifest()).closures


def state_in_use() -> Path | None:
    """Returns the directory that `use_own_cache` has set; None without one, as where numba was imported first."""
    folder = Path(os.environ.get(VARIABLE, ""))
    return folder if is_state(folder) else None


def unwritable_text() -> str:
    """Returns which directories cannot be used, if a temporary one or none is used, otherwise ""."""
    places = " or ".join(map(str, _unwritable))
    return f"compiled kernels cannot be stored in {places}" if places else ""


def no_place_text() -> str:
    """Returns what to do if kernels can be stored nowhere, so that numba refuses to import them, otherwise ""."""
    if not _unwritable or state_in_use() is not None:
        return ""
    return (
        f"{unwritable_text()}, and no temporary folder can be made: set {VARIABLE} to a folder that this user may write"
    )
