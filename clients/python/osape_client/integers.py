"""Integers of messages as arrays of smaller types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FLAG_BITS = 0xFF


def integers(values: Sequence[int], dtype: type[np.integer[Any]], name: str) -> NDArray[Any]:
    """(N,) of this type. Raises ValueError for a number outside its range, which NumPy would wrap."""
    limits = np.iinfo(dtype)
    if len(values) and not (limits.min <= min(values) and max(values) <= limits.max):
        raise ValueError(f"{name}: a number outside of {limits.min}..{limits.max}; is the message damaged?")
    return np.array(values, dtype=dtype)


def flags(values: Sequence[int]) -> NDArray[np.uint8]:
    """(N,) uint8 PlaneFlags. Flags of a newer version, beyond the eight bits of this one, are left out."""
    return (np.array(values, dtype=np.int64) & FLAG_BITS).astype(np.uint8)
