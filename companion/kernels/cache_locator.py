"""Where numba stores compiled kernels: by module and by content, so that every installation of a version shares them.

numba's own locators name a directory by the path of the source file, and until 0.67 compare its modification time: a
second installation of the same sources would compile everything again. numba imports the class that the variable
NUMBA_CACHE_LOCATOR_CLASSES names; `companion.kernels.jit_cache` sets it."""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path

from numba.core.caching import UserProvidedCacheLocator

from . import jit_cache


class SourceCacheLocator(UserProvidedCacheLocator):  # type: ignore[misc]
    """Below NUMBA_CACHE_DIR one directory per package, such as `core.stages`; fresh while the source's content is equal.

    Modules outside of this software's root keep the directories that numba gives them."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """The directory for a source file, relative to NUMBA_CACHE_DIR."""
        path = Path(os.path.abspath(py_file))
        if path.is_relative_to(jit_cache.ROOT):
            return jit_cache.cache_subfolder(path.relative_to(jit_cache.ROOT))
        return str(super().get_suitable_cache_subpath(py_file))

    def __init__(self, py_func: object, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._source = py_file

    def get_source_stamp(self) -> str:
        """SHA-256 of the source file."""
        return _hash_of(self._source)


@functools.cache
def _hash_of(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
