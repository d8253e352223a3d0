"""Compilation of kernels: to machine code, cached on disk, without the interpreter lock; and records for their tables.

Numba counts references to every array that a compiled function takes, at each call, by atomic operations. For a small
function this costs more than its work. `inner` leaves the counting out: such a function may take arrays and slices of
them, but it neither makes nor returns an array (`table[i] = table[j]` of a two-dimensional table makes one; of a table of
records it does not), and calls no function that does. The compiler rejects the former, a test the latter.

A loop over an image is vectorised only where each iteration reads the same memory: in `a[i] if c else b` the element is
read only where c holds, which AVX-512 alone can do for bytes and words. On other processors such a loop runs pixel by
pixel and takes many times as long. Therefore the element is read first: `x = a[i]`, then `x if c else b`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

# both set it explicitly: a function without the option would inherit it from its first caller
kernel = njit(cache=True, nogil=True, _nrt=True)
"""For functions that make arrays, or call a function that does."""
inner = njit(cache=True, nogil=True, _nrt=False)
"""For all other functions."""
inner_inline = njit(cache=True, nogil=True, _nrt=False, forceinline=True)
"""`inner`, made part of its caller whatever its size."""
kernel_ieee = njit(cache=True, nogil=True, _nrt=True, error_model="numpy")
inner_ieee = njit(cache=True, nogil=True, _nrt=False, error_model="numpy")
inline_ieee = njit(cache=True, nogil=True, _nrt=False, error_model="numpy", forceinline=True)
"""The same with divisions by zero that give infinity, so that no check of the divisor prevents vectorisation."""


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
