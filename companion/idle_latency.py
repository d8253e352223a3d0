"""How deep the processors may sleep between two frames: the kernel's PM QoS, as long as the service runs.

A processor that sleeps deeply loses its caches and takes its time to wake up; under a hypervisor another guest moves in
meanwhile. Where `[service] idle_latency_us` asks for it, the kernel is told how late it may wake one up, by a file that
it heeds as long as it is open (Documentation/power/pm_qos_interface.rst of the kernel)."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Final

DEVICE: Final = Path("/dev/cpu_dma_latency")
DRIVER: Final = Path("/sys/devices/system/cpu/cpuidle/current_driver")
"""Of the states of sleep: without one the kernel takes the wish and halts idle processors all the same."""
NO_WISH: Final = -1


class IdleLatency:
    """`open` asks, `close` takes it back; so does the end of the process, whatever ends it."""

    def __init__(self, latency_us: int, device: Path | None = None, driver: Path | None = None) -> None:
        self._latency_us, self._device, self._driver = latency_us, device or DEVICE, driver or DRIVER
        self._file: int | None = None

    def open(self) -> str:
        """What is wrong, in words; empty where the kernel heeds the wish or there is none. Nothing else depends on it."""
        if self._latency_us == NO_WISH:
            return ""
        try:
            self._file = os.open(self._device, os.O_WRONLY | os.O_CLOEXEC)
            os.write(self._file, struct.pack("=i", self._latency_us))
        except OSError as error:
            self.close()
            return (
                f"idle_latency_us = {self._latency_us} is not heeded: {self._device}: {error.strerror}; "
                "`companion install` gives the right to it; a kernel without PM QoS does not have it"
            )
        return self._without_driver()

    def _without_driver(self) -> str:
        try:
            name = self._driver.read_text().strip()
        except OSError as error:
            name = error.strerror or str(error)
        else:
            if name != "none":
                return ""
        return (
            f"idle_latency_us = {self._latency_us} is not heeded: {self._driver}: {name}; without a driver the kernel halts "
            "idle processors whatever is wished; booted with idle=poll (x86) or nohlt (ARM) it lets none sleep"
        )

    def close(self) -> None:
        """May be called twice."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
