"""`companion warmup`: compiles and caches kernels before a flight, and repairs a damaged cache."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..console import counted, fail, print_json, print_line, warn
from .compilation import WarmupError, cache_warning, compile_kernels
from .jit_cache import VARIABLE, no_place_text, state_in_use, unwritable_text
from .module_folder import kernels_in
from .processor import CPU_NAME, level_variables, levels, own_levels
from .progress import ProgressLine
from .run_kernels import GROUPS
from .state_folders import base_of

LEVEL_CHILD = "import sys; from companion.cli import main; sys.exit(main(['warmup', *sys.argv[1:]]))"


def add_parser(subparsers: Any) -> None:
    """Adds the command line of `companion warmup`."""
    parser = subparsers.add_parser("warmup")
    parser.add_argument(
        "--levels",
        action="store_true",
        help="compile for each level of processors that this one can run, as a package for other computers contains them",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object; with --levels one for each level")


def run(args: argparse.Namespace) -> int:
    """Runs `companion warmup`. Returns 0: all kernels are compiled; 1: an error."""
    if args.levels:
        return _run_levels(["--json"] if args.json else [])
    try:
        folder, deleted = warm_up()
    except WarmupError as error:
        fail(str(error))
        return 1
    cached = len(kernels_in(folder))
    if args.json:
        print_json({"cache": [str(folder)], "deleted": deleted, "cached": cached})
        return 0
    if deleted:
        print_line(f"the cache of compiled kernels was damaged: {counted(deleted, 'file')} deleted, compiled again")
    level = os.environ.get(CPU_NAME, "this processor")
    remark = ", links to a cache that cannot be written" if unwritable_text() else ""
    print_line(f"all kernels are compiled for {level}: {counted(cached, 'file')} in {folder}{remark}")
    return 0


def _run_levels(options: list[str]) -> int:
    """Runs `companion warmup` for each level in a process of its own, since numba reads its processor once."""
    own = own_levels()
    if not own:
        fail("this processor has no level in common with others; `companion warmup` without --levels compiles for it")
        return 1
    for level in levels():
        if level not in own:
            warn(f"no kernels for {level}: this processor cannot run them; compile them on one that can")
    for level in own:
        environment = os.environ | level_variables(level)
        if named := os.environ.get(VARIABLE):
            environment[VARIABLE] = str(base_of(Path(named)))
        if subprocess.run([sys.executable, "-c", LEVEL_CHILD, *options], env=environment, check=False).returncode != 0:
            return 1  # its error is above
    return 0


def warm_up(groups: Sequence[str] = GROUPS) -> tuple[Path, int]:
    """Compiles or loads every kernel of these groups in a child process, with a line of progress.

    Returns the directory and the number of deleted files of damaged kernels. Raises WarmupError."""
    folder = state_in_use()
    if folder is None:
        raise WarmupError(
            no_place_text() or f"{VARIABLE} is not set, since numba was imported first: import companion before numba"
        )
    if warning := cache_warning(groups):
        raise WarmupError(warning)
    with ProgressLine() as report:
        return folder, compile_kernels(groups, report, check=True)


def ensure_compiled(*groups: str) -> int:
    """Compiles the missing kernels of these groups in a child process, with a line of progress on stderr.

    Returns the number of files that were deleted since they were damaged, at once if all are compiled. Raises
    WarmupError."""
    if warning := cache_warning(groups):
        warn(warning)
    with ProgressLine() as report:
        return compile_kernels(groups, report)
