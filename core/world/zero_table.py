"""Large tables of which little is used."""

from __future__ import annotations

import math
import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray


def zero_table(shape: tuple[int, ...], dtype: type[np.generic] | np.dtype[Any]) -> NDArray[Any]:
    """Returns zeros that take memory page by page when they are written, and give it back when they are released.

    np.zeros does so only at first: once an array of up to 32 MB was released, glibc takes arrays of its size from its
    heap, and clears them."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    return np.frombuffer(mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS), dtype).reshape(shape)
