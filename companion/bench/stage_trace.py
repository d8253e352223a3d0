"""Traces the calls of the extractor to its stages, without code in the extractor.

Within `with traced(...)`, the names by which the extractor's modules refer to stages are replaced by wrappers. The
stages themselves are unchanged, so calls between compiled kernels are not traced. A function belongs to the stage of
its module. A composite kernel, which only calls stages, runs as Python meanwhile, so that its stages are traced too:
results are equal, calls are slower."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any, Final

HOSTS: Final = ("core.extractor", "core.stages.strip_search", "core.stages.plane_shaping")
"""Modules whose calls are traced: those that combine the stages."""

STAGE_OF_MODULE: Final[dict[str, str]] = {
    "classify": "classify, flying pixels",
    "noise_check": "classify, flying pixels",
    "smeared_edges": "classify, flying pixels",
    "ramps": "classify, flying pixels",
    "level": "level",
    "pooling": "level",
    "temporal_noise": "noise estimate",
    "view_geometry": "level",
    "ground": "ground",
    "ground_ranges": "ground",
    "ground_threshold": "ground",
    "density": "density, windows, strips, rest",
    "settings": "density, windows, strips, rest",
    "columns": "density, windows, strips, rest",
    "strip_search": "density, windows, strips, rest",
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
    "plane_shaping": "planes, near side",
    "refine": "neighbours, pockets",
    "model": "tables, flags",
    "prisms": "layers, prisms",
    "free_space": "free-range profile",
    "free_profile": "free-range profile",
    "open_space": "free-range profile",
}
"""Module of core -> name of its stage. A missing module is a stage with its own name."""

STAGE_OF_FUNCTION: Final[dict[str, str]] = {
    "depth_to_mm": "depth to millimetres",
}
"""Functions with a stage of their own within their module."""

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
"""The stages in the order of the algorithm, for tables."""

TraceFunction = Callable[[str, str, Callable[..., Any], tuple[Any, ...], dict[str, Any]], Any]
"""trace(stage, name, function, args, kwargs) -> the result of the function."""


@contextmanager
def traced(trace: TraceFunction) -> Iterator[None]:
    """Passes every call of a stage within the block to `trace`; the original names are restored at its end, also after
    an exception."""
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
    """The replacement of a stage, of a module of stages, or of a composite kernel."""
    if isinstance(value, ModuleType):
        return _TracedModule(value, trace)
    return getattr(value, "py_func", value) if _is_composite(value) else _wrapped(value, name, trace)


def stage_of(function: Callable[..., Any]) -> str:
    """The stage of a function of core."""
    file = str(getattr(function, "__module__", "")).rpartition(".")[2]
    name = str(getattr(function, "__name__", ""))
    return STAGE_OF_FUNCTION.get(name) or STAGE_OF_MODULE.get(file) or file


def in_order(stages: Iterable[str]) -> list[str]:
    """Each stage once, in the order of the algorithm; unknown stages at the end."""
    found = list(dict.fromkeys(stages))
    return [s for s in STAGES if s in found] + [s for s in found if s not in STAGES]


def _is_core(value: object) -> bool:
    return isinstance(value, ModuleType) and value.__name__.startswith("core.")


def _is_composite(value: object) -> bool:
    """Whether it is a composite kernel, which runs as Python while traced."""
    return hasattr(value, "py_func") and getattr(value, "__module__", "") in HOSTS


def _is_stage(value: object, host: ModuleType) -> bool:
    """Whether it is a function (compiled or not) of another module of core than the host."""
    module = str(getattr(value, "__module__", ""))
    own = module == host.__name__ and not _is_composite(value)
    return callable(value) and not isinstance(value, type) and module.startswith("core.") and not own


def _wrapped(function: Callable[..., Any], name: str, trace: TraceFunction) -> Callable[..., Any]:
    stage = stage_of(function)
    return lambda *args, **kwargs: trace(stage, name, function, args, kwargs)


class _TracedModule:
    """Replaces a module of core: its functions are traced, other attributes are unchanged."""

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
    """A trace function that sums the processor time of this thread by stage, ms.

    Time in a nested stage counts for the nested stage only."""

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
