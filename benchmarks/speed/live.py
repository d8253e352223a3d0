"""The live service over minutes: `python -m benchmarks.speed.live --minutes 10`.

Service, camera process, autopilot and subscriber are real processes with real sockets; the log is written. The camera's
frames were rendered before, so that only what a real camera's driver would cost is in the figures, and arrive at the
instant of their exposure: every attitude is extrapolated. The configuration is the text of configs/simulated.toml but for
flight, rate, port and places. After the warm-up it counts what the subscriber did not get, the time from each exposure to
it, and what the processes took. --hz 12 --flight trees for other cases."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zmq

from companion.demo.demo import EMBEDDED
from companion.demo.live import free_port
from companion.live.health_stream import newest_health
from osape_client.proto import osape_v1_pb2 as pb

NS = 1_000_000_000
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGE_SIZE")
PATIENCE_S = 180.0
SEED = EMBEDDED.cameras[0].seed
"""As it has it, too."""
SHIPPED = Path(__file__).parents[2] / "configs" / "simulated.toml"
RECORD_KEYS = """[record]
folder = "{folder}/logs"
budget_mb = 20000.0
"""
ADDRESS_KEYS = """
[publish]
prisms = "ipc://{folder}/prisms"
health = "ipc://{folder}/health"
depth = "ipc://{folder}/depth"
"""


def shipped(shown: dict[str, str | int | float]) -> str:
    """configs/simulated.toml with other values for these keys. Raises ValueError where it has one of them not once."""
    text = SHIPPED.read_text()
    for key, value in shown.items():
        text, found = re.subn(rf"(?m)^{key} = .*$", f"{key} = {json.dumps(value)}", text)
        if found != 1:
            raise ValueError(f"{SHIPPED.name}: {found} lines `{key} = ..`, expected one")
    return text


@dataclass(slots=True)
class Ear:
    """What a subscriber gets, from `begin` on."""

    ages_ms: list[float] = field(default_factory=list)
    sequences: list[int] = field(default_factory=list)
    blind: dict[str, int] = field(default_factory=dict)
    valid: bool = False

    def listen(self, address: str, stop: threading.Event) -> None:
        """Receives until stopped."""
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        subscriber = context.socket(zmq.SUB)
        subscriber.setsockopt(zmq.SUBSCRIBE, b"")
        subscriber.setsockopt(zmq.RCVTIMEO, 100)
        subscriber.connect(address)
        while not stop.is_set():
            try:
                data = subscriber.recv()
            except zmq.Again:
                continue
            now_ns = time.monotonic_ns()
            message = pb.PrismsFrame.FromString(data)
            self.valid = message.valid
            if not message.valid:
                self.blind[message.cause_text] = self.blind.get(message.cause_text, 0) + 1
                continue
            self.sequences.append(message.sequence)
            self.ages_ms.append((now_ns - message.t_exposure_ns) / 1e6)
        context.destroy(linger=0)

    def begin(self) -> None:
        """Forgets what came so far."""
        self.ages_ms, self.sequences, self.blind = [], [], {}

    @property
    def missed(self) -> int:
        """Frames between the first and the last that did not come."""
        return self.sequences[-1] - self.sequences[0] + 1 - len(self.sequences) if self.sequences else 0


@dataclass(frozen=True, slots=True)
class Taken:
    """Of one process: CPU seconds so far, seconds that its threads were ready and waited for a processor that others had,
    resident bytes."""

    cpu_s: float
    waited_s: float
    bytes: int


def taken(pid: int) -> Taken:
    """What a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return Taken((int(fields[11]) + int(fields[12])) * TICK_S, _waited_s(pid), pages * PAGE)


def _waited_s(pid: int) -> float:
    """Of all its threads: if large compared with the CPU seconds, other programs used the processors and the times are
    not valid."""
    waited_ns = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):  # a thread that has just ended
            waited_ns += int((task / "schedstat").read_text().split()[1])
    return waited_ns / NS


def stolen_s() -> float:
    """Seconds that this machine's processors were ready and the host of a virtual machine gave them to others, so far."""
    return int(Path("/proc/stat").read_text().split("\n", 1)[0].split()[8]) * TICK_S / (os.cpu_count() or 1)


def child_of(pid: int) -> int:
    """The camera's process. Raises LookupError."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
            except OSError:
                continue  # it has just ended
            if int(stat.rsplit(")", 1)[1].split()[1]) == pid:
                return int(entry.name)
    raise LookupError("the service has no camera process")


@contextmanager
def running(*words: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Runs `python -m companion` with these arguments; it is ended at the end."""
    with log.open("wb") as out:
        process = subprocess.Popen([sys.executable, "-m", "companion", *words], stdout=out, stderr=out)
    try:
        yield process
        process.terminate()
        process.wait(30.0)
    finally:
        process.kill()


def config_text(args: argparse.Namespace, folder: Path) -> str:
    """configs/simulated.toml with the flight, rate, port and places of a run."""
    text = shipped(
        {
            "flight": args.flight,
            "width_px": args.width,
            "fps": args.hz,
            "seed": args.seed,
            "address": f"udpin:127.0.0.1:{free_port()}",
            "record": "off" if args.no_log else "always",
        }
    )
    return text.replace("[record]\n", RECORD_KEYS.format(folder=folder)) + ADDRESS_KEYS.format(folder=folder)


def measure(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Runs the service; the figures. Raises TimeoutError when it does not see."""
    config = folder / "live.toml"
    config.write_text(config_text(args, folder))
    ear, stop, health = Ear(), threading.Event(), f"ipc://{folder}/health"
    with ExitStack() as stack:
        stack.enter_context(running("simulate-autopilot", "-c", str(config), log=folder / "autopilot.txt"))
        service = stack.enter_context(running("run", "-c", str(config), log=folder / "service.txt"))
        listener = threading.Thread(target=ear.listen, args=(f"ipc://{folder}/prisms", stop))
        listener.start()
        stack.callback(listener.join)
        stack.callback(stop.set)
        end_s = time.monotonic() + PATIENCE_S
        while not ear.valid:
            if time.monotonic() > end_s or service.poll() is not None:
                raise TimeoutError(f"the service does not see: {(folder / 'service.txt').read_text()[-2000:]}")
            time.sleep(0.1)
        time.sleep(args.warm_up)
        before = newest_health(health, 5.0)
        pids = {"service": service.pid, "camera": child_of(service.pid)}
        ear.begin()
        begun_s, first, stolen_before_s = time.monotonic(), {name: taken(pid) for name, pid in pids.items()}, stolen_s()
        sizes: list[int] = []
        while time.monotonic() - begun_s < args.minutes * 60.0:
            time.sleep(1.0)
            sizes.append(taken(service.pid).bytes)
        seconds = time.monotonic() - begun_s
        last, stolen = {name: taken(pid) for name, pid in pids.items()}, stolen_s() - stolen_before_s
        after = newest_health(health, 5.0)
    found = figures(args, ear, seconds, first, last, sizes, before, after)
    return found | {"stolen_by_the_host_percent": round(100.0 * stolen / seconds, 2)}


def figures(
    args: argparse.Namespace,
    ear: Ear,
    seconds: float,
    first: dict[str, Taken],
    last: dict[str, Taken],
    sizes: list[int],
    before: pb.Health,
    after: pb.Health,
) -> dict[str, Any]:
    """All of it as plain values."""
    ages = np.array(ear.ages_ms)
    quarter = max(1, len(sizes) // 4)
    p50, p95, p99 = (round(float(np.percentile(ages, p)), 2) for p in (50, 95, 99))
    return {
        "flight": args.flight,
        "hz": args.hz,
        "minutes": round(seconds / 60.0, 2),
        "frames": len(ages),
        "missed_by_the_subscriber": ear.missed,
        "blind_messages": ear.blind,
        "dropped_by_the_service": {k: n - before.frames_dropped[k] for k, n in after.frames_dropped.items()},
        "samples_lost": after.samples_lost - before.samples_lost,
        "log_dropped": after.recording.dropped - before.recording.dropped,
        "log_mb_per_minute": round((after.recording.bytes - before.recording.bytes) / 1e6 / seconds * 60.0, 1),
        "exposure_to_subscriber_ms": {"p50": p50, "p95": p95, "p99": p99, "worst": round(float(ages.max()), 2)},
        "stages_ms": {x.stage: [round(v, 2) for v in (x.p50_ms, x.p95_ms, x.p99_ms)] for x in after.latencies},
        "cpu_percent": {n: round(100.0 * (last[n].cpu_s - first[n].cpu_s) / seconds, 1) for n in first},
        "waited_for_a_processor_percent": {
            n: round(100.0 * (last[n].waited_s - first[n].waited_s) / seconds, 1) for n in first
        },
        "service_mb": [round(float(np.median(part)) / 1e6, 1) for part in (sizes[:quarter], sizes[-quarter:])],
        "starts_of_the_camera": after.cameras[0].starts,
        "troubles": list(after.troubles),
    }


def main() -> int:
    """0: measured; 1: it did not see."""
    parser = argparse.ArgumentParser(description="the live service over minutes")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--warm-up", type=float, default=15.0, help="seconds from the first prisms on (15)")
    parser.add_argument("--flight", default="street")
    parser.add_argument("--hz", type=float, default=30.0)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--no-log", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="osape-") as folder:
        try:
            print(json.dumps(measure(args, Path(folder)), indent=1))
        except TimeoutError as error:
            print(error, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
