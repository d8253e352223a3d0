"""Progress of the compilation of kernels, and a line that shows it."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from .jit_cache import ROOT, kernel_folder
from .source_state import kernel_files

_DECORATED: Final = re.compile(r"^@(?:_?kernel|kernel_ieee|inner|inner_inline|inner_ieee|inline_ieee)$", re.MULTILINE)
"""The decorators of core/jit.py and of drivers/simulation/ray_caster.py."""
LOG_EVERY_S: Final = 10.0

Report = Callable[[int, int], None]
"""Takes the number of compiled kernels and that of all."""


class CompiledCount:
    """Counts the compiled kernels of groups: each has one index file of numba.

    Attributes:
        total: the number of all kernels of the groups.
        folders: where they are."""

    def __init__(self, folder: Path, groups: Sequence[str]) -> None:
        sources = [path for path in kernel_files(ROOT) if _group_of(path.relative_to(ROOT)) in groups]
        self.total = sum(len(_DECORATED.findall(path.read_text(encoding="utf-8"))) for path in sources)
        self.folders = [folder / kernel_folder(path, folder) for path in sources]

    def done(self) -> int:
        """Returns the number of compiled kernels."""
        return min(self.total, sum(len(list(folder.glob("*.nbi"))) for folder in self.folders))


def _group_of(source: Path) -> str:
    if source.parts[0] == "drivers":
        return "simulated"
    groups = ("world", "tracking", "sharing")
    return source.parts[1] if source.parts[0] == "core" and source.parts[1] in groups else "extractor"


def progress_text(done: int, total: int) -> str:
    """Returns the line that every command shows."""
    if done >= total:
        return "loading kernels"
    return f"compiling kernels {done} of {total}, once for this version"


class ProgressLine:
    """Shows the progress on stderr, as a context: on a terminal one line that is rewritten, otherwise a line every
    LOG_EVERY_S."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._next_s = 0.0
        self._shown = ""

    def __enter__(self) -> ProgressLine:
        return self

    def __call__(self, done: int, total: int) -> None:
        text = progress_text(done, total)
        if self._terminal and text != self._shown:
            sys.stderr.write(f"\r{text.ljust(len(self._shown))}")
        elif not self._terminal and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + LOG_EVERY_S
            sys.stderr.write(text + "\n")
        sys.stderr.flush()
        self._shown = text

    def __exit__(self, *exception: object) -> None:
        """Ends the rewritten line."""
        if self._terminal and self._shown:
            sys.stderr.write("\n")
            sys.stderr.flush()
