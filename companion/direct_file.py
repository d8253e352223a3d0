"""A file for logs in flight that is written past the page cache, in whole blocks from one buffer that stays.

A log is written once and not read in flight: in the page cache its megabytes only take the place of something else, and
each page must be found first, which costs more than the writing where memory is given back to a host. What the disk
takes is the same: the recorder waits for it once a second in any case.

The last block is written as often as it grows, filled up with zeros: until the file is closed it may so end in less than
a block of zeros, which those who read unfinished logs know (`drivers/mcap_scan.py`). Where a file system does not take
direct writes (tmpfs before Linux 6.6, some network folders), the same is written through the page cache."""

from __future__ import annotations

import errno
import fcntl
import io
import mmap
import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

BLOCK: Final = 4096
"""Bytes; a multiple of every usual disk's sector, and of what direct writes ask of memory and lengths."""
BUFFER_BYTES: Final = 1 << 20
"""More than most compressed chunks have. What is larger is written in parts."""


class DirectFile(io.RawIOBase):
    """A new file (one that is there is emptied). `write` only keeps; `flush` hands all of it to the kernel, from when on
    it outlives this process; `truncate` at the end takes off the zeros. Raises OSError, as files do."""

    def __init__(self, path: Path, buffer_bytes: int = BUFFER_BYTES) -> None:
        self._descriptor, self._direct = _opened(path)
        # memory of its own begins with a page, as direct writes ask
        self._buffer = memoryview(mmap.mmap(-1, buffer_bytes))
        self._filled = 0
        self._begin = 0
        self._flushed = True

    @property
    def direct(self) -> bool:
        """Whether the page cache is passed by."""
        return self._direct

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def tell(self) -> int:
        """Bytes given so far."""
        return self._begin + self._filled

    def writable(self) -> bool:
        """It can be written and nothing else."""
        return True

    def write(self, data: ReadableBuffer, /) -> int:
        """Keeps all of it, and writes what the buffer cannot hold."""
        if self.closed:
            raise ValueError("write to a closed file")
        given = memoryview(data).cast("B")
        size, taken = len(given), 0
        while taken < size:
            part = min(size - taken, len(self._buffer) - self._filled)
            self._buffer[self._filled : self._filled + part] = given[taken : taken + part]
            self._filled += part
            taken += part
            self._flushed = False
            if self._filled == len(self._buffer):
                self.flush()
        return size

    def flush(self) -> None:
        """Hands everything to the kernel; of the last block zeros beyond what was given."""
        if self.closed or self._flushed:
            return
        whole = self._filled // BLOCK * BLOCK
        rest = self._filled - whole
        end = whole + BLOCK if rest else whole
        self._buffer[self._filled : end] = bytes(end - self._filled)
        self._put(end)
        # the block that is not full stays, and is written again with what follows
        self._buffer[:rest] = bytes(self._buffer[whole : self._filled])
        self._begin += whole
        self._filled, self._flushed = rest, True

    def truncate(self, size: int | None = None, /) -> int:
        """Ends the file after what was given, or before."""
        self.flush()
        end = self.tell() if size is None else size
        os.ftruncate(self._descriptor, end)
        return end

    def close(self) -> None:
        """Ends the file after what was given and closes it, also where that fails. May be called again."""
        if self.closed:
            return
        try:
            self.truncate()
        finally:
            self._flushed = True  # what could not be written now is not tried again
            super().close()
            os.close(self._descriptor)

    def _put(self, size: int) -> None:
        """The first so many bytes of the buffer, whole blocks, where they belong."""
        done = 0
        while done < size:
            try:
                done += os.pwrite(self._descriptor, self._buffer[done:size], self._begin + done)
            except OSError as error:
                if error.errno != errno.EINVAL or not self._direct:
                    raise
                self._direct = False  # a file system that says so only now, or after a write that it cut short
                flags = fcntl.fcntl(self._descriptor, fcntl.F_GETFL)
                fcntl.fcntl(self._descriptor, fcntl.F_SETFL, flags & ~os.O_DIRECT)


def _opened(path: Path) -> tuple[int, bool]:
    """A descriptor, and whether it writes directly."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
    try:
        return os.open(path, flags | os.O_DIRECT, 0o666), True
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
    return os.open(path, flags, 0o666), False
