"""The standard streams of a command: present, and able to print every text."""

from __future__ import annotations

import io
import os
import sys
from typing import Final

_STREAMS: Final = (0, 1, 2)
"""Descriptors of stdin, stdout and stderr."""


def prepare() -> None:
    """Opens /dev/null in place of each closed standard stream, and prints characters that the encoding of stdout lacks as
    escapes. Call it before the command opens its first file.

    A file takes the lowest free descriptor: with a closed stdout, a log would have that of stdout, and the output of a
    library would be written into it."""
    _open_closed()
    if sys.stdin is None:
        sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def discard_stdout() -> None:
    """Sends what stdout has buffered, and everything later, to /dev/null."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_closed() -> None:
    while (descriptor := os.open(os.devnull, os.O_RDWR)) in _STREAMS:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
