"""Hypothesis draws the same examples on every run and keeps nothing between runs, unless another profile is chosen."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "core",
    derandomize=True,
    deadline=None,
    max_examples=25,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)


def pytest_configure(config: pytest.Config) -> None:
    if not config.getoption("--hypothesis-profile"):
        settings.load_profile("core")


@pytest.fixture(autouse=True)
def ieee_arithmetic() -> Iterator[None]:
    """Without the JIT numpy's scalars warn where compiled kernels follow IEEE 754 silently: 1 / 0 is infinite, and the
    kernels rely on it. With the JIT every warning is shown."""
    if not numba.config.DISABLE_JIT:
        yield
        return
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        yield
