"""What numba does with one directory of kernels for all sources and processors: the reasons for those of jit_cache.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.kernels.processor import level_variables, own_levels

from ..small_core import RUN, python, sources
from .test_processor_levels import OUTCOME

pytestmark = pytest.mark.slow


def test_it_does_not_notice_a_change_in_a_called_kernel(tmp_path: Path) -> None:
    """When this ends, numba has mended it, and the directories for each state of the sources may go."""
    run = RUN.format(root=str(sources(tmp_path / "project", factor=2)))
    assert python(run, tmp_path / "one") == "21"
    sources(tmp_path / "project", factor=3)
    assert python(run, tmp_path / "one") == "21"


@pytest.mark.skipif("x86-64-v3" not in own_levels(), reason="kernels for x86-64-v3 are run")
def test_it_loads_no_kernel_of_another_processor(tmp_path: Path) -> None:
    """Its key of a kernel contains the processor."""
    run = RUN.format(root=str(sources(tmp_path / "project", factor=2))) + OUTCOME
    outcomes = [
        python(run, tmp_path / "cache", **level_variables(level)).splitlines()[1]
        for level in ("x86-64-v3", "x86-64-v2", "x86-64-v3")
    ]
    assert outcomes == ["x86-64-v3 0 1", "x86-64-v2 0 1", "x86-64-v3 1 0"]
