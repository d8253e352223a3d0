"""What goes in and out of each stage of the extractor, for the pictures of the documentation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from companion.bench.stage_trace import traced

__all__ = ["Call", "Calls", "traced"]


class Calls:
    """A tap that keeps copies of what each stage was given and left behind. of(name): its calls in order."""

    def __init__(self) -> None:
        self._calls: dict[str, list[Call]] = {}

    def __call__(
        self, stage: str, name: str, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Any:
        before = [_copy(a) for a in args]
        result = function(*args, **kwargs)
        self._calls.setdefault(name, []).append(Call(before, [_copy(a) for a in args], _copy(result)))
        return result

    def names(self) -> list[str]:
        """The functions that were called."""
        return list(self._calls)

    def of(self, name: str, index: int = 0) -> Call:
        """The index-th call of a function in this frame."""
        return self._calls[name][index]


class Call:
    """before, after: copies of the positional arguments; result: of what came back."""

    def __init__(self, before: list[Any], after: list[Any], result: Any) -> None:
        self.before, self.after, self.result = before, after, result


def _copy(value: Any) -> Any:
    if isinstance(value, tuple):
        copies = [_copy(v) for v in value]
        return type(value)(*copies) if hasattr(value, "_fields") else tuple(copies)
    return value.copy() if isinstance(value, np.ndarray) else value
