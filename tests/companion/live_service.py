"""The service as a process, with a simulated autopilot and subscribers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import zmq

from companion.autopilot.simulate_autopilot import flight_of, simulated
from companion.config.loader import load_config
from core.frames import rotation_from_quaternion
from drivers.simulation.autopilot import PX4
from drivers.simulation.autopilot_link import AutopilotLink, Faults, UdpEnd
from drivers.simulation.looping_flight import LoopingFlight
from osape_client.proto import osape_v1_pb2 as pb
from tests.ports import free_port
from tests.waiting import PATIENCE_S, until

ROOT = Path(__file__).parents[2]
NS = 1_000_000_000
SUPERVISION = f"[supervision]\nopen_s = {PATIENCE_S}\n"
"""A camera process that is ended because it opens slowly, as on a busy machine, begins again and never opens."""


class Subscription(threading.Thread):
    """Subscribes to one stream and keeps all messages. received: (monotonic ns, message)."""

    def __init__(self, address: str, kind: type[Any]) -> None:
        super().__init__(daemon=True)
        self._address, self._kind = address, kind
        self._closed = threading.Event()
        self.received: list[tuple[int, Any]] = []
        self.start()

    def run(self) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        subscriber = context.socket(zmq.SUB)
        subscriber.setsockopt(zmq.SUBSCRIBE, b"")
        subscriber.connect(self._address)
        while not self._closed.is_set():
            if subscriber.poll(50):
                self.received.append((time.monotonic_ns(), self._kind.FromString(subscriber.recv())))
        context.destroy(linger=0)

    def close(self) -> None:
        self._closed.set()
        self.join()

    def since(self, t_ns: int) -> list[Any]:
        """Messages received at t_ns or later."""
        return [m for at_ns, m in list(self.received) if at_ns >= t_ns]

    def wait(self, wanted: Callable[[Any], bool], seconds: float, since_ns: int | None = None) -> Any:
        """The first message received from now (or since_ns) that is wanted. Fails when none arrives within `seconds` of that."""
        begun_ns = time.monotonic_ns() if since_ns is None else since_ns
        found: list[Any] = []

        def found_one() -> bool:
            found.extend(m for at, m in list(self.received) if begun_ns <= at <= begun_ns + seconds * NS and wanted(m))
            return bool(found)

        left_s = seconds - (time.monotonic_ns() - begun_ns) / NS
        assert until(found_one, max(0.1, left_s)), f"not received within {seconds} s; received: {self._texts(begun_ns)}"
        return found[0]

    def _texts(self, since_ns: int) -> list[str]:
        """The newest texts received, each once."""
        texts = [
            "; ".join(m.troubles) or "OK" if isinstance(m, pb.Health) else m.cause_text or "valid"
            for m in self.since(since_ns)
        ]
        return list(dict.fromkeys(texts))[-12:]


class Live:
    """`companion run` as a process.

    sections: TOML; {cable} is replaced by the path of a file (deleted: the camera is unplugged), {port} by a free UDP port. The
    limit for opening a camera is added.
    renders: directory of rendered frames.
    quick: some intervals are shorter, see `quick_service`."""

    def __init__(self, folder: Path, sections: str, renders: Path, *, quick: bool = False) -> None:
        self.folder, self.cable = folder, folder / "cable"
        self._program = "tests.companion.quick_service" if quick else "companion"
        self.port = free_port()
        self.config = folder / "live.toml"
        self.cable.touch()
        head = SUPERVISION.partition("\n")[0] + "\n"
        sections = sections.replace(head, SUPERVISION) if head in sections else f"{sections}\n{SUPERVISION}"
        self.config.write_text(sections.replace("{cable}", str(self.cable)).replace("{port}", str(self.port)))
        (folder / "run").mkdir()
        self.environment = os.environ | {
            "RUNTIME_DIRECTORY": str(folder / "run"),
            "STATE_DIRECTORY": str(folder / "state"),
            "CACHE_DIRECTORY": str(renders),
            "PYTHONPATH": str(ROOT),
        }
        self.process: subprocess.Popen[str] | None = None
        self._subscriptions: list[Subscription] = []

    @property
    def logs(self) -> list[Path]:
        """The recorded logs, oldest first."""
        return sorted((self.folder / "state" / "logs").glob("*"))

    def flight(self) -> LoopingFlight:
        """The flight of the first simulated camera."""
        return flight_of(load_config(self.config))

    def start(self, *before: str) -> None:
        """Starts the service without waiting until it is ready. before: a command that executes the one after it."""
        with (self.folder / "output.txt").open("a") as output:
            self.process = subprocess.Popen(
                [*before, sys.executable, "-m", self._program, "run", "-c", str(self.config)],
                cwd=ROOT,
                env=self.environment,
                stdout=output,
                stderr=output,
                text=True,
            )

    def output(self) -> str:
        """What the service printed."""
        return (self.folder / "output.txt").read_text()

    def command(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Runs another command with the same environment."""
        return subprocess.run(
            [sys.executable, "-m", "companion", *arguments],
            cwd=ROOT,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )

    def subscribe(self, stream: str, kind: type[Any]) -> Subscription:
        """A subscriber of a stream."""
        subscription = Subscription(f"ipc://{self.folder}/run/{stream}", kind)
        self._subscriptions.append(subscription)
        return subscription

    def stop(self, number: int = signal.SIGTERM, seconds: float = PATIENCE_S) -> int:
        """Sends a signal and waits for the end; returns the exit status."""
        assert self.process is not None
        self.process.send_signal(number)
        return self.process.wait(seconds)

    def kill(self) -> None:
        """Ends the service with SIGKILL, and waits until its camera processes have ended."""
        cameras = self.camera_pids().values()
        self.stop(signal.SIGKILL)
        assert until(lambda: not any(_exists(pid) for pid in cameras))

    def close(self) -> None:
        """Ends all remaining processes, including camera processes."""
        for subscription in self._subscriptions:
            subscription.close()
        if self.process is None:
            return
        cameras = self.camera_pids()
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for pid in cameras.values():
            if _exists(pid):
                os.kill(pid, signal.SIGKILL)

    def camera_pids(self) -> dict[str, int]:
        """Name of each camera -> id of its process."""
        found: dict[str, int] = {}
        for entry in Path("/proc").iterdir():
            try:
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1]) if entry.name.isdigit() else 0
                arguments = (entry / "cmdline").read_bytes().split(b"\0") if parent else []
            except (OSError, IndexError):
                continue  # it has just ended
            if self.process is not None and parent == self.process.pid and b"companion.cameras.worker" in arguments:
                name = arguments[-2].split(b'"name": "')[1].split(b'"')[0]
                found[name.decode()] = int(entry.name)
        return found

    def memory_bytes(self) -> int:
        """Resident memory of the service, without the cameras."""
        assert self.process is not None
        return int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def fill(descriptor: int) -> int:
    """Fills a pipe, so that the next write blocks; returns the number of bytes."""
    os.set_blocking(descriptor, False)
    written = 0
    with suppress(BlockingIOError):
        while True:
            written += os.write(descriptor, bytes(4096))
    os.set_blocking(descriptor, True)
    return written


@contextmanager
def unread_output(folder: Path) -> Iterator[tuple[str, ...]]:
    """A command for `Live.start` that gives the service a full pipe, which is not read, as stdout and stderr."""
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    descriptor = os.open(pipe, os.O_RDWR)
    try:
        fill(descriptor)
        yield "/bin/sh", "-c", f'exec "$@" >"{pipe}" 2>&1', "sh"
    finally:
        os.close(descriptor)


@contextmanager
def flown(live: Live, kind: str = PX4, faults: Faults | None = None) -> Iterator[AutopilotLink]:
    """A simulated autopilot on the service's UDP port, with the motion of the simulated camera."""
    autopilot = simulated(live.flight(), kind)
    autopilot.profile.boot_at_ns = time.monotonic_ns() - 30 * NS
    with AutopilotLink(autopilot, UdpEnd("127.0.0.1", live.port), faults) as line:
        yield line


def attitude_error_deg(message: pb.PrismsFrame, flight: LoopingFlight) -> float:
    """Angle between the attitude that a frame was levelled with and the true one at its exposure."""
    q = message.attitude.q_ned_frd
    turn = rotation_from_quaternion((q.w, q.x, q.y, q.z)).T @ flight.state(message.t_exposure_ns).R_ned_frd
    return float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))


def sent_ns(message: Any) -> int:
    """When the service sent a message of a frame."""
    return int(message.t_exposure_ns + message.publication.age_ns)
