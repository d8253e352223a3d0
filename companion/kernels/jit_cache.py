"""Keeps compiled kernels in one directory per state of the sources.

numba checks only if a cached kernel's own file has changed. A kernel contains the machine code of the kernels that it
calls in other files, and would keep the old code after a change there. Each state of the sources therefore has its own
directory, named by a hash of all sources; a few old ones are kept. A new directory starts with links to the kernels of
older ones whose import closure is unchanged (see `seed`), so that a change recompiles only the kernels of the changed
file and of the files that import it. Docstrings, comments and the position of a function in its file do not count.

Kernels are compiled for a level of processors (`processor`); each level has its own directories. An installation may
contain kernels of several levels, in `share/osape-companion/kernels` of its environment. A new directory starts with
those of its level, too. They are trusted like the code of the installation.

numba writes to the directory from which it reads, and refuses to import a module with kernels where it cannot write.
Kernels of a directory that cannot be written are therefore linked into a temporary one.

numba reads its variables when it is imported: `companion/__init__.py` calls `use_own_cache` first."""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from .manifest import ENDING, copy_entries, kernels_in
from .processor import use_level
from .source_state import Closure, content_hash, import_closures, module_name, source_key

VARIABLE: Final = "NUMBA_CACHE_DIR"
LOCATOR_VARIABLE: Final = "NUMBA_CACHE_LOCATOR_CLASSES"
LOCATOR: Final = "companion.kernels.cache_locator.SourceCacheLocator"
ROOT: Final = Path(__file__).resolve().parents[2]
SHARED: Final = Path(sys.prefix) / "share" / "osape-companion" / "kernels"
"""Kernels that were compiled with the installation, for all users of this environment."""
COMPLETE: Final = "complete-"
"""Prefix of a file beside the cached kernels: all kernels of a group are cached for the processor that it names."""
MAX_CACHES: Final = 6
"""Number of directories that are kept, including the one in use."""
_PREFIX: Final = "kernels-"
_KEYED: Final = re.compile(re.escape(_PREFIX) + "[0-9a-f]{16}")
_LINKED: Final = "osape-companion-kernels-"
_LOCK: Final = "in-use"
_CLOSURES: Final = "closures.json"
"""File in each directory: of each module the hashes of its import closure and of its content when it was created."""
Link = Callable[[Path, Path], None]
_held: list[int] = []
"""Open files whose locks mark the directory as in use; the system closes them with the process."""
_unwritable: list[Path] = []
"""The directories that this process tried and cannot write."""


def use_own_cache() -> Path | None:
    """Sets NUMBA_CACHE_DIR to the directory of the present state of the sources, and numba's processor to a level.

    The directory is below the previous value of NUMBA_CACHE_DIR, otherwise below the user's cache. If none can be
    written, it is a temporary one, with links to the kernels of a directory that has all of a group, if there is one;
    so too if there is one and its kernels cannot be copied, as on a full disk.

    Returns:
        The directory; None: it was not changed, because numba is already imported or not even a temporary directory
        can be made."""
    if "numba" in sys.modules:
        return None
    use_level()
    named = os.environ.get(VARIABLE)
    bases = [base_of(Path(named))] if named else _usual_bases()
    key = _PREFIX + source_key(ROOT)
    source = next((base for base in (*bases, SHARED) if _is_complete(base / key)), None)
    for base in bases:
        folder = base / key
        if _open(folder) and (_is_seeded(base, folder) or source in (None, base)):
            prune(base, folder)
            return _set_variables(folder)
    copy = _temporary_copy(key, source)
    _unwritable[:] = bases
    return _set_variables(copy) if copy else None  # without one numba refuses to import kernels: see `no_place_text`


def _is_seeded(base: Path, folder: Path) -> bool:
    """Links the kernels of older directories into a new one. Returns False if that fails, as on a full disk."""
    if not (folder / _CLOSURES).exists():  # new, or the process that made it was ended meanwhile
        try:
            seed((base, SHARED), folder, ROOT)
        except OSError:
            return False
    return True


def _set_variables(folder: Path) -> Path:
    os.environ[VARIABLE] = str(folder)
    os.environ[LOCATOR_VARIABLE] = LOCATOR
    return folder


def _is_complete(folder: Path) -> bool:
    """True if a directory has all kernels of a group."""
    try:
        return _is_trusted(folder) and any(name.startswith(COMPLETE) for name in os.listdir(folder))
    except OSError:
        return False


def _is_trusted(folder: Path) -> bool:
    """False if another user has made a directory, or a link to one, in a folder that several users can write, such as
    /tmp: kernels are machine code. False also if it does not exist."""
    try:
        trusted = {os.geteuid(), 0, folder.parent.stat().st_uid}
        return {folder.lstat().st_uid, folder.stat().st_uid} <= trusted
    except OSError:
        return False


def _temporary_copy(name: str, source: Path | None) -> Path | None:
    """Returns a temporary directory with symbolic links to the kernels of `source`; None if it cannot be made.

    source: parent of the directories with kernels; None: there are no kernels to link. The directory is deleted at the
    end of this process. Child processes use it too, and write into it what they compile. That of a service is below its
    RUNTIME_DIRECTORY, which is in memory, if that can be written."""
    own = os.environ.get("RUNTIME_DIRECTORY")
    return (_copy_below(own, name, source) if own else None) or _copy_below(None, name, source)


def _copy_below(place: str | None, name: str, source: Path | None) -> Path | None:
    """Does the work of `_temporary_copy`. place: parent of the directory; None: the system's one for temporary files."""
    try:
        place = place or tempfile.gettempdir()
        _delete_left_over(Path(place))
        base = Path(tempfile.mkdtemp(prefix=f"{_LINKED}{os.getpid()}-", dir=place))
        copy = base / name
        copy.mkdir()
        if source is not None:
            seed((source,), copy, ROOT, _symbolic_link)
    except OSError:
        return None
    atexit.register(_delete_own, base, os.getpid())
    return copy


def _delete_left_over(place: Path) -> None:
    """Deletes the temporary directories of this user's processes that were killed."""
    for folder in place.glob(f"{_LINKED}*"):
        owner = folder.name.removeprefix(_LINKED).partition("-")[0]
        with contextlib.suppress(FileNotFoundError):  # another start has just deleted it
            if owner.isdecimal() and not Path("/proc", owner).exists() and folder.stat().st_uid == os.geteuid():
                shutil.rmtree(folder, ignore_errors=True)


def is_temporary_copy(folder: Path) -> bool:
    """True if a directory is the temporary one that stands in for directories that cannot be written."""
    return base_of(folder).name.startswith(_LINKED)


def _delete_own(folder: Path, owner: int) -> None:
    """Deletes a temporary directory, except in a fork of its owner, which may end before the owner."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


def unwritable_bases() -> list[Path]:
    """Returns the directories that `use_own_cache` tried, if none of them can be written, otherwise [].

    A child process returns [], since it inherits the temporary directory."""
    return list(_unwritable)


def no_place_text() -> str:
    """Returns what to do if kernels can be stored nowhere, so that numba refuses to import them, otherwise ""."""
    if not _unwritable or is_temporary_copy(Path(os.environ.get(VARIABLE, ""))):
        return ""
    places = ", ".join(map(str, _unwritable))
    return (
        f"compiled kernels cannot be stored in {places}, and no temporary folder can be made: set {VARIABLE} to a folder "
        "that this user may write"
    )


def base_of(folder: Path) -> Path:
    """Returns the parent of the per-state directories. A child process inherits the per-state directory of its
    parent."""
    return folder.parent if _KEYED.fullmatch(folder.name) else folder


def seed(bases: Sequence[Path], folder: Path, root: Path, link: Link | None = None) -> None:
    """Links the cached kernels of older directories into a new one, for each module with an unchanged import closure.

    numba replaces its files by renaming, so a link never changes the older directory. numba itself checks the
    kernel's own file.

    Args:
        bases: parents of older directories.
        folder: the new directory.
        root: root of the sources.
        link: makes a link to a file at a path; default: a hard link, or a copy if that is impossible."""
    found = [f for b in bases if b.is_dir() for f in b.iterdir() if _KEYED.fullmatch(f.name) and f != folder]
    older = [f for f in found if _is_trusted(f)]
    older.sort(key=lambda f: (f.name == folder.name, _last_use(f)), reverse=True)
    # those of the same state need not be computed, which takes a second on a fast computer
    closures = next((c for f in older if f.name == folder.name and (c := _closures_of(f))), None) or import_closures(
        root
    )
    missing = dict(closures)
    for other in older:
        there = _closures_of(other)
        same = [name for name, (key, _) in missing.items() if name in there and there[name][0] == key]
        files = {name: _link_kernels(other, folder, name, link or _link_or_copy) for name in same}
        present = [file for linked_files in files.values() for file in linked_files]
        copy_entries(other, folder, present)
        # the same state, brought along by the installation, and nothing of it is left out
        if other.name == folder.name and {str(f.relative_to(other)) for f in kernels_in(other)} <= set(present):
            for mark in other.glob(COMPLETE + "*"):
                shutil.copy2(mark, folder / mark.name)
        linked = {name for name, linked_files in files.items() if linked_files}
        missing = {name: key for name, key in missing.items() if name not in linked}
    part = folder / f"{_CLOSURES}.{os.getpid()}.part"
    part.write_text(json.dumps(closures))
    part.replace(folder / _CLOSURES)  # last: it shows that the directory is whole


def source_stamp(source: Path) -> str:
    """Returns the stamp by which numba recognises that the kernels of a source file are up to date.

    It is the import closure of the file, as the directory in use contains it. If the directory contains none, or was
    created for another content of the file, it is the content."""
    content = content_hash(source)
    closures = _closures_of(Path(os.environ.get(VARIABLE, "")))
    key, known = closures.get(module_name(source.relative_to(ROOT)), ("", ""))
    return key if known == content else content


def _closures_of(folder: Path) -> dict[str, Closure]:
    try:
        content = json.loads((folder / _CLOSURES).read_text())
        return {str(name): (str(key), str(digest)) for name, (key, digest) in content.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):  # a damaged file counts as missing
        return {}


def _link_kernels(source: Path, target: Path, module: str, link: Link) -> list[str]:
    """Links the kernels of a module into the target directory, except those that have an index there: numba would take
    the machine code for what that index names. Returns the paths of those that are in both, relative to the source
    directory."""
    package, _, stem = module.rpartition(".")
    files = [f for f in (source / package).glob(f"{stem}.*") if f.suffix in (".nbi", ".nbc")]
    if files:
        (target / package).mkdir(exist_ok=True)
    indices = {f.name for f in (target / package).glob(f"{stem}.*.nbi")}
    there = []
    # each data file before the index that refers to it
    for file in sorted(files, key=lambda f: f.suffix):
        place = target / package / file.name
        is_new = ENDING.sub(".nbi", file.name) not in indices
        if is_new:
            link(file, place)
        if is_new or _is_same(file, place):
            there.append(str(file.relative_to(source)))
    return there


def _is_same(file: Path, place: Path) -> bool:
    """True if a file is at a place, or a copy with its times."""
    try:
        there, here = file.stat(), place.stat()
    except OSError:
        return False
    return (there.st_size, there.st_mtime_ns) == (here.st_size, here.st_mtime_ns)


def _link_or_copy(file: Path, place: Path) -> None:
    """Makes a hard link, or a copy with the same times, if the system allows no link or there is another file."""
    try:
        os.link(file, place)
    except OSError:
        part = place.with_name(f"{place.name}.{os.getpid()}.part")
        try:
            shutil.copy2(file, part)
            part.replace(place)
        except OSError:
            part.unlink(missing_ok=True)
            raise


def _symbolic_link(file: Path, place: Path) -> None:
    place.symlink_to(file)


def prune(base: Path, current: Path) -> None:
    """Deletes directories of old states.

    It keeps the latest MAX_CACHES (including `current`) and those in use by a running process, and deletes nothing
    else below `base`, nor directories of other users."""
    found = [f for f in base.iterdir() if _KEYED.fullmatch(f.name) and f.is_dir() and f != current]
    others = [f for f in found if _is_trusted(f)]
    for folder in sorted(others, key=_last_use, reverse=True)[MAX_CACHES - 1 :]:
        descriptor = _lock(folder, fcntl.LOCK_EX)
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)


def _usual_bases() -> list[Path]:
    """Returns the user's cache and, as a second choice, the directory beside the sources, as numba does."""
    beside = ROOT / "core" / "__pycache__"
    home = Path(os.path.expanduser("~"))
    named = os.environ.get("XDG_CACHE_HOME")
    if not named and home in (Path("~"), Path("/"), Path()):  # a service may have no home directory
        return [beside]
    return [(Path(named) if named else home / ".cache") / "osape-companion", beside]


def _open(folder: Path) -> bool:
    """Creates the directory and marks it as used. Returns False if it cannot be written, or another user made it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not _is_trusted(folder):
            return False
        descriptor = _lock(folder, fcntl.LOCK_SH)
        if not _is_writable(folder):
            return False
        os.utime(folder)
    except OSError:
        return False
    if descriptor is not None:
        _held.append(descriptor)
    return True


def _is_writable(folder: Path) -> bool:
    """True if a directory and those in it, which another user may have made, can be written. Raises OSError."""
    return all(os.access(f, os.W_OK) for f in (folder, *(f for f in folder.iterdir() if f.is_dir())))


def _lock(folder: Path, kind: int) -> int | None:
    """Returns an open file with the lock; None if another process has a conflicting one."""
    try:
        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _last_use(folder: Path) -> int:
    try:
        return folder.stat().st_mtime_ns
    except FileNotFoundError:  # another process has just deleted it
        return 0
