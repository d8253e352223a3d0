"""Runs the live service without hardware: service, simulated autopilot and a subscriber, each in its own process.

Only the camera and the autopilot are simulated: processes, shared memory, MAVLink over UDP, clocks, ZeroMQ and the log
are those of a flight."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import zmq

from drivers.base import DriverError
from osape_client.proto import osape_v1_pb2 as pb

from ..config.loader import Config, values_of
from ..config.sections import SECTIONS, fields_of
from ..live.health_stream import newest_health
from ..log.log_directory import files_of
from .listener import ReceiveStats

ACTIVE_TIMEOUT_S = 90.0
"""Longest wait for the first valid frame: a slow computer renders the flight first."""
END_S = 20.0
CHILD = """import runpy, sys
from companion.stop_signal import stop_with_parent
stop_with_parent()
del sys.argv[0]
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)"""
"""Runs the module that its first argument names. A process of a killed demo would go on and record."""
ACTIVE_STATES = (pb.Health.STATE_ACTIVE, pb.Health.STATE_DEGRADED)

Progress = Callable[[float], None]


class DemoError(Exception):
    """A fault of a part of the demo; the message names the part and shows its output."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveRun:
    """The result of the flight."""

    log: Path  # the recorder's file
    health: pb.Health  # the last report
    received: ReceiveStats  # by the subscriber
    duration_s: float


def live_config(config: Config, folder: Path, run: Path) -> Config:
    """The configuration with changed addresses: a free port for the autopilot, sockets in `run`, logs in `folder`."""
    record = replace(
        config.record, record="always", folder=str(folder), file_mb=4096.0, budget_mb=8192.0, file_s=7200.0
    )
    publish = replace(config.publish, prisms=f"ipc://{run}/prisms", health=f"ipc://{run}/health", keys="")
    autopilot = replace(config.autopilot, address=f"udpin:127.0.0.1:{free_port()}")
    return replace(config, record=record, publish=publish, autopilot=autopilot)


def toml_of(config: Config) -> str:
    """The configuration as a file for `companion run`."""
    lines: list[str] = []
    for name in SECTIONS:
        for section in config.cameras if name == "camera" else (values_of(config, name),):
            lines.append("[[camera]]" if name == "camera" else f"[{name}]")
            values = ((f.name, getattr(section, f.name)) for f in fields_of(name))
            # numbers, strings and booleans are the same in JSON and TOML
            lines += [f"{key} = {json.dumps(value)}" for key, value in values if value is not None]
    return "\n".join(lines) + "\n"


def fly(config: Config, folder: Path, duration_s: float, on_progress: Progress = lambda share: None) -> LiveRun:
    """Flies for duration_s from the first valid frame. Raises DemoError. The caller has the sole use of the folder."""
    run = Path(tempfile.mkdtemp(prefix="osape-"))  # a short path: that of a socket is limited to 107 characters
    logs = folder / "demo-flight"
    shutil.rmtree(logs, ignore_errors=True)
    logs.mkdir(parents=True)
    live = live_config(config, logs.resolve(), run)
    file = run / "demo.toml"
    file.write_text(toml_of(live), encoding="utf-8")
    processes = Processes(run)
    try:
        processes.start("autopilot", "companion", "simulate-autopilot", "-c", str(file))
        processes.start("service", "companion", "run", "-c", str(file))
        processes.start("subscriber", "companion.demo.listener", live.publish.prisms)
        began_s = _wait_until_active(live.publish.health, processes)
        while time.monotonic() - began_s < duration_s:
            processes.check()
            on_progress((time.monotonic() - began_s) / duration_s)
            time.sleep(0.1)
        health = newest_health(live.publish.health, 5.0)
        received = ReceiveStats(**json.loads(processes.end("subscriber")))
        processes.end("service")
        processes.end("autopilot")
    finally:
        processes.kill()
        shutil.rmtree(run, ignore_errors=True)
    recorded = [f.path for f in files_of(logs) if not f.active]
    if len(recorded) != 1:
        raise DemoError(
            f"{logs}: {len(recorded)} finished logs, expected one; check the free space there. The service reported: "
            f"{'; '.join(health.troubles) or 'no fault'}"
        )
    return LiveRun(log=recorded[0], health=health, received=received, duration_s=duration_s)


def _wait_until_active(address: str, processes: Processes) -> float:
    """Waits for the first valid frame; returns its time."""
    end_s = time.monotonic() + ACTIVE_TIMEOUT_S
    report: pb.Health | None = None
    while time.monotonic() < end_s:
        processes.check()
        try:
            report = newest_health(address, 2.0)
        except (DriverError, zmq.ZMQError):
            continue
        if report.state in ACTIVE_STATES and report.frames_used > 0:
            return time.monotonic()
    diagnostics = "; ".join(report.troubles) if report is not None else "no health report"
    raise DemoError(f"no valid frame within {ACTIVE_TIMEOUT_S:g} s: {diagnostics}\n{processes.output('service')}")


class Processes:
    """The demo's processes; their output is in files beside the sockets."""

    def __init__(self, run: Path) -> None:
        self._run = run
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, module: str, *output: str) -> None:
        """Starts `python -m module` with these arguments; it ends with this process."""
        environment = {**os.environ, "RUNTIME_DIRECTORY": str(self._run), "STATE_DIRECTORY": str(self._run)}
        with (self._run / f"{name}.out").open("wb") as out, (self._run / f"{name}.err").open("wb") as err:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-c", CHILD, module, *output],
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=err,
                env=environment,
            )

    def check(self) -> None:
        """Raises DemoError when a process has ended."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                raise DemoError(f"the {name} ended unexpectedly with status {process.returncode}\n{self.output(name)}")

    def end(self, name: str) -> str:
        """Ends a process and returns its output. Raises DemoError when it does not end, or fails."""
        process = self._processes.pop(name)
        process.terminate()
        try:
            status = process.wait(END_S)
        except subprocess.TimeoutExpired as error:
            process.kill()
            raise DemoError(f"the {name} did not end within {END_S:g} s\n{self.output(name)}") from error
        if status != 0:
            raise DemoError(f"the {name} ended with status {status}\n{self.output(name)}")
        return (self._run / f"{name}.out").read_text(encoding="utf-8")

    def output(self, name: str) -> str:
        """The last lines of its stderr."""
        return "\n".join((self._run / f"{name}.err").read_text(encoding="utf-8", errors="replace").splitlines()[-12:])

    def kill(self) -> None:
        """Kills all running processes."""
        for process in self._processes.values():
            process.kill()
            process.wait()
        self._processes.clear()


def free_port() -> int:
    """A free UDP port of this computer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: Any = probe.getsockname()[1]
        return int(port)
