"""Kernels that are loaded quickly do what they did, and whatever numba needs later on is still to be had.

Each step is a process of its own: numba keeps what it has loaded."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

INNER = """
import numpy as np
from numba import njit

@njit(cache=True)
def middle(values):
    if values.size == 0:
        raise ValueError("nothing to sort")
    return np.sort(values)[values.size // 2]

@njit(cache=True)
def steps(count):
    return np.linspace(0.0, 1.0, count).reshape(2, count // 2)
"""
OUTER = """
import numpy as np
from numba import njit
from inner import middle

@njit(cache=True)
def product(values):
    return middle(values) * np.dot(values, values)
"""
COMPILE = """
import numpy as np
from inner import middle, steps
assert middle(np.array([3.0, 1.0, 2.0])) == 2.0
assert steps(4).shape == (2, 2)
"""
BEGIN = """
import sys
import numpy as np
from companion.kernel_loading import LoadedLibrary, load_quickly
from inner import middle, steps
load_quickly()
assert middle(np.array([3.0, 1.0, 2.0])) == 2.0
quick = {type(m.library) for m in middle.overloads.values()} == {LoadedLibrary}
imported = [m for m in ("numba.np.arraymath", "numba.np.arrayobj", "scipy.linalg") if m in sys.modules]
"""
"""`quick` and what was imported for loading, before anything is compiled."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two modules of kernels and a cache that holds those of the first."""
    folder = tmp_path_factory.mktemp("kernels")
    (folder / "inner.py").write_text(INNER)
    (folder / "outer.py").write_text(OUTER)
    assert said(folder, COMPILE) == []
    return folder


def said(place: Path, *code: str) -> list[str]:
    """The words that such a process prints; what goes wrong in it goes wrong here."""
    root = Path(__file__).resolve().parents[2]
    environment = {
        **os.environ, "NUMBA_CACHE_DIR": str(place / "cache"), "PYTHONPATH": f"{place}{os.pathsep}{root}",
        "NUMBA_DISABLE_JIT": "0",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", "import companion\n" + "\n".join(code)], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_nothing_is_imported_that_only_compiling_needs(place: Path) -> None:
    assert said(place, BEGIN, "print(quick, imported)") == ["True", "[]"]


def test_an_error_in_a_loaded_kernel_keeps_its_words(place: Path) -> None:
    """They are the constants of an environment."""
    told = said(
        place, BEGIN,
        "try: middle(np.empty(0))\nexcept ValueError as error: print(error)",
        "steps(4)",
        "try: steps(5)\nexcept ValueError as error: print(type(error).__name__, imported)",
    )  # fmt: skip
    assert told == ["nothing", "to", "sort", "ValueError", "[]"]


def test_a_kernel_that_calls_a_loaded_one_is_compiled_and_kept(place: Path) -> None:
    """Within and after the loading: the same, and what is stored then is good for the next process."""
    use = "from outer import product\nprint(product(np.array([3.0, 1.0, 2.0])))"
    hits = "print(sum(product.stats.cache_hits.values()))"
    assert said(place, BEGIN, use, hits) == ["28.0", "0"]
    assert said(place, BEGIN, use, hits) == ["28.0", "1"]
    assert said(place, "import numpy as np\nfrom outer import product\nprint(product(np.ones(3)))", hits) == [
        "3.0",
        "1",
    ]


def test_what_is_kept_names_nothing_of_ours(place: Path) -> None:
    """Kernels compiled while others are loaded quickly are read by whoever has numba alone."""
    (place / "third.py").write_text(OUTER.replace("product", "other"))
    use = "from third import other\nprint(other(np.array([3.0, 1.0, 2.0])))"
    assert said(place, BEGIN, use) == ["28.0"]
    kept = list((place / "cache").rglob("third.other*.nbc"))
    assert kept
    assert all(b"_rebuild_env" in f.read_bytes() and b"companion" not in f.read_bytes() for f in kept)


def test_another_kind_of_array_is_compiled_later(place: Path) -> None:
    later = "print(middle(np.array([3, 1, 2], np.int16)), middle(np.array([3.0, 1.0, 5.0])))"
    assert said(place, BEGIN, later) == ["2", "3.0"]


def test_where_numba_has_changed_it_loads_in_its_own_way(place: Path) -> None:
    """A place that is not there: nothing is replaced, and everything works."""
    gone = "import numba\nnumba.core.environment.rebuilt = vars(numba.core.environment).pop('_rebuild_env')"
    own = BEGIN.replace(
        "load_quickly()", "load_quickly()\nnumba.core.environment._rebuild_env = numba.core.environment.rebuilt"
    )
    assert said(place, gone, own, "print(quick)") == ["False"]


def test_two_threads_import_at_once(place: Path) -> None:
    """As at a start, where one loads kernels while the other imports the modules that hold them."""
    threads = """
import importlib, threading
names = ["companion.kernel_loading", "core.extractor"]
begun = threading.Barrier(2)
def load(name):
    begun.wait()
    importlib.import_module(name)
    print(name)
both = [threading.Thread(target=load, args=(name,)) for name in names]
[t.start() for t in both]
[t.join() for t in both]
"""
    for _ in range(3):
        assert sorted(said(place, threads)) == ["companion.kernel_loading", "core.extractor"]


def test_everything_computes_the_same() -> None:
    """All that the service runs, loaded in both ways from the cache of these tests: the same model, bit for bit."""
    code = """
import hashlib
import companion.warmup as warmup
from companion.kernel_loading import load_quickly
import core.extractor
found = hashlib.sha256()
extract = core.extractor.Extractor.extract
def told(self, *args, **kwargs):
    model, state = extract(self, *args, **kwargs)
    for part in (model.planes, model.support_px, model.margin_m, model.flags, model.free.end):
        found.update(part.tobytes())
    return model, state
core.extractor.Extractor.extract = told
{how}
warmup.run_kernels(warmup.MODES, metres=False)
print(found.hexdigest())
"""
    hashes = {
        subprocess.run(
            [sys.executable, "-c", code.format(how=how)], capture_output=True, text=True, check=True
        ).stdout
        for how in ("load_quickly()", "")
    }  # fmt: skip
    assert len(hashes) == 1
    assert len(hashes.pop()) == 65
