"""Where flights are processed: on this computer's cores, or on a Dask or Ray cluster. Each engine schedules by its own
means; a task whose process was killed is run again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Protocol

from .jobs import Failure, FlightTask, Outcome

ATTEMPTS: Final = 4
"""A flight that ends this many processes is reported as failed: it may need more memory than there is."""


class EngineName(StrEnum):
    """The engines."""

    LOCAL = "local"
    DASK = "dask"
    RAY = "ray"


@dataclass(frozen=True, slots=True)
class Done:
    """A task that has ended."""

    task: FlightTask
    result: Outcome | Failure
    attempts: int = 1  # how often it was started, where the engine reports it, otherwise 1


class Engine(Protocol):
    """Processes tasks in any order."""

    def run(self, tasks: Sequence[FlightTask]) -> Iterator[Done]:
        """Yields each task once, when it has ended."""


def lost_text() -> str:
    """The failure of a flight whose processes were ended."""
    return (
        f"its process was ended {ATTEMPTS} times (killed, or out of memory): give the workers more memory, or start fewer "
        "of them; the same command processes this flight again"
    )


def unexpected_text(error: BaseException) -> str:
    """The failure of a flight by a defect of this software."""
    return (
        f"unexpected {type(error).__name__}: {error}; run `companion replay` on its files to see where, and report it"
    )
