"""Reads what a camera process prints, and logs it.

A write to a full pipe blocks. Without a reader of its own, a library that prints much would block the camera's process as soon as
the reader of the service's output stops, and its text would be part of the result of a command (`--json`)."""

from __future__ import annotations

import logging
import time
from typing import IO, Final

log = logging.getLogger("companion")

MOST_CHARACTERS: Final = 500
"""A longer line is logged in parts."""
MOST_LINES: Final = 20
"""Lines that are logged within WINDOW_S; further ones are dropped and counted."""
WINDOW_S: Final = 1.0


def forward(camera: str, stream: IO[bytes]) -> None:
    """Logs each line until the process ends, and closes the stream."""
    begun_s, lines, dropped = time.monotonic(), 0, 0
    with stream:
        while data := stream.readline(MOST_CHARACTERS):
            now_s = time.monotonic()
            if now_s - begun_s > WINDOW_S:
                _report(camera, dropped)
                begun_s, lines, dropped = now_s, 0, 0
            text = data.decode(errors="backslashreplace").strip()
            if not text:
                continue
            if lines < MOST_LINES:
                log.warning("camera %s: its process printed: %s", camera, text)
                lines += 1
            else:
                dropped += 1
    _report(camera, dropped)


def _report(camera: str, dropped: int) -> None:
    if dropped:
        log.warning("camera %s: %d more lines of its process were dropped", camera, dropped)
