"""Cases that repeat what their neighbours show with other values: `make test` runs the first ones, `make nightly` all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import settings


def nightly(*cases: Any) -> list[Any]:
    """Values of a parametrisation that `make nightly` alone runs; a tuple for several parameters."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow) for case in cases]


def first(number: int, cases: Iterable[Any]) -> list[Any]:
    """Values of a parametrisation of which `make test` runs the first ones."""
    listed = list(cases)
    return [*listed[:number], *nightly(*listed[number:])]


def examples(times: float) -> settings:
    """Settings of a property test with so many times the examples of the profile: fewer where an example takes long."""
    return settings(max_examples=max(1, round(times * settings().max_examples)))
