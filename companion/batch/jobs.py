"""What is sent to the workers, and what they send back. Imports no kernels: a worker starts quickly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..config.loader import Config
from .flights import Flight


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchOptions:
    """How every flight is processed."""

    config: Config | None = None  # None: that in each log
    near_m: float = 2.0  # see the event near_pass
    planes: bool = False  # write the table `planes`
    logs: bool = False  # write the replayed logs too


@dataclass(frozen=True, slots=True)
class FlightTask:
    """One flight to process into a dataset."""

    flight: Flight
    output: str
    options: BatchOptions
    software: str  # of the process that made the task


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The summary of a processed flight."""

    frames: int
    damage: str | None
    unread_files: int  # of which nothing can be read
    equals_onboard: bool | None
    cpu_s: float  # processor time
    peak_mb: float  # largest memory of the process so far


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a flight has no result. The next run processes it again."""

    text: str


Process = Callable[[FlightTask], Outcome | Failure]
"""Processes one flight: companion.batch.task.run_task."""
