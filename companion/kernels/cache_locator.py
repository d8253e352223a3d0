"""Tells numba in which folder the compiled kernels of a source file are.

numba's own locators name a folder by the path of the source file and a kernel by its line: a second installation of the
same sources, or an edited comment, would compile kernels again. numba imports the class that the variable
NUMBA_CACHE_LOCATOR_CLASSES names; `companion.kernels.jit_cache` sets it."""

from __future__ import annotations

import os
from pathlib import Path

from numba import config
from numba.core.caching import UserProvidedCacheLocator

from .jit_cache import kernel_folder


class SourceCacheLocator(UserProvidedCacheLocator):  # type: ignore[misc]
    """One folder per module and state of its code below NUMBA_CACHE_DIR."""

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
