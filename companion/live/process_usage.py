"""Processor time, memory and temperatures in the health report."""

from __future__ import annotations

import resource
import time
from contextlib import suppress
from pathlib import Path

from osape_client.proto import osape_v1_pb2 as pb

NS = 1_000_000_000
THERMAL = Path("/sys/class/thermal")


class ProcessUsage:
    """Processor time, memory and temperatures of the service."""

    def __init__(self) -> None:
        self._begun_ns = self._last_ns = time.monotonic_ns()
        self._cpu_s = _cpu_s()

    def fill(self, message: pb.Health) -> None:
        """Fills these fields of a report. The processor's share is measured since the previous call."""
        now_ns, cpu_s = time.monotonic_ns(), _cpu_s()
        message.uptime_ns = now_ns - self._begun_ns
        message.cpu_share = (cpu_s - self._cpu_s) / max(1e-3, (now_ns - self._last_ns) / NS)
        self._last_ns, self._cpu_s = now_ns, cpu_s
        with suppress(OSError):  # no file can be opened: the rest of the report counts
            message.memory_bytes = _memory_bytes()
            message.temperatures.extend(_temperatures())


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _memory_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def _temperatures() -> list[pb.Temperature]:
    """Temperatures of the system's thermal sensors."""
    found = []
    for zone in sorted(THERMAL.glob("thermal_zone*")):
        try:
            celsius = int((zone / "temp").read_text()) / 1000.0
            found.append(pb.Temperature(sensor=(zone / "type").read_text().strip(), celsius=celsius))
        except (OSError, ValueError):
            continue  # the sensor is switched off
    return found
