"""Tasks for tests of the engines. A module of its own: workers import it, and start quickly without kernels."""

from __future__ import annotations

import os
import signal
import tempfile
import time
from pathlib import Path

from companion.batch.jobs import FlightTask, Outcome


def note(task: FlightTask) -> int:
    """Notes a start of a task; returns how many there were."""
    path = Path(task.output) / task.flight.name
    with path.open("a") as file:
        file.write(f"{os.getpid()}\n")
    return len(path.read_text().split())


def outcome_of(task: FlightTask) -> Outcome:
    return Outcome(frames=1, damage=None, unread_files=0, equals_onboard=True, cpu_s=0.0, peak_mb=0.0)


def killed_at_first(task: FlightTask) -> Outcome:
    """Kills its own process at the first start of every second flight."""
    if note(task) == 1 and int(task.flight.name[-1]) % 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome_of(task)


def always_killed(task: FlightTask) -> Outcome:
    note(task)
    if task.flight.name == "flight1":
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome_of(task)


def defective(task: FlightTask) -> Outcome:
    raise IndexError("made up")


def endless(task: FlightTask) -> Outcome:
    """Runs until its process is ended, with a temporary folder as of copies of logs."""
    with tempfile.TemporaryDirectory(dir=task.output, prefix="copies-"):
        note(task)
        time.sleep(600.0)
    return outcome_of(task)
