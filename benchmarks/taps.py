"""Taps: what goes in and out of each stage of the extractor, and when, without a line of it in the extractor.

The extractor calls its kernels through its own module's names and through those of its stage modules; a tap stands in
for such a name while a `with` block lasts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from core import clusters, extractor, fill, planes, refine, support, tracks

Stage = tuple[str, ModuleType, str]
STAGES: tuple[Stage, ...] = (
    ("depth to millimetres", extractor, "depth_to_mm"),
    ("classify, flying pixels", extractor, "classify"),
    ("noise estimate", extractor, "estimate_ke"),
    ("level", extractor, "view_geometry"),
    ("level", extractor, "level_safe"),
    ("ground", extractor, "find_ground"),
    ("ground", extractor, "ground_gate"),
    ("density, windows, strips, rest", extractor, "extract_strips"),
    ("support", support, "drop_unsupported"),
    ("support", support, "sort_columns"),
    ("support", support, "mark_cuts"),
    ("support", support, "smooth_near"),
    ("clusters", clusters, "place_strips"),
    ("clusters", clusters, "cluster_strips"),
    ("gap filling", fill, "fill_low_gaps"),
    ("gap filling", fill, "fill_slits"),
    ("tracks", tracks, "grow_tracks"),
    ("opening rule", extractor, "opening_masks"),
    ("planes, near side", planes, "planes_from_tracks"),
    ("planes, near side", planes, "measure_planes"),
    ("merge", planes, "merge_planes"),
    ("planes, near side", planes, "compact_planes"),
    ("planes, near side", planes, "shift_to_near_side"),
    ("neighbours, pockets", refine, "meet_neighbours"),
    ("neighbours, pockets", refine, "close_pockets"),
    ("neighbours, pockets", refine, "drop_covered"),
    ("layers, prisms", extractor, "layered_prisms"),
    ("free-range profile", extractor, "free_profile"),
)
"""(what the stage is called, the module through which it is called, its name there), in the order of the calls."""

Tap = Callable[[str, str, Callable[..., Any], tuple[Any, ...], dict[str, Any]], Any]
"""tap(stage, name, function, args, kwargs) -> what the function returned."""


@contextmanager
def tapped(tap: Tap) -> Iterator[None]:
    """Every stage goes through `tap` inside the block. Raises AttributeError where a stage has another name by now."""
    originals = [(module, name, getattr(module, name)) for _, module, name in STAGES]

    def through(stage: str, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *args, **kwargs: tap(stage, name, function, args, kwargs)

    try:
        for (stage, module, name), (_, _, function) in zip(STAGES, originals, strict=True):
            setattr(module, name, through(stage, name, function))
        yield
    finally:
        for module, name, function in originals:
            setattr(module, name, function)


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
        return tuple(_copy(v) for v in value)
    return value.copy() if isinstance(value, np.ndarray) else value
