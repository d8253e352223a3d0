"""How soon the live service is there: `python -m benchmarks.speed.start [--runs 5] [--python FILE] [--first]`.

Real processes and sockets: the service as systemd would start it, a simulated camera, a simulated autopilot over UDP, a
subscriber. Compiled kernels are in the cache, as they are after `companion install`, and the modules' bytecode beside
them, as pip leaves it. Measured, each as the median and the worst of the runs:

- start to ready: from the start of the interpreter until READY;
- kill -9 to ready: from the signal until READY of the next process, with the unit's wait of 0.1 s before it;
- attitude to prisms: from the first attitude on the line until the first valid prisms at the subscriber, the service and
  the camera running before;
- start to prisms: from the start of the interpreter until then, the autopilot sending already;
- first start to prisms (`--first`): the same with an empty cache of compiled kernels, of an installation that contains
  them, as a package does. `--python` names the interpreter of that installation."""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import zmq

from companion.autopilot.simulate_autopilot import flight_of, simulated
from companion.config.loader import load_config
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from osape_client.proto import osape_v1_pb2 as pb

RESTART_S = 0.1
PATIENCE_S = 60.0
CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 640
[autopilot]
address = "udpin:127.0.0.1:{port}"
[record]
record = "off"
"""
SERVICE = "import sys; from companion.cli import main; sys.exit(main(['run', '-c', sys.argv[1]]))"


class Place:
    """Folders and sockets of one service, as systemd would give them."""

    def __init__(self, folder: Path, python: Path) -> None:
        self._folder, self._python = folder, python
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        self.config = folder / "start.toml"
        self.config.write_text(CONFIG.format(port=self.port))
        self._notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._notify.bind(str(folder / "notify"))
        self._notify.settimeout(PATIENCE_S)
        self._environment = {
            **os.environ,
            "NOTIFY_SOCKET": str(folder / "notify"),
            "RUNTIME_DIRECTORY": str(folder / "run"),
            "STATE_DIRECTORY": str(folder / "state"),
        }
        self._environment.pop("PYTHONDONTWRITEBYTECODE", None)  # else each start compiles our own modules once more
        self.prisms = f"ipc://{folder / 'run' / 'prisms'}"

    @contextlib.contextmanager
    def service(self, **variables: str) -> Iterator[subprocess.Popen[bytes]]:
        """A running service with these variables of its environment, killed at the end."""
        process = subprocess.Popen(
            [self._python, "-c", SERVICE, str(self.config)],
            env=self._environment | variables,
            cwd=self._folder,
            stderr=subprocess.DEVNULL,
        )
        try:
            yield process
        finally:
            process.kill()
            process.wait()

    def wait_ready(self) -> None:
        """Until READY; raises TimeoutError."""
        while b"READY=1" not in self._notify.recv(4096):
            pass

    def forget(self) -> None:
        """The output of an ended process."""
        self._notify.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._notify.recv(4096)
        self._notify.settimeout(PATIENCE_S)

    @contextlib.contextmanager
    def autopilot(self) -> Iterator[None]:
        """It sends from now on."""
        with AutopilotLink(simulated(flight_of(load_config(self.config))), UdpEnd("127.0.0.1", self.port)):
            yield


def until_prisms(address: str, good: Callable[[pb.PrismsFrame], bool]) -> None:
    """Until such a message comes; raises TimeoutError."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    subscriber = context.socket(zmq.SUB)
    subscriber.setsockopt(zmq.SUBSCRIBE, b"")
    subscriber.setsockopt(zmq.RECONNECT_IVL, 10)
    subscriber.connect(address)
    end_s = time.monotonic() + PATIENCE_S
    try:
        while time.monotonic() < end_s:
            if subscriber.poll(1000) and good(pb.PrismsFrame.FromString(subscriber.recv())):
                return
        raise TimeoutError(f"nothing of the kind on {address} within {PATIENCE_S:g} s")
    finally:
        context.destroy(linger=0)


def measure(place: Place) -> dict[str, float]:
    """Seconds of one run."""
    found: dict[str, float] = {}
    begun_s = time.monotonic()
    with place.service() as process:
        place.wait_ready()
        found["start to ready"] = time.monotonic() - begun_s
        begun_s = time.monotonic()
        process.kill()
        process.wait()
        place.forget()
        time.sleep(RESTART_S)  # systemd's RestartSec, a part of what is measured
        with place.service():
            place.wait_ready()
            found["kill -9 to ready"] = time.monotonic() - begun_s
            until_prisms(place.prisms, lambda m: m.cause == pb.CAUSE_NO_ATTITUDE)  # the camera delivers
            begun_s = time.monotonic()
            with place.autopilot():
                until_prisms(place.prisms, lambda m: m.valid)
                found["attitude to prisms"] = time.monotonic() - begun_s
    place.forget()
    with place.autopilot():
        begun_s = time.monotonic()
        with place.service():
            until_prisms(place.prisms, lambda m: m.valid)
            found["start to prisms"] = time.monotonic() - begun_s
    place.forget()
    return found


def measure_first(place: Place) -> dict[str, float]:
    """Seconds of one run with an empty cache of compiled kernels."""
    with tempfile.TemporaryDirectory() as cache, place.autopilot():
        begun_s = time.monotonic()
        with place.service(NUMBA_CACHE_DIR=cache):
            until_prisms(place.prisms, lambda m: m.valid)
            found = {"first start to prisms": time.monotonic() - begun_s}
    place.forget()
    return found


def runs_of(runs: int, python: Path = Path(sys.executable), first: bool = False) -> dict[str, list[float]]:
    """Seconds by measured quantity, from a number of runs after one that fills the caches."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder), python)
        with place.service():
            place.wait_ready()  # kernels compiled, frames rendered, files in memory
            with place.autopilot():
                until_prisms(place.prisms, lambda m: m.valid)
        place.forget()
        found = [measure(place) | (measure_first(place) if first else {}) for _ in range(runs)]
    return {name: [f[name] for f in found] for name in found[0]}


def main() -> int:
    """0: measured."""
    parser = argparse.ArgumentParser(description="how soon the live service is there")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--python", type=Path, default=Path(sys.executable), help="interpreter that runs the service")
    parser.add_argument("--first", action="store_true", help="measure starts with an empty cache of kernels, too")
    args = parser.parse_args()
    for name, times in runs_of(args.runs, args.python, args.first).items():
        print(f"{name:21s} {statistics.median(times):5.2f} s, worst {max(times):5.2f} s of {args.runs}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
