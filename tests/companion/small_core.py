"""A small core with two kernels, one calling the other, and code that runs it with a cache of compiled kernels."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
from pathlib import Path

import companion.kernels.jit_cache as jit_cache
from companion.kernels.jit_cache import VARIABLE
from companion.kernels.manifest import Manifest, write_manifest
from companion.kernels.source_state import KERNELS_OUTSIDE_CORE, Closure, import_closures, source_key

OWN_ROOT = jit_cache.ROOT

CALLER = """
from numba import njit
from .inner import inner

@njit(cache=True)
def outer(x):
    return inner(x) + 1
"""
INNER = """
from numba import njit

@njit(cache=True)
def inner(x):
    return x * {factor}
"""
KEYED = """
import companion.kernels.jit_cache as jit_cache
from pathlib import Path
jit_cache.ROOT = Path({root!r})
assert jit_cache.use_own_cache() is not None
"""
RUN = """
import sys
sys.path.insert(0, {root!r})
from core.outer import outer
print(outer(10))
"""


def sources(root: Path, factor: int) -> Path:
    """A small core of two files, one calling the other."""
    for name in ("core/__init__.py", *KERNELS_OUTSIDE_CORE):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("")
    (root / "core" / "inner.py").write_text(INNER.format(factor=factor))
    if not (root / "core" / "outer.py").exists():
        (root / "core" / "outer.py").write_text(CALLER)
    return root


@functools.cache
def own_manifest() -> Manifest:
    return Manifest(import_closures(OWN_ROOT))


def closures_of(root: Path) -> dict[str, Closure]:
    """The import closures below a root. Those of this software, which take half a second of processor time, are computed once."""
    return own_manifest().closures if root == OWN_ROOT else import_closures(root)


def make_own_state(cache: Path) -> None:
    """Makes the directory of this software in a cache. The first process that imports it would, in a second of processor time."""
    state = state_of(OWN_ROOT, cache)
    if not state.exists():
        state.mkdir(parents=True)
        write_manifest(state, own_manifest())


def python(code: str, cache: Path, *, new: bool = False, **variables: str) -> str:
    """What code prints that runs with a cache and variables of its environment. new: the process makes its own directory in
    the cache."""
    if not new:
        make_own_state(cache)
    environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_DISABLE_JIT", "PYTHONPATH")} | variables
    environment[VARIABLE] = str(cache)
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # bytecode is not renewed for a change within the same second
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=jit_cache.ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def state_of(root: Path, cache: Path) -> Path:
    """The directory in a cache for the present state of the sources."""
    return cache / f"kernels-{source_key(root)}"


def run(root: Path, cache: Path) -> str:
    """What the small core prints, with its kernels in a cache."""
    return python(KEYED.format(root=str(root)) + RUN.format(root=str(root)), cache)


def kernels(folder: Path) -> set[str]:
    return {file.name.partition("-")[0] for file in folder.glob("*/*.nbi")}


def compiled(cache: Path) -> set[Path]:
    return set(cache.rglob("*.nbc"))


def made(base: Path, *ages: int) -> list[Path]:
    """Directories of old states, last used so many seconds ago."""
    folders = [base / f"kernels-{age:016x}" for age in ages]
    for folder, age in zip(folders, ages, strict=True):
        (folder / "core").mkdir(parents=True)
        (folder / "core" / "kernel.nbi").write_text("")
        (folder / "in-use").write_text("")
        os.utime(folder, (1_000_000_000 - age, 1_000_000_000 - age))
    return folders
