"""A video device of the kernel below linuxpy: its requests are answered here, its buffers are those of a file."""

from __future__ import annotations

import errno
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from linuxpy import ioctl
from linuxpy.video import raw

WIDTH, HEIGHT = 32, 16
SLOT_BYTES = 4096


def fourcc(name: str) -> int:
    """The number of a pixel format's four characters."""
    return int.from_bytes(name.encode(), "little")


@dataclass
class FakeV4l2:
    """What the device is, and what it delivers. fails: request -> error; frames: (data, sequence, faulty), the next one first."""

    path: Path
    pixel_format: int = fourcc("Z16 ")
    width: int = WIDTH
    height: int = HEIGHT
    bytes_per_line: int = 2 * WIDTH
    capabilities: int = raw.Capability.VIDEO_CAPTURE | raw.Capability.STREAMING
    fails: dict[str, int] = field(default_factory=dict)
    frames: list[tuple[bytes, int, bool]] = field(default_factory=list)
    queued: list[int] = field(default_factory=list)

    def install(self, monkeypatch: pytest.MonkeyPatch) -> FakeV4l2:
        """Takes the place of the kernel."""
        self.path.write_bytes(bytes(4 * SLOT_BYTES))
        monkeypatch.setattr(ioctl, "fcntl", SimpleNamespace(ioctl=self.answer))
        return self

    def unplug(self) -> None:
        """From now on each request fails as that of a device that is gone."""
        self.fails = dict.fromkeys(("DQBUF", "QBUF", "STREAMOFF", "REQBUFS"), errno.ENODEV)

    @property
    def mappings(self) -> int:
        """Number of its buffers that are mapped into this process."""
        return Path("/proc/self/maps").read_text().count(str(self.path))

    @property
    def descriptors(self) -> int:
        """Number of its open file descriptors."""
        links = (Path("/proc/self/fd") / name for name in os.listdir("/proc/self/fd"))
        return sum(link.is_symlink() and os.readlink(link) == str(self.path) for link in links)

    def answer(self, _device: Any, request: Any, argument: Any = None) -> None:
        """One request. Raises OSError."""
        name = raw.IOC(request).name
        if name in self.fails:
            raise OSError(self.fails[name], os.strerror(self.fails[name]))
        answers = {"QUERYCAP": self._capability, "G_FMT": self._format, "QUERYBUF": self._query, "QBUF": self._queue}
        answers |= {"DQBUF": self._fill}
        if name in answers:
            answers[name](argument)

    def _capability(self, found: Any) -> None:
        found.capabilities = self.capabilities | raw.Capability.DEVICE_CAPS
        found.device_caps = self.capabilities

    def _format(self, found: Any) -> None:
        pix = found.fmt.pix
        pix.width, pix.height, pix.pixelformat = self.width, self.height, self.pixel_format
        pix.bytesperline, pix.sizeimage = self.bytes_per_line, self.bytes_per_line * self.height

    def _query(self, buffer: Any) -> None:
        buffer.length, buffer.m.offset = SLOT_BYTES, SLOT_BYTES * buffer.index

    def _queue(self, buffer: Any) -> None:
        """As the kernel, it clears what it had stated of the content."""
        self.queued.append(buffer.index)
        buffer.bytesused, buffer.flags, buffer.sequence = 0, 0, 0

    def _fill(self, buffer: Any) -> None:
        data, sequence, faulty = self.frames.pop(0)
        buffer.index = self.queued.pop(0)
        with self.path.open("r+b") as memory:
            memory.seek(SLOT_BYTES * buffer.index)
            memory.write(data)
        buffer.bytesused, buffer.sequence = len(data), sequence
        buffer.flags = raw.BufferFlag.ERROR if faulty else 0
        seconds, rest_ns = divmod(time.monotonic_ns(), 10**9)
        buffer.timestamp.secs, buffer.timestamp.usecs = seconds, rest_ns // 1000
