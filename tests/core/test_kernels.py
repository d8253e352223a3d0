"""How kernels are compiled: those without reference counts hand out no arrays and call nothing that makes them."""

from __future__ import annotations

import ast
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import errors

import core
from core.jit import copy_row, inner

FILES = sorted(Path(core.__path__[0]).rglob("*.py"))


def kernels_of(text: str) -> dict[str, tuple[str, set[str]]]:
    """(decorator, names of what it calls) of each kernel of a file, by its name."""
    found = {}
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and node.decorator_list and isinstance(node.decorator_list[0], ast.Name):
            calls = {n.func.id for n in ast.walk(node) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
            found[node.name] = node.decorator_list[0].id, calls
    return found


def makers_called(texts: list[str]) -> set[tuple[str, str]]:
    """(caller, callee) where an `inner` function calls one that may make arrays."""
    every = {name: one for text in texts for name, one in kernels_of(text).items()}
    return {
        (name, other)
        for name, (how, calls) in every.items()
        if how.startswith("inner")
        for other in calls
        if every.get(other, ("",))[0].startswith("kernel")
    }


def test_inner_functions_call_nothing_that_makes_arrays() -> None:
    assert makers_called(["@kernel\ndef a():\n    pass\n@inner\ndef b():\n    a()\n@kernel\ndef c():\n    b()"]) == {
        ("b", "a")
    }
    assert sum(how.startswith("inner") for f in FILES for how, _ in kernels_of(f.read_text()).values()) > 100
    assert makers_called([f.read_text() for f in FILES]) == set()


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="asks the compiler")
def test_inner_functions_cannot_make_or_return_arrays() -> None:
    def made(table: np.ndarray) -> float:
        return (table + 1.0)[0]

    def part(table: np.ndarray) -> np.ndarray:
        return table[1:]

    with pytest.raises(errors.NumbaError, match="NRT required"):
        inner(made).compile((numba.float64[::1],))
    with pytest.raises(errors.NumbaError, match="returning of array"):
        inner(part).compile((numba.float64[::1],))


@pytest.mark.nojit
def test_copied_rows_are_those_of_the_table() -> None:
    table = np.arange(12.0).reshape(4, 3)
    copy_row(table, 2, 0)
    copy_row(table, 3, 3)
    np.testing.assert_array_equal(table, [[0, 1, 2], [3, 4, 5], [0, 1, 2], [9, 10, 11]])
