"""Recordings of a simulated flight, as the service makes them, and what a killed one leaves."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from companion.config.loader import Config
from companion.config.service import RecordParams
from companion.log.log_directory import part_path
from companion.log.provenance import run_info
from companion.log.recorder import Recorder
from companion.log.repair import CHILD, leftovers, repair_file
from companion.pipeline.configured import make_pipeline
from companion.pipeline.pipeline import Pipeline
from core.params import Params
from core.stages.model import blind_model
from core.types import CameraInfo, ExtractorState, InvalidCause
from drivers.base import Event
from drivers.simulation.flight import Rates, SimulatedFlight

SMALL = RecordParams(file_mb=1.0, file_s=600.0, budget_mb=100.0, least_free_mb=1.0)
PROMPT = (sys.executable, "-c", CHILD.replace("os.nice(19); ", ""))
"""A repair that does not wait until all other tests leave it a processor."""


def repair(folder: Path, running: str) -> list[str]:
    """Repairs the unfinished files of other flights in this process; returns the results."""
    return [repair_file(path) for path in leftovers(folder, running)]


def flight(duration_s: float = 1.0) -> SimulatedFlight:
    return SimulatedFlight("street", width=160, height=120, duration_s=duration_s, rates=Rates(depth_hz=20.0))


@cache
def events_of(duration_s: float) -> tuple[Event, ...]:
    """The events of that flight, rendered once."""
    return tuple(flight(duration_s).events())


def run_through(recorder: Recorder, pipeline: Pipeline, events: Iterable[Event], pause_s: float = 0.0) -> None:
    """What the service does with each event."""
    for event in events:
        if recorder.wants_begin:
            recorder.begin(event.t_arrival_ns, pipeline.cameras, pipeline.state())
        recorder.event(event)
        for output in pipeline.handle(event):
            recorder.output(output)
        if pause_s:
            time.sleep(pause_s)


def recorded(folder: Path, params: RecordParams, duration_s: float = 1.0, pause_s: float = 0.0) -> Recorder:
    source = flight(duration_s)
    recorder = Recorder(folder, run_info("live"), params)
    recorder.open()
    run_through(recorder, make_pipeline(Config(), source.cameras), events_of(duration_s), pause_s)
    recorder.close()
    return recorder


A, B, C, D = (f"2026010{day}-000000" for day in (1, 2, 3, 4))
"""Flights, in order."""


def fake_log(folder: Path, flight: str, part: int, size: int, age_s: int, *, idle: bool = False) -> Path:
    path = part_path(folder, flight, part, idle)
    path.write_bytes(bytes(size))
    stamp = 1_700_000_000 - age_s
    os.utime(path, (stamp, stamp))
    return path


class FixedModel:
    """An extractor that returns an empty model at once: nothing has to be compiled."""

    def extract(self, depth: Any, info: CameraInfo, R: Any, state: Any = None, *, keep_strips: bool = False) -> Any:
        return blind_model(info, InvalidCause.NO_MEASUREMENT, Params()), ExtractorState()
