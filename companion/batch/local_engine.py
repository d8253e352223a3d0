"""Processes flights on the cores of this computer with concurrent.futures.

Each slot has an executor with one process. A process that is killed breaks its own executor only, which is replaced; the
other slots continue."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from .engines import ATTEMPTS, Done, lost_text, unexpected_text
from .jobs import Failure, FlightTask, Outcome, Process


def _start_worker() -> None:
    """Ends a worker whose parent was killed, and lets one that is ended delete its temporary files."""
    signal.signal(signal.SIGTERM, _exit)
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()


def _exit(number: int, frame: object) -> None:
    raise SystemExit(1)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _end_processes() -> None:
    """Ends the processes of all slots; their unfinished flights are computed again by the next run."""
    for process in multiprocessing.active_children():
        process.terminate()


class _Slot:
    """One process at a time."""

    def __init__(self, process: Process) -> None:
        self._process = process
        self._executor: ProcessPoolExecutor | None = None
        self._stopped = False

    def run(self, task: FlightTask) -> Done:
        for attempt in range(1, ATTEMPTS + 1):
            future = self._submit(task)
            if self._stopped:
                _end_processes()  # this one may have begun meanwhile
            error = future.exception()
            if error is None:
                return Done(task, future.result(), attempt)
            if not isinstance(error, BrokenProcessPool | SystemExit):
                return Done(task, Failure(unexpected_text(error)), attempt)
            self.close()
            if self._stopped:
                break
        return Done(task, Failure(lost_text()), ATTEMPTS)

    def _submit(self, task: FlightTask) -> Future[Outcome | Failure]:
        if self._executor is None:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(1, mp_context=context, initializer=_start_worker)
        # inherited by the new process, which would print a traceback after Ctrl-C; it ends with this one
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        return self._executor.submit(self._process, task)

    def stop(self) -> None:
        """Starts no process again that ends from now on."""
        self._stopped = True

    def close(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None


class LocalEngine:
    """workers: number of processes."""

    def __init__(self, workers: int, process: Process) -> None:
        self._workers, self._process = workers, process

    def run(self, tasks: Sequence[FlightTask]) -> Iterator[Done]:
        """Yields each task once, when it has ended. Where the caller stops, as after Ctrl-C, the processes are ended."""
        slots: queue.SimpleQueue[_Slot] = queue.SimpleQueue()
        every = [_Slot(self._process) for _ in range(min(self._workers, len(tasks)))]
        for slot in every:
            slots.put(slot)

        def run_one(task: FlightTask) -> Done:
            slot = slots.get()
            try:
                return slot.run(task)
            finally:
                slots.put(slot)

        threads = ThreadPoolExecutor(max(1, len(every)), thread_name_prefix="batch")
        try:
            waiting = {threads.submit(run_one, task) for task in tasks}
            while waiting:
                ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in ended)
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            for slot in every:
                slot.stop()
            _end_processes()
            raise
        finally:
            threads.shutdown(cancel_futures=True)
            for slot in every:
                slot.close()
