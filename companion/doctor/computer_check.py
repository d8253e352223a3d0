"""Checks the companion computer: free disk space for logs, and the compiled kernels."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ..config.loader import Config
from ..config.service import RecordParams
from ..diagnostic import DiagnosticCode
from ..kernels.compilation import cache_warning
from ..kernels.run_kernels import run_kernels
from ..kernels.warmup import ensure_compiled
from ..log.current_file import begin_bytes
from ..log.log_directory import free_bytes
from ..paths import FolderError, folders
from .finding import Finding

GROUP: Final = "extractor"
"""Kernels that each frame needs."""


def computer_findings(config: Config) -> Iterator[Finding]:
    """The log directory, the kernel cache and the kernels, which are compiled where they are not."""
    record = config.record
    if record.record == "off":
        yield Finding("log", True, "recording is off")
    else:
        try:
            folder = record.place(Path() if record.folder else folders().state)
        except FolderError as error:
            yield Finding("log", False, str(error), DiagnosticCode.LOG_NOT_WRITABLE)
        else:
            yield _log_finding(folder, record)
    yield from _kernel_findings()


def _kernel_findings() -> Iterator[Finding]:
    if warning := cache_warning((GROUP,)):
        yield Finding("kernels", False, warning, DiagnosticCode.KERNELS_NOT_COMPILED)
        return
    if deleted := ensure_compiled(GROUP):
        text = f"{deleted} damaged files were deleted and compiled again"
        yield Finding("kernel cache", False, text, DiagnosticCode.KERNEL_CACHE_DAMAGED)
    begun_s = time.process_time()  # processor time: independent of the load by other programs
    run_kernels((GROUP,))
    yield Finding("kernels", True, f"compiled; loaded in {time.process_time() - begun_s:.1f} s")


def _log_finding(folder: Path, record: RecordParams) -> Finding:
    existing = folder
    while not os.path.lexists(existing):
        existing = existing.parent
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        text = f"{folder} cannot be written by this user; set another [record] folder"
        return Finding("log", False, text, DiagnosticCode.LOG_NOT_WRITABLE)
    free_mb = free_bytes(existing) / 1e6
    needed_mb = record.least_free_mb + begin_bytes(record) / 1e6
    if free_mb < needed_mb:
        text = f"{free_mb:.0f} MB free for {folder}; nothing is recorded with less than {needed_mb:.0f} MB; free disk space"
        return Finding("log", False, text, DiagnosticCode.DISK_LOW)
    return Finding("log", True, f"{folder}, {free_mb / 1000:.1f} GB free")
