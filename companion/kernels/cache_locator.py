"""Tells numba in which folder the compiled kernels of a source file are.

numba's own locators name a folder by the path of the source file and a kernel by its line: a second installation of the
same sources, or an edited comment, would compile kernels again. numba imports the class that the variable
NUMBA_CACHE_LOCATOR_CLASSES names; `companion.kernels.jit_cache` sets it.

The folder is locked while numba saves a kernel, see `module_folder`."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Final

from numba import config
from numba.core.caching import UserProvidedCacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.event import Event, Listener, register

from .jit_cache import kernel_folder
from .module_folder import lock_folder


class SourceCacheLocator(UserProvidedCacheLocator):  # type: ignore[misc]
    """One folder per module and state of its code below NUMBA_CACHE_DIR."""

    def ensure_cache_path(self) -> None:
        """Makes the folder; locks it if numba is compiling, since it calls this immediately before it saves a kernel.

        Raises OSError if the folder cannot be written."""
        super().ensure_cache_path()
        if global_compiler_lock.is_locked():  # by this thread
            _save_lock.take(self.get_cache_path())

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Returns the folder for a source file, relative to NUMBA_CACHE_DIR."""
        return kernel_folder(Path(os.path.abspath(py_file)), Path(config.CACHE_DIR))

    def get_source_stamp(self) -> str:
        """Returns what numba compares to find out if a kernel is up to date: nothing, since the folder is named by the
        code."""
        return ""

    def get_disambiguator(self) -> str:
        """Returns the part of a file name that numba fills with the line number, which an edit above a kernel changes.

        Functions of one module have different names, so none is needed."""
        return "0"


class _SaveLock(Listener):  # type: ignore[misc]
    """The lock of the folder in which this thread saves a kernel. It ends when numba releases its compiler lock, which
    is the next step after the kernel is saved."""

    def __init__(self) -> None:
        self._held = threading.local()

    def take(self, folder: str) -> None:
        """Waits until no other process changes or copies the kernels in this folder. Raises OSError."""
        self._release()
        self._held.descriptor = lock_folder(Path(folder))

    def on_start(self, event: Event) -> None:
        """Does nothing."""

    def on_end(self, event: Event) -> None:
        """Ends the lock of this thread."""
        self._release()

    def _release(self) -> None:
        descriptor = vars(self._held).pop("descriptor", None)
        if descriptor is not None:
            os.close(descriptor)


_save_lock: Final = _SaveLock()
register("numba:compiler_lock", _save_lock)
