"""Steps of a session: a command, the expected exit status and text, and what was measured."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

LIMIT_S: Final = 3600.0
"""Time limit of a command."""
STOP_LIMIT_S: Final = 30.0


@dataclass(frozen=True, slots=True)
class Step:
    """One command. text: typed in a shell; status: the expected exit status; shows: regular expressions that the output
    must match; starts: it is left running in the background until the session ends or `stop` names it; stop: the text of a
    background command that is stopped by Ctrl-C, in place of a command; wait_s: pause before the step, for a reader."""

    text: str = ""
    status: int = 0
    shows: tuple[str, ...] = ()
    starts: bool = False
    stop: str = ""
    wait_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Done:
    """A step that was run. problem: what differs from the expectation; "": nothing."""

    text: str
    status: int
    output: str
    wall_s: float
    cpu_s: float
    problem: str = ""


@dataclass(slots=True)
class Session:
    """A folder in which one user types. environment: of the commands."""

    folder: Path
    environment: dict[str, str]
    _running: dict[str, tuple[subprocess.Popen[bytes], Path, float]] = field(default_factory=dict)

    def run(self, step: Step) -> Done | None:
        """Runs a step. None: a background command was started; its result comes when it is stopped."""
        time.sleep(step.wait_s)
        if step.stop:
            return self._stop(step)
        out = self.folder / f".output-{len(list(self.folder.glob('.output-*'))):03d}"
        begun_s = time.monotonic()
        with out.open("wb") as stream:
            process = subprocess.Popen(
                ["bash", "-c", f"exec {step.text}" if step.starts else step.text],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=stream,
                start_new_session=True,
                preexec_fn=_restore_ctrl_c,
            )
        if step.starts:
            self._running[step.text] = process, out, begun_s
            return None
        return _result(step, process, out, begun_s, LIMIT_S)

    def close(self) -> None:
        """Stops what still runs."""
        for process, _, _ in self._running.values():
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(STOP_LIMIT_S)
        self._running.clear()

    def _stop(self, step: Step) -> Done:
        process, out, begun_s = self._running.pop(step.stop)
        os.killpg(process.pid, signal.SIGINT)
        named = Step(step.stop, step.status, step.shows)
        return _result(named, process, out, begun_s, STOP_LIMIT_S)


def _restore_ctrl_c() -> None:
    """A shell starts background commands with SIGINT ignored, and what they start inherits it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _result(step: Step, process: subprocess.Popen[bytes], out: Path, begun_s: float, limit_s: float) -> Done:
    """Waits for a command, and compares. Its processor time includes that of processes that it has waited for."""
    end_s = time.monotonic() + limit_s
    problem = ""
    while True:
        pid, raw, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            break
        if time.monotonic() > end_s:
            problem = f"it had not ended after {limit_s:g} s"
            os.killpg(process.pid, signal.SIGKILL)
            _, raw, usage = os.wait4(process.pid, 0)
            break
        time.sleep(0.05)
    process.returncode = status = os.waitstatus_to_exitcode(raw)
    output = out.read_text(errors="replace")
    missing = [pattern for pattern in step.shows if not re.search(pattern, output)]
    if not problem and status != step.status:
        problem = f"exit status {status}, expected {step.status}"
    elif not problem and missing:
        problem = f"the output lacks {', '.join(missing)}"
    elif not problem and "Traceback" in output:
        problem = "the output contains a traceback"
    return Done(step.text, status, output, time.monotonic() - begun_s, usage.ru_utime + usage.ru_stime, problem)
