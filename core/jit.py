"""Decorators that compile kernels, and records for their tables.

Kernels are compiled to machine code, cached on disk, and run without the interpreter lock.

numba counts references to every array that a compiled function takes, at each call, by atomic operations. For a small
function this costs more than its work. `inner` omits the counting. Such a function may take arrays and slices of
them, but must neither create nor return an array, nor call a function that does. (`table[i] = table[j]` creates one
for a two-dimensional table, but not for a table of records.) The compiler rejects the creation of arrays; a test
rejects such calls.

A loop over an image is vectorised only if each iteration reads the same memory. In `a[i] if c else b` the element is
read only where c holds, which of all processors only those with AVX-512 can do for bytes and words; elsewhere the
loop runs pixel by pixel and takes many times as long. Therefore the element is read first: `x = a[i]`, then `x if c
else b`."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

# _nrt is set explicitly: a function without the option would inherit it from its first caller.
kernel = njit(cache=True, nogil=True, _nrt=True)
"""For functions that create arrays, or call a function that does."""
inner = njit(cache=True, nogil=True, _nrt=False)
"""For all other functions."""
inner_inline = njit(cache=True, nogil=True, _nrt=False, forceinline=True)
"""`inner`, inlined into its caller whatever its size."""
kernel_ieee = njit(cache=True, nogil=True, _nrt=True, error_model="numpy")
inner_ieee = njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
inline_ieee = njit(cache=True, nogil=True, _nrt=False, error_model="numpy", forceinline=True)
"""The same, with divisions by zero that give infinity. Without this option, a test of each divisor prevents
vectorisation."""


def record(*fields: tuple[str, Any]) -> np.dtype[Any]:
    """Returns a structured dtype, aligned as in C, whose elements have their fields as attributes, in kernels and in
    Python.

    fields: (name, scalar type). An element of an array of this dtype refers to the memory of the array."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def of_type(scalar: Any, names: str) -> list[tuple[str, Any]]:
    """Returns fields of one type for `record`. names: separated by spaces."""
    return [(name, scalar) for name in names.split()]


def parameter_record(parameters: type, *derived: tuple[str, Any]) -> np.dtype[Any]:
    """Returns a `record` of all fields of a class of parameters that are numbers or switches, and of further fields."""
    kinds = {"float": np.float64, "int": np.int64, "bool": np.bool_}
    return record(*((f.name, kinds[str(f.type)]) for f in fields(parameters) if str(f.type) in kinds), *derived)


def record_of(dtype: np.dtype[Any], parameters: Any, **derived: Any) -> NDArray[Any]:
    """Returns an array (1,) of a dtype of `record`. Each field is set from `derived`, else from the parameter of the
    same name."""
    out = _of_parameters(dtype, parameters, frozenset(derived)).copy()
    for name, value in derived.items():
        out[name] = value
    return out


@lru_cache(maxsize=32)
def _of_parameters(dtype: np.dtype[Any], parameters: Any, derived: frozenset[str]) -> NDArray[Any]:
    out = np.zeros(1, dtype)
    for name in set(dtype.names or ()) - derived:
        out[name] = getattr(parameters, name)
    return out
