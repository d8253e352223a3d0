"""How kernels are compiled: those without reference counts hand out no arrays and call nothing that makes them."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import errors

import core
from core.jit import inner, kernel, parameter_record, record, record_of

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
    texts = [text for f in FILES if "@inner" in (text := f.read_text()) or "@kernel" in text]
    assert "".join(texts).count("\n@inner") > 100
    assert makers_called(texts) == set()


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


RECORD = record(("x", np.float64), ("n", np.int32))


@kernel
def moved(table, to, row):
    table[to] = table[row]
    table[to].n += 1
    return table[to].x


@pytest.mark.nojit
def test_records_give_their_fields_as_attributes_and_are_copied_as_a_whole() -> None:
    table = np.zeros(3, RECORD)
    table["x"], table["n"] = [1.5, 2.5, 3.5], [1, 2, 3]
    assert moved(table, 0, 2) == 3.5
    assert table.tolist() == [(3.5, 4), (2.5, 2), (3.5, 3)]


@dataclass(frozen=True)
class Measures:
    x: float = 7.0
    name: str = "left out"
    on: bool = True
    count: int = 2


@pytest.mark.nojit
def test_a_record_of_parameters_takes_what_is_derived_first() -> None:
    assert record_of(RECORD, Measures(), n=3).tolist() == [(7.0, 3)]
    assert record_of(RECORD, Measures(), x=1.0, n=3).tolist() == [(1.0, 3)]
    assert record_of(RECORD, Measures(), n=4).tolist() == [(7.0, 4)]


def test_a_value_that_is_no_parameter_must_be_derived() -> None:
    with pytest.raises(AttributeError, match="'n'"):
        record_of(RECORD, Measures(), x=1.0)


def test_a_record_of_parameters_has_those_that_are_numbers_or_switches() -> None:
    found = parameter_record(Measures, ("derived", np.float64))
    assert found.names == ("x", "on", "count", "derived")
    assert [found[name].kind for name in found.names or ()] == ["f", "b", "i", "f"]
    assert record_of(found, Measures(count=5), derived=0.5).tolist() == [(7.0, True, 5, 0.5)]
