"""Taps change nothing, see every stage, follow what is renamed, and leave no trace."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import find_spec
from types import FunctionType
from typing import Any

import pytest

import core.extractor as host
from companion.bench.frames import Flight, render_sequence
from companion.bench.stage_trace import (
    STAGE_OF_FUNCTION,
    STAGE_OF_MODULE,
    STAGES,
    Stopwatch,
    in_order,
    stage_of,
    traced,
)
from core.extractor import Extractor
from core.params import Params
from core.stages import support

TABLE = "the tables in companion/bench/stage_trace.py"


class Names:
    """A tap that notes who was called."""

    def __init__(self) -> None:
        self.calls: set[tuple[str, str, str]] = set()

    def __call__(
        self, stage: str, name: str, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Any:
        self.calls.add((stage, name, function.__module__.rpartition(".")[2]))
        return function(*args, **kwargs)


@pytest.fixture(scope="module")
def calls() -> set[tuple[str, str, str]]:
    """(stage, function, file) of every watched call of a frame."""
    names = Names()
    flight = Flight(Extractor(Params()), render_sequence("", "window", (160, 120), roll_deg=5.0, images=1))
    flight.frame()
    with traced(names):
        assert flight.frame().valid
    return names.calls


def test_every_file_that_the_extractor_calls_has_a_stage(calls: set[tuple[str, str, str]]) -> None:
    nameless = {file for stage, _, file in calls if stage not in STAGES}
    assert not nameless, f"core/extractor.py calls {sorted(nameless)}: say in {TABLE} which stage they are"


def test_every_stage_is_seen(calls: set[tuple[str, str, str]]) -> None:
    silent = set(STAGES) - {stage for stage, _, _ in calls}
    assert not silent, f"core/extractor.py calls nothing of the stages {sorted(silent)}: renamed? see {TABLE}"


def test_the_tables_name_what_exists(calls: set[tuple[str, str, str]]) -> None:
    gone = [f for f in STAGE_OF_MODULE if find_spec(f"core.stages.{f}") is None]
    assert not gone, f"core has no {gone} any more: take them out of {TABLE}"
    renamed = set(STAGE_OF_FUNCTION) - {name for _, name, _ in calls}
    assert not renamed, f"core/extractor.py does not call {sorted(renamed)} any more: their new names belong in {TABLE}"
    assert set(STAGE_OF_FUNCTION.values()) | set(STAGE_OF_MODULE.values()) == set(STAGES)


def test_a_function_that_no_table_names_goes_to_its_files_stage() -> None:
    def renamed() -> None: ...

    renamed.__module__ = "core.stages.segments"
    assert stage_of(renamed) == "tracks"
    renamed.__module__ = "core.new_file"
    assert stage_of(renamed) == "new_file"


def test_unknown_stages_are_listed_last() -> None:
    assert in_order(["new", "ground", "classify, flying pixels", "new"]) == ["classify, flying pixels", "ground", "new"]


def test_the_extractor_is_itself_again_after_the_block_even_after_an_error() -> None:
    before = dict(vars(host))

    def fail() -> None:
        assert vars(host)["classify"] is not before["classify"]
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), traced(Stopwatch()):
        fail()
    assert vars(host) == before


def test_a_modules_other_names_are_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "support", support, raising=False)
    plain = host.support
    with traced(Stopwatch()):
        assert host.support is not plain
        assert host.support.PX == plain.PX
        assert isinstance(host.support.compact, FunctionType)


def test_time_inside_another_stage_is_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """An outer stage of 10 ms that spends 7 of them in an inner one."""
    now = iter([0, 2_000_000, 9_000_000, 10_000_000])
    monkeypatch.setattr(time, "thread_time_ns", lambda: next(now))
    watch = Stopwatch()

    def inner() -> str:
        return "inner"

    def outer() -> str:
        return str(watch("b", "inner", inner, (), {}))

    assert watch("a", "outer", outer, (), {}) == "inner"
    assert dict(watch.spent_ms) == pytest.approx({"a": 3.0, "b": 7.0})
