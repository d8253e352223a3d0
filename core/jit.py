"""How the kernels are compiled: to plain machine code, kept on disk, without Python's lock.

Numba counts the references to every array that a compiled function is given, at each call, by atomic operations: more
time than most of our small functions take for their work. `inner` leaves that out. Such a function may take arrays and
look at parts of them, but it neither makes nor returns one, not even in passing (`table[i] = table[j]` copies a row by way
of a new one: see `copy_row`), and calls none that does. The compiler refuses the former, a test the latter.

A loop over an image is done for many pixels at a time only where each of them reads the same memory: in `a[i] if c else b`
the element is read where c holds, which AVX-512 alone among the processors at hand can do for bytes and words. Elsewhere,
on every board, such a loop goes pixel by pixel and takes many times as long. So the element is read before: `x = a[i]`,
then `x if c else b`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

# both say it, since a function that does not would take it over from whoever calls it first
kernel = njit(cache=True, nogil=True, _nrt=True)
"""For functions that make arrays, or call one that does."""
inner = njit(cache=True, nogil=True, _nrt=False)
"""For all others."""
inner_inline = njit(cache=True, nogil=True, _nrt=False, forceinline=True)
"""`inner`, made part of its caller whatever its size."""
kernel_ieee = njit(cache=True, nogil=True, _nrt=True, error_model="numpy")
inner_ieee = njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
inline_ieee = njit(cache=True, nogil=True, _nrt=False, error_model="numpy", forceinline=True)
"""The same where a division by zero gives infinity, and no look at the divisor hinders many divisions at a time."""


def record(*fields: tuple[str, Any]) -> np.dtype[Any]:
    """A structured dtype, aligned as in C, whose elements give their fields as attributes, in kernels and in Python.

    fields: (name, scalar type). An element of an array of this dtype refers to the array's memory."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def record_of(dtype: np.dtype[Any], parameters: Any, **derived: Any) -> NDArray[Any]:
    """(1,) of a dtype of `record`: each field is what `derived` says, else the parameter of the same name."""
    out = np.zeros(1, dtype)
    for name in dtype.names or ():
        out[name] = derived[name] if name in derived else getattr(parameters, name)
    return out


@inner
def copy_row(table, to, row):
    """Makes row `to` of a table (N, C) the same as row `row`."""
    for c in range(table.shape[1]):
        table[to, c] = table[row, c]
