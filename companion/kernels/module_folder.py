"""The folder of a module's kernels: the files of numba, and the lock of processes that change or copy them.

numba saves a kernel in three steps: it reads the index, which numbers the files of code by their arguments, replaces
it, and writes the file. In two cases an index would name the code of other arguments: if two processes save one kernel
at the same time, and if files are copied while another process deletes and compiles them, which numbers them anew.

A process that only loads a kernel takes no lock; numba calls nothing of the locator there. It reads the index and at once
the file of code. Each of both is whole, since numba replaces files by renaming; a file that was deleted meanwhile counts as
missing, and the process compiles this kernel itself. It would get the code of other arguments only if it were stopped between
the two reads for the seconds in which another process deletes and compiles the kernels of the folder, which happens only after
damage was found."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path


def lock_folder(folder: Path) -> int:
    """Waits until no other process changes or copies the kernels in this folder. Raises OSError.

    Returns a file descriptor: the lock ends when it is closed."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    return descriptor


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    descriptor = lock_folder(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def kernels_in(state: Path, module: Path = Path("*")) -> list[Path]:
    """Returns numba's index and code files in the folder of a module, or of each. state: directory of the folders."""
    return sorted(state.glob(f"{module}/*.nb[ic]"))


def place_kernels(source: Path, target: Path, place: Callable[[Path, Path], object]) -> None:
    """Makes the folder of a module with the kernels of another one. Raises OSError.

    place: puts the file of the first path, or a link to it, at the second one."""
    target.mkdir()
    with _locked(source):
        for file in kernels_in(source.parent, Path(source.name)):
            place(file, target / file.name)


def delete_kernels(state: Path, module: Path = Path("*")) -> int:
    """Deletes the files of `kernels_in` and returns their number. The folders stay: other processes write there. Raises
    OSError."""
    deleted = 0
    for folder in state.glob(f"{module}/"):
        with _locked(folder):
            for file in kernels_in(state, Path(folder.name)):
                file.unlink(missing_ok=True)
                deleted += 1
    return deleted
