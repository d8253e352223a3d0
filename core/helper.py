"""A second thread for parts of a frame, where its owner has one to spare.

What it does is never waited for before it has begun: a part that it comes too late for is done by whoever asked. The
result is the same, bit for bit, whoever did what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Job(Protocol[T_co]):
    """Work that was asked for."""

    def result(self) -> T_co | None:
        """What it came to, waiting for it if it has begun; None if not: it is then never done. Raises what it raised.

        To be asked once."""
        ...


class Helper(Protocol):
    """Does one piece of work after the other."""

    def start(self, work: Callable[[], T]) -> Job[T]:
        """Asks for it, and waits until whatever was asked for before has ended. The work must not return None."""
        ...


@dataclass(frozen=True, slots=True)
class Done(Generic[T]):
    """A job that has been done, or that nobody will do."""

    value: T | None

    def result(self) -> T | None:
        """As `Job` says."""
        return self.value


class AtOnce:
    """No thread: all of it is done before `start` returns. It makes every kernel run that a helper needs."""

    def start(self, work: Callable[[], T]) -> Job[T]:
        """As `Helper` says."""
        return Done(work())
