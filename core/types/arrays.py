"""Arrays that are never changed after they were made."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

_Scalar = TypeVar("_Scalar", bound=np.generic)


def readonly(a: NDArray[Any], dtype: type[_Scalar], shape: tuple[int | None, ...], name: str) -> NDArray[_Scalar]:
    """A read-only C-contiguous view of `a` after checking dtype and shape (None: any length); `a` itself where it is one.
    Raises ValueError."""
    if a.dtype != dtype:
        raise ValueError(f"{name}: dtype {a.dtype}, expected {np.dtype(dtype)}")
    got = a.shape
    if got != shape:
        fits = len(got) == len(shape)
        for want, length in zip(shape, got, strict=False):
            fits = fits and (want is None or want == length)
        if not fits:
            raise ValueError(f"{name}: shape {got}, expected {shape}")
    flags = a.flags
    if not flags.c_contiguous:
        a = np.ascontiguousarray(a)
    elif not flags.writeable:
        return a
    view = a.view()
    view.flags.writeable = False
    return view


def store_readonly(holder: object, dtype: type[np.generic], shape: tuple[int | None, ...], *names: str) -> None:
    """Replaces array fields of a frozen data class by their `readonly` views. Raises ValueError naming the field."""
    for name in names:
        object.__setattr__(holder, name, readonly(getattr(holder, name), dtype, shape, name))


def _nothing_open() -> NDArray[np.uint8]:
    nothing = np.zeros((0, 0), np.uint8)
    nothing.setflags(write=False)
    return nothing


NOTHING_OPEN = _nothing_open()
"""The open ranges of a profile that presumes nothing: (0, 0) uint8, read-only."""
