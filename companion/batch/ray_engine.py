"""Processes flights on an existing Ray cluster, which schedules them and starts the tasks of a lost worker again."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, Final

from drivers.base import DeviceNotFound
from drivers.optional_library import optional_module

from .engines import ATTEMPTS, Done, lost_text, unexpected_text
from .jobs import Failure, FlightTask, Process

_WAITED: Final = 1000
"""Tasks to wait for at a time, the oldest: waiting for many thousands takes long."""


class RayEngine:
    """address: "auto" on a node of the cluster, HOST:6379 or ray://HOST:10001. A flight takes one CPU of the cluster."""

    def __init__(self, address: str, process: Process) -> None:
        self._address, self._process = address, process
        self._ray = optional_module("ray", "--engine ray needs ray and pyarrow", "ray>=2.30", "pyarrow>=16")

    def run(self, tasks: Sequence[FlightTask]) -> Iterator[Done]:
        """Yields each task once, when it has ended. Raises DeviceNotFound where the cluster does not answer."""
        ray = self._ray
        try:
            ray.init(address=self._address, log_to_driver=False, configure_logging=False)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise DeviceNotFound(
                f"{self._address}: no Ray cluster answers ({error}); check --address and that the cluster runs"
            ) from error
        try:
            remote = ray.remote(num_cpus=1, max_retries=ATTEMPTS - 1)(self._process)
            waiting = {remote.remote(task): task for task in tasks}
            while waiting:
                ended, _ = ray.wait(list(itertools.islice(waiting, _WAITED)))
                for reference in ended:
                    yield Done(waiting.pop(reference), self._result(reference))
        finally:
            ray.shutdown()

    def _result(self, reference: Any) -> Any:
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference)
        except (errors.WorkerCrashedError, errors.OutOfMemoryError, errors.NodeDiedError):
            return Failure(lost_text())
        except errors.RayError as error:
            return Failure(unexpected_text(error))
