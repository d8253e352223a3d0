"""Arithmetic of kernels that run without the JIT."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def ieee_arithmetic() -> Iterator[None]:
    """Without the JIT numpy's scalars warn where compiled kernels follow IEEE 754 silently: 1 / 0 is infinite, and the
    kernels rely on it. With the JIT every warning is shown."""
    if not numba.config.DISABLE_JIT:
        yield
        return
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        yield
