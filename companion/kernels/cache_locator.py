"""Places of compiled kernels: by module and by code, so that all installations of a version share them.

numba's own locators name a directory by the path of the source file and a kernel by its line, and until 0.67 compare
the modification time of the file: a second installation of the same sources, or an edited comment, would compile
kernels again. numba imports the class that the variable NUMBA_CACHE_LOCATOR_CLASSES names;
`companion.kernels.jit_cache` sets it."""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path

from numba.core.caching import UserProvidedCacheLocator

from . import jit_cache
from .source_state import cache_subfolder


class SourceCacheLocator(UserProvidedCacheLocator):  # type: ignore[misc]
    """One directory per package below NUMBA_CACHE_DIR, such as `core.stages`. Kernels are valid while their code is equal.

    Modules outside of this software's root keep the directories that numba gives them."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Returns the directory for a source file, relative to NUMBA_CACHE_DIR."""
        path = Path(os.path.abspath(py_file))
        if path.is_relative_to(jit_cache.ROOT):
            return cache_subfolder(path.relative_to(jit_cache.ROOT))
        return str(super().get_suitable_cache_subpath(py_file))

    def __init__(self, py_func: object, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._source = py_file

    def get_source_stamp(self) -> str:
        """Returns a hash of the code of the source file, which docstrings and comments do not affect."""
        return _stamp_of(self._source)

    def get_disambiguator(self) -> str:
        """Returns the part of a file name that numba fills with the line number, which an edit above a kernel changes.

        Functions of one module have different names, so none is needed."""
        return "0"


@functools.cache
def _stamp_of(path: str) -> str:
    source = Path(os.path.abspath(path))
    if source.is_relative_to(jit_cache.ROOT):
        return jit_cache.source_stamp(source)
    return hashlib.sha256(source.read_bytes()).hexdigest()
