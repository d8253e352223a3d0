"""Taps: every call that the extractor makes to a stage can be watched, without a line of it in the extractor.

While a `with tapped(...)` block lasts, the names by which the extractor knows its stages lead through the tap. The
stages themselves are left alone, so compiled kernels that call each other never meet a tap, and a kernel that is
renamed or moved is followed by itself: it is counted to the stage of the file that it lies in. A kernel that does nothing
but call stages runs as the Python that it was compiled from meanwhile, so that these are seen too: the result is the same, the
calls cost more."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any, Final

HOSTS: Final = ("core.extractor", "core.stages.strip_stages", "core.stages.plane_stages")
"""Modules whose calls are watched: those that put the stages together."""

STAGE_OF_MODULE: Final[dict[str, str]] = {
    "classify": "classify, flying pixels",
    "level": "level",
    "temporal_noise": "noise estimate",
    "view_geometry": "level",
    "ground": "ground",
    "density": "density, windows, strips, rest",
    "settings": "density, windows, strips, rest",
    "columns": "density, windows, strips, rest",
    "strip_stages": "density, windows, strips, rest",
    "truncation": "density, windows, strips, rest",
    "support": "support",
    "clusters": "clusters",
    "gap_filling": "gap filling",
    "segments": "tracks",
    "openings": "opening rule",
    "planes": "planes, near side",
    "outlier_split": "planes, near side",
    "evidence": "merge",
    "merge": "merge",
    "plane_stages": "planes, near side",
    "refine": "neighbours, pockets",
    "model": "tables, flags",
    "prisms": "layers, prisms",
    "free_space": "free-range profile",
}
"""File of core -> what its part of the work is called. A file that is missing here is a stage by its own name."""

STAGE_OF_FUNCTION: Final[dict[str, str]] = {
    "depth_to_mm": "depth to millimetres",
    "estimate_ke": "noise estimate",
}
"""Functions that are told apart from the rest of their file."""

STAGES: Final = (
    "depth to millimetres",
    "classify, flying pixels",
    "noise estimate",
    "level",
    "ground",
    "density, windows, strips, rest",
    "support",
    "clusters",
    "gap filling",
    "tracks",
    "opening rule",
    "planes, near side",
    "merge",
    "neighbours, pockets",
    "layers, prisms",
    "free-range profile",
    "tables, flags",
)
"""The stages in the order of the algorithm, in which tables list them."""

TraceFunction = Callable[[str, str, Callable[..., Any], tuple[Any, ...], dict[str, Any]], Any]
"""tap(stage, name, function, args, kwargs) -> what the function returned."""


@contextmanager
def traced(trace: TraceFunction) -> Iterator[None]:
    """Every call of a stage goes through `tap` inside the block, also after an error as before it."""
    hosts = [import_module(name) for name in HOSTS]
    known = [(host, name, value) for host in hosts for name, value in vars(host).items()]
    changed = [(host, name, value) for host, name, value in known if _is_stage(value, host) or _is_core(value)]
    try:
        for host, name, value in changed:
            setattr(host, name, _replacement(value, name, trace))
        yield
    finally:
        for host, name, value in changed:
            setattr(host, name, value)


def _replacement(value: Any, name: str, trace: TraceFunction) -> Any:
    """What stands in for a stage, for a module of stages, or for a kernel that is put together of stages."""
    if isinstance(value, ModuleType):
        return _TracedModule(value, trace)
    return getattr(value, "py_func", value) if _is_composite(value) else _wrapped(value, name, trace)


def stage_of(function: Callable[..., Any]) -> str:
    """What the work of a function of core is called."""
    file = str(getattr(function, "__module__", "")).rpartition(".")[2]
    name = str(getattr(function, "__name__", ""))
    return STAGE_OF_FUNCTION.get(name) or STAGE_OF_MODULE.get(file) or file


def in_order(stages: Iterable[str]) -> list[str]:
    """Each stage once, in the order of the algorithm; those that are not known to it at the end."""
    found = list(dict.fromkeys(stages))
    return [s for s in STAGES if s in found] + [s for s in found if s not in STAGES]


def _is_core(value: object) -> bool:
    return isinstance(value, ModuleType) and value.__name__.startswith("core.")


def _is_composite(value: object) -> bool:
    """A kernel put together of stages, which runs as Python so that these are seen."""
    return hasattr(value, "py_func") and getattr(value, "__module__", "") in HOSTS


def _is_stage(value: object, host: ModuleType) -> bool:
    """A function (compiled or not) of another file of core than the host."""
    module = str(getattr(value, "__module__", ""))
    return callable(value) and not isinstance(value, type) and module.startswith("core.") and module != host.__name__


def _wrapped(function: Callable[..., Any], name: str, trace: TraceFunction) -> Callable[..., Any]:
    stage = stage_of(function)
    return lambda *args, **kwargs: trace(stage, name, function, args, kwargs)


class _TracedModule:
    """Stands in for a module of core: its functions lead through the tap, all else is as it is."""

    def __init__(self, module: ModuleType, trace: TraceFunction) -> None:
        self._module, self._trace = module, trace
        self._wrappers: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        wrappers: dict[str, Any] = self.__dict__["_wrappers"]
        if name not in wrappers:
            value = getattr(self._module, name)
            own = callable(value) and not isinstance(value, type)
            wrappers[name] = _wrapped(value, name, self._trace) if own else value
        return wrappers[name]


class Stopwatch:
    """A tap that adds up the processor time of this thread in each stage, ms.

    What a stage spends in another one that is watched too is counted there only."""

    def __init__(self) -> None:
        self.spent_ms: dict[str, float] = defaultdict(float)
        self._inner_ns = [0]

    def __call__(
        self, stage: str, name: str, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Any:
        self.spent_ms[stage] += 0.0
        self._inner_ns.append(0)
        begun = time.thread_time_ns()
        try:
            return function(*args, **kwargs)
        finally:
            spent = time.thread_time_ns() - begun
            self.spent_ms[stage] += 1e-6 * (spent - self._inner_ns.pop())
            self._inner_ns[-1] += spent
