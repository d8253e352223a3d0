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

    def __call__(self, name: str, shape: tuple[int, ...], dtype: Kind) -> NDArray[Any]:
        """Returns a C-contiguous array of this shape and dtype. Requests with the same name share memory."""
        need = math.prod(shape)
        held = self._held.get(name)
        if held is None or held.size < need or held.dtype != dtype:
            held = self._held[name] = np.zeros(need, dtype)
        return held[:need].reshape(shape)
