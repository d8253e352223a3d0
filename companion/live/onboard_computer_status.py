"""ONBOARD_COMPUTER_STATUS (390): state of the companion computer, for ground stations that show it. Off by default."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.mavlink.dialect import dialect
from osape_client.proto import osape_v1_pb2 as pb

PRIMARY = 0
"""Type of the primary computer on board."""
NONE_U8, NONE_I8, NONE_I16, NONE_U32 = 255, 127, 32_767, 0xFFFFFFFF
"""Values of fields that are not measured."""
MAX_CORES, MAX_TEMPERATURES = 8, 8
MEGA = 1 << 20


@dataclass(frozen=True, slots=True)
class CoreTimes:
    """Times of one core since boot, in kernel ticks."""

    busy: int
    all: int


class ComputerStatus:
    """Builds the message once per second. The load of each core is measured since the previous message."""

    def __init__(self, folder: Path, stat: Path = Path("/proc/stat"), meminfo: Path = Path("/proc/meminfo")) -> None:
        """folder: on the disk that logs are written to."""
        self._folder, self._stat, self._meminfo = folder, stat, meminfo
        self._before = self._cores()

    def message(self, health: pb.Health) -> Any:
        """health: the newest report, which gives temperatures and uptime."""
        used_mb, all_mb = self._memory_mb()
        disk_used_mb, disk_all_mb = self._disk_mb()
        temperatures = [max(-128, min(126, round(t.celsius))) for t in health.temperatures[:MAX_TEMPERATURES]]
        cores = self._shares()
        whole = round(sum(cores) / len(cores)) if cores else NONE_U8
        return dialect.MAVLink_onboard_computer_status_message(
            time_usec=health.t_ns // 1000,
            uptime=min(health.uptime_ns // 1_000_000, NONE_U32),
            type=PRIMARY,
            cpu_cores=_filled(cores[:MAX_CORES], MAX_CORES, NONE_U8),
            cpu_combined=_filled([whole], 10, NONE_U8),
            gpu_cores=[NONE_U8] * 4,
            gpu_combined=[NONE_U8] * 10,
            temperature_board=NONE_I8,
            temperature_core=_filled(temperatures, MAX_TEMPERATURES, NONE_I8),
            fan_speed=[NONE_I16] * 4,
            ram_usage=used_mb,
            ram_total=all_mb,
            storage_type=[NONE_U32] * 4,
            storage_usage=_filled([disk_used_mb], 4, NONE_U32),
            storage_total=_filled([disk_all_mb], 4, NONE_U32),
            link_type=[NONE_U32] * 6,
            link_tx_rate=[NONE_U32] * 6,
            link_rx_rate=[NONE_U32] * 6,
            link_tx_max=[NONE_U32] * 6,
            link_rx_max=[NONE_U32] * 6,
        )

    def _shares(self) -> list[int]:
        """Load of each core since the previous call, percent."""
        now = self._cores()
        shares = [
            max(0, min(100, round(100.0 * (b.busy - a.busy) / max(1, b.all - a.all))))
            for a, b in zip(self._before, now, strict=False)
        ]
        self._before = now
        return shares

    def _cores(self) -> list[CoreTimes]:
        cores = []
        try:
            lines = self._stat.read_text().splitlines()
        except OSError:
            return []
        for line in lines:
            words = line.split()
            if words and words[0].startswith("cpu") and words[0] != "cpu":
                ticks = [int(word) for word in words[1:9]]  # guest time is included in user time
                cores.append(CoreTimes(sum(ticks) - ticks[3] - ticks[4], sum(ticks)))
        return cores

    def _memory_mb(self) -> tuple[int, int]:
        """Used and total memory, MB."""
        try:
            rows = dict(line.split(":", 1) for line in self._meminfo.read_text().splitlines())
            all_kb, free_kb = (int(rows[name].split()[0]) for name in ("MemTotal", "MemAvailable"))
        except (OSError, KeyError, ValueError):
            return NONE_U32, NONE_U32
        return (all_kb - free_kb) // 1024, all_kb // 1024

    def _disk_mb(self) -> tuple[int, int]:
        """Used and total disk space, MB."""
        try:
            usage = shutil.disk_usage(self._folder)
        except OSError:
            return NONE_U32, NONE_U32
        return usage.used // MEGA, usage.total // MEGA


def _filled(values: list[int], length: int, nothing: int) -> list[int]:
    return values + [nothing] * (length - len(values))
