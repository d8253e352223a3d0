"""Processes flights on an existing Dask cluster, which schedules them and starts the tasks of a lost worker again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from drivers.base import DeviceLost, DeviceNotFound
from drivers.optional_library import optional_module

from .engines import Done, lost_text, unexpected_text
from .jobs import Failure, FlightTask, Process

_CONNECT_S = 30.0


class DaskEngine:
    """address: of the scheduler, such as tcp://HOST:8786. Each worker must run one task at a time (`--nthreads 1`)."""

    def __init__(self, address: str, process: Process) -> None:
        self._address, self._process = address, process
        need = "--engine dask needs dask, distributed and pyarrow"
        self._distributed = optional_module("distributed", need, "dask>=2024.8", "distributed>=2024.8", "pyarrow>=16")

    def run(self, tasks: Sequence[FlightTask]) -> Iterator[Done]:
        """Yields each task once, when it has ended. Raises DeviceNotFound where the scheduler does not answer, DeviceLost
        where it no longer does, and ValueError for workers with several threads."""
        try:
            client = self._distributed.Client(self._address, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise DeviceNotFound(
                f"{self._address}: no Dask scheduler answers ({error}); check --address and that the cluster runs"
            ) from error
        with client:
            _refuse_threads(client.nthreads(), self._address)
            futures = {
                client.submit(self._process, task, key=f"flight-{number}-{task.flight}", pure=False): task
                for number, task in enumerate(tasks)
            }
            for future in self._distributed.as_completed(list(futures)):
                try:
                    result = self._result(future)
                except CancelledError as error:
                    raise DeviceLost(
                        f"{self._address}: the Dask scheduler was lost, or has cancelled the tasks; {len(futures)} of "
                        f"{len(tasks)} flights are not done; start the cluster, then the same command again: it continues"
                    ) from error
                yield Done(futures.pop(future), result)
                future.release()

    def _result(self, future: Any) -> Any:
        error = future.exception()
        if error is None:
            return future.result()
        if isinstance(error, self._distributed.KilledWorker):
            return Failure(lost_text())
        return Failure(unexpected_text(error))


def _refuse_threads(threads: dict[str, int], address: str) -> None:
    """Raises ValueError for workers with several threads: their flights would share one interpreter."""
    several = sorted(name for name, number in threads.items() if number > 1)
    if several:
        raise ValueError(
            f"{address}: {len(several)} workers have several threads, the first is {several[0]}; start them with "
            "`dask worker --nthreads 1 --nworkers N`, one process for each core"
        )
