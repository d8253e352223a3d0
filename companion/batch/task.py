"""Processes one flight: the task that the engines run, in a process of their own."""

from __future__ import annotations

import functools
import resource
import shutil
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from drivers.base import BadData, DriverError

from ..config.loader import Config, ConfigError
from ..error_text import error_text
from ..kernels.compilation import WarmupError
from ..kernels.warmup import ensure_compiled
from ..log.log_file import ACTIVE
from ..log.provenance import software
from ..log.recovered_text import recovered_texts
from ..replay.replay import Options, check_input, replay
from .dataset import publish_flight, temporary_folder
from .flight_tables import FlightTables
from .jobs import Failure, FlightTask, Outcome
from .storage import local_copy


class VersionError(ValueError):
    """A worker has another version of this software."""


class _NothingReadError(Exception):
    """Nothing of a log can be read."""


def run_task(task: FlightTask) -> Outcome | Failure:
    """`process_flight`; its documented errors are returned as text, since not every error can be sent to another
    process."""
    try:
        return process_flight(task)
    except (DriverError, ConfigError, WarmupError, ValueError, OSError) as error:
        return Failure(error_text(error, task.output))


def process_flight(task: FlightTask) -> Outcome:
    """Replays all files of a flight and publishes its tables; a damaged file is part of the result.

    Raises VersionError, ConfigError for a configuration that does not fit the log, DeviceNotFound and OSError for files
    that cannot be read or written: then nothing is published."""
    if task.software != software():
        raise VersionError(
            f"the worker has {software()} and the command {task.software}: install the same version on all workers"
        )
    _compile("extractor")
    cpu_s = time.process_time()
    with ExitStack() as stack:
        folder = temporary_folder(task.output, task.flight)
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        copies = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="osape-batch-")))
        tables = FlightTables(task.flight, folder, task.options.near_m, task.options.planes)
        stack.callback(tables.discard)
        for number, file in enumerate(task.flight.files):
            with local_copy(file, copies) as path:
                tables.begin_file(number)
                output = folder / file.name.removesuffix(ACTIVE) if task.options.logs else None
                try:
                    tables.end_file(_replay(path, output, task.options.config, tables))
                except _NothingReadError as error:
                    tables.end_file(str(error), unread=True)
        tables.finish()
        publish_flight(task.output, task.flight, folder)
    row = tables.flight_row()
    return Outcome(
        frames=row["frames"],
        damage=row["damage"],
        unread_files=row["unread_files"],
        equals_onboard=row["equals_onboard"],
        cpu_s=time.process_time() - cpu_s,
        peak_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    )


@functools.cache
def _compile(group: str) -> None:
    """Compiles missing kernels of a group, once per process. They are loaded at their first use."""
    ensure_compiled(group)


def _replay(path: Path, output: Path | None, config: Config | None, tables: FlightTables) -> str | None:
    """Replays a file; returns its damage and what it has lost before a recovery, None: nothing. Raises _NothingReadError."""
    options = Options(output=output, config=config, depth=False, as_live=True)
    try:
        if check_input(path, options).tracking.enabled:
            _compile("tracking")
        done = replay(path, options, observer=tables)
    except BadData as error:
        raise _NothingReadError(str(error)) from error
    except ConfigError as error:
        if config is not None:
            raise
        raise _NothingReadError(str(error)) from error  # the configuration in the log
    recovered = [f"{path}: {text}" for text in recovered_texts(done.lost, done.borrowed)]
    return "; ".join([done.damage, *recovered] if done.damage else recovered) or None
