"""Progress of the compilation of kernels, and a line that shows it."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from .jit_cache import ROOT
from .source_state import cache_subfolder, kernel_files

_DECORATED: Final = re.compile(r"^@(?:_?kernel|kernel_ieee|inner|inner_inline|inner_ieee|inline_ieee)$", re.MULTILINE)
"""The decorators of core/jit.py and of drivers/simulation/ray_caster.py."""
LOG_EVERY_S: Final = 10.0

Report = Callable[[int, int], None]
"""Takes the number of compiled kernels and that of all."""


class CompiledCount:
    """Counts numba's index files, of which each kernel has one."""

    def __init__(self, folder: Path, groups: Sequence[str]) -> None:
        sources = [path.relative_to(ROOT) for path in kernel_files(ROOT) if _group_of(path.relative_to(ROOT)) in groups]
        self.total = sum(len(_DECORATED.findall((ROOT / path).read_text(encoding="utf-8"))) for path in sources)
        self._modules: dict[Path, set[str]] = {}
        for path in sources:
            self._modules.setdefault(folder / cache_subfolder(path), set()).add(path.stem)

    def done(self) -> int:
        """Returns the number of compiled kernels."""
        return min(self.total, sum(_indices(folder, modules) for folder, modules in self._modules.items()))


def _indices(folder: Path, modules: set[str]) -> int:
    """Returns the index files of these modules, such as `level.pool_columns-34.py311.nbi`."""
    try:
        names = os.listdir(folder)
    except OSError:
        return 0
    return sum(name.endswith(".nbi") and name.partition(".")[0] in modules for name in names)


def _group_of(source: Path) -> str:
    if source.parts[0] == "drivers":
        return "simulated"
    groups = ("world", "tracking", "sharing")
    return source.parts[1] if source.parts[0] == "core" and source.parts[1] in groups else "extractor"


def progress_text(done: int, total: int) -> str:
    """Returns the line that every command shows."""
    return f"compiling kernels {done} of {total}, once for this version"


class ProgressLine:
    """Shows the progress on stderr: on a terminal one line that is rewritten, otherwise a line every LOG_EVERY_S."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._next_s = 0.0
        self._shown = ""

    def __call__(self, done: int, total: int) -> None:
        text = progress_text(done, total)
        if self._terminal and text != self._shown:
            sys.stderr.write(f"\r{text}")
        elif not self._terminal and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + LOG_EVERY_S
            sys.stderr.write(text + "\n")
        sys.stderr.flush()
        self._shown = text

    def end(self) -> None:
        """Ends the rewritten line."""
        if self._terminal and self._shown:
            sys.stderr.write("\n")
            sys.stderr.flush()
