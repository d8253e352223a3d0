"""The second thread for parts of a frame (`core.helper`), on another processor than the one that asks.

A kernel may wake a thread on the processor of whoever wakes it although another is idle, and it then begins when that one
waits: too late to be of use. So it is kept off the processor that the asking thread is on, wherever that is moved to."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, Generic, TypeVar, cast

from core.helper import Done, Helper, Job

T = TypeVar("T")
NAME = "second"


class _Task(Generic[T]):
    """A job of the thread: whoever gets `_begun` has it, the thread or the one that asked."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._begun, self._ended = threading.Lock(), threading.Lock()
        self._ended.acquire()
        self._value: T | None = None
        self._failed = False

    def run(self) -> None:
        """Unless it is too late."""
        if self._begun.acquire(blocking=False):
            self._failed = True
            try:
                self._value = self._work()
                self._failed = False
            finally:
                self._ended.release()

    def settle(self) -> None:
        """Waits for it if it has begun, else nobody will ever do it."""
        if self._begun.acquire(blocking=False):
            self._ended.release()
        with self._ended:
            pass

    def result(self) -> T | None:
        """As `core.helper.Job` says."""
        self.settle()
        if self._failed:
            raise RuntimeError("the second thread ended with an error; its trace is above")
        return self._value


class SecondThread:
    """A `core.helper.Helper`. `open`, then `start` from one thread, then `close`; before and after, nobody does the work."""

    def __init__(self, cameras: Collection[str]) -> None:
        """cameras: names of those whose frames it helps with; without any there is no thread."""
        self._cameras = frozenset(cameras)
        # futures and their pool do all of this, too, but a part of a frame begins 0.1 ms later with them
        self._tasks: SimpleQueue[_Task[Any] | None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._last: _Task[Any] | None = None
        self._allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set[int]()
        self._kept_off = -1

    def helper_of(self, camera: str) -> Helper | None:
        """What helps with this camera's frames."""
        return self if camera in self._cameras else None

    def open(self) -> str:
        """What is wrong, in words, empty if nothing is: with one processor a second thread would only take its turn."""
        if not self._cameras:
            return ""
        if len(self._allowed) == 1:
            return (
                "second_thread_from_hz is not heeded: the service has one processor; give it two, or leave the key out"
            )
        self._thread = threading.Thread(target=self._run, name=NAME, daemon=True)
        self._thread.start()
        return ""

    def _run(self) -> None:
        while (task := self._tasks.get()) is not None:
            task.run()

    def start(self, work: Callable[[], T]) -> Job[T]:
        """As `core.helper.Helper` says."""
        if self._last is not None:
            self._last.settle()  # of a frame that was given up
        if self._thread is None or self._thread.native_id is None or not self._thread.is_alive():
            return Done(None)  # nothing is laid up for a thread that has ended with an error
        self._keep_off(self._thread.native_id)
        task = _Task(work)
        self._last = task
        self._tasks.put(task)
        return task

    def _keep_off(self, native_id: int) -> None:
        here = _processor()
        if here == self._kept_off or here not in self._allowed:
            return
        self._kept_off = here
        with suppress(OSError):  # no right to it, or the processor is gone: it then runs where the kernel says
            os.sched_setaffinity(native_id, self._allowed - {here})

    def close(self) -> None:
        """What has begun ends by itself. May be called twice."""
        if self._thread is not None:
            self._tasks.put(None)
            self._thread = None


def _number_of_processor() -> Callable[[], int]:
    """The C library's `sched_getcpu`; where it has none, one that does not know."""
    library = ctypes.CDLL(None)
    return cast(Callable[[], int], library.sched_getcpu) if hasattr(library, "sched_getcpu") else lambda: -1


_processor = _number_of_processor()
