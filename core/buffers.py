"""Scratch memory that is kept from frame to frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Kind = type[np.generic] | np.dtype[Any]


class Buffers:
    """Named arrays that grow to the largest size requested. New memory is zero; later requests get what was left in
    it."""

    def __init__(self) -> None:
        self._held: dict[str, NDArray[Any]] = {}
        self._handed: dict[str, tuple[tuple[int, ...], Kind, NDArray[Any]]] = {}

    def __call__(self, name: str, shape: tuple[int, ...], dtype: Kind) -> NDArray[Any]:
        """Returns a C-contiguous array of this shape and dtype. Requests with the same name share memory."""
        handed = self._handed.get(name)
        if handed is not None and handed[0] == shape and handed[1] is dtype:
            return handed[2]
        need = math.prod(shape)
        held = self._held.get(name)
        if held is None or held.size < need or held.dtype != dtype:
            held = self._held[name] = np.zeros(need, dtype)
        array = held[:need].reshape(shape)
        self._handed[name] = shape, dtype, array
        return array
