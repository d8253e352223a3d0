"""Timestamps of signatures: the wall clock in units of 10 us since 2015, never decreasing.

A receiver refuses timestamps that are not newer than those received before, so that neither a wall clock that is set
back nor a crash may repeat a timestamp. A file contains a timestamp ahead of all that were used. A separate thread
writes it before the timestamps are needed, since a slow disk must not delay the link."""

from __future__ import annotations

import os
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path

from ..watched_thread import WatchedThread

TICKS_PER_S = 100_000
EPOCH_UNIX_S = 1_420_070_400
"""2015-01-01."""
LAST_TICK = (1 << 48) - 1
AHEAD = 10 * TICKS_PER_S
"""The file reserves timestamps this far ahead of the wall clock. Ground stations accept a difference of a minute."""
AHEAD_OF_LAST = TICKS_PER_S // 10
"""Number of packets beyond the last timestamp that the file reserves at least, since repeated restarts may lead ahead
of the wall clock."""
AGAIN_S = 1.0
"""Time until the next attempt after a failure to write."""


def wall_ticks(unix_ns: int) -> int:
    """Returns the timestamp of a wall clock; 0 for one that was never set or is out of range."""
    ticks = (unix_ns - EPOCH_UNIX_S * 10**9) // 10_000
    return ticks if 0 <= ticks < LAST_TICK else 0


class SigningClock:
    """Timestamps of signatures: `next` for each packet, `received` with each verified timestamp of others.

    Timestamps must not be behind those of others.

    Attributes:
        fault: why timestamps cannot be stored, as text; empty: they are stored, or no file was given."""

    def __init__(self, file: Path | None = None, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._wall_ns = wall_ns
        self.fault = ""
        self._last = self._reserved = 0
        self._wanted, self._stop = threading.Event(), threading.Event()
        self._thread: WatchedThread | None = None
        if file is not None:
            self._last = self._reserved = self._read(file)
            self._reserve(file)
            self._thread = WatchedThread(self._keep, "signing clock", (file,))
            self._thread.start()

    @property
    def failure(self) -> str:
        """Exception that ended the storing of timestamps, as text; empty: none."""
        return self._thread.failure if self._thread is not None else ""

    def next(self) -> int:
        """Returns a timestamp that was never used before."""
        self._last = max(self._last + 1, self.now())
        self._want()
        return self._last

    def now(self) -> int:
        """Returns the newest timestamp: that of the wall clock, or one sent or received if it is later."""
        return max(self._last, wall_ticks(self._wall_ns()))

    def received(self, ticks: int) -> None:
        """Records a timestamp with a verified signature."""
        self._last = max(self._last, ticks)
        self._want()

    def close(self) -> None:
        """Ends the thread. May be called twice."""
        self._stop.set()
        self._wanted.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def _want(self) -> None:
        """Requests a new reservation in the file if half of the last one is used up."""
        wall = wall_ticks(self._wall_ns())
        if self._reserved < max(self._last + AHEAD_OF_LAST // 2, wall + AHEAD // 2):
            self._wanted.set()

    def _keep(self, file: Path) -> None:
        while not self._stop.is_set():
            self._wanted.wait()
            self._wanted.clear()
            if self._stop.is_set():
                return
            self._reserve(file)
            if self.fault:
                self._stop.wait(AGAIN_S)

    def _reserve(self, file: Path) -> None:
        ticks = min(LAST_TICK, max(self._last + AHEAD_OF_LAST, wall_ticks(self._wall_ns()) + AHEAD))
        new = file.with_name(file.name + ".new")
        text = str(ticks).encode()
        try:
            with new.open("wb") as stream:
                stream.write(b"%s %08x\n" % (text, zlib.crc32(text)))
                stream.flush()
                os.fsync(stream.fileno())
            new.replace(file)
        except OSError as error:
            self.fault = (
                f"the timestamps of signatures cannot be kept in {file} ({error.strerror}): if the clock is set back before "
                "the next start, the autopilot will ignore this service; make room or correct the rights of the file"
            )
            return
        self._reserved, self.fault = ticks, ""

    def _read(self, file: Path) -> int:
        """Returns the timestamp in the file; 0 if there is no file or its checksum is wrong."""
        try:
            text, _, check = file.read_bytes().strip().partition(b" ")
            if int(check, 16) == zlib.crc32(text) and 0 <= int(text) <= LAST_TICK:
                return int(text)
        except (OSError, ValueError):
            pass
        return 0
