"""What is sent to the workers, and what they send back. Imports no kernels: a worker starts quickly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..config.loader import Config
from .flights import Flight


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchOptions:
    """How every flight is processed. config None: that in each log; near_m: see the event near_pass; planes: write the
    table `planes`; logs: write the replayed logs too."""

    config: Config | None = None
    near_m: float = 2.0
    planes: bool = False
    logs: bool = False


@dataclass(frozen=True, slots=True)
class FlightTask:
    """One flight to process into a dataset. software: of the process that made the task."""

    flight: Flight
    output: str
    options: BatchOptions
    software: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The summary of a processed flight. unread_files: of which nothing can be read; cpu_s: processor time; peak_mb: largest
    memory of the process so far."""

    frames: int
    damage: str | None
    unread_files: int
    equals_onboard: bool | None
    cpu_s: float
    wall_s: float
    peak_mb: float


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a flight has no result. The next run processes it again."""

    text: str


Process = Callable[[FlightTask], Outcome | Failure]
"""Processes one flight: companion.batch.task.run_task."""
