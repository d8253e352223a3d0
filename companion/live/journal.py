"""The log of the service on stderr, for the journal or the terminal.

A write to a pipe or a terminal blocks while its reader is stopped. Threads that send to the autopilot or feed the watchdog
also log: they must not wait for the reader, so a thread of its own writes."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import sys
import threading
from typing import Final

log = logging.getLogger("companion")

PRIORITIES = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
"""Priorities of syslog, which journald reads at the beginning of a line."""
MOST_WAITING: Final = 1000
"""Records that wait for the reader; further ones are dropped and counted."""
LAST_S: Final = 1.0
"""Longest wait at the end of the service: for room in the queue, and for the last records to be written."""


class JournalFormatter(logging.Formatter):
    """Formats `<N>message` for the journal, otherwise time, level and message."""

    def __init__(self, journal: bool) -> None:
        super().__init__("%(message)s" if journal else "%(asctime)s %(levelname)s %(message)s")
        self._journal = journal

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        return f"<{PRIORITIES.get(record.levelno, 5)}>{text}" if self._journal else text


class JournalHandler(logging.Handler):
    """Writes records to a file descriptor in a thread of its own. `emit` never blocks."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._waiting: queue.Queue[logging.LogRecord | None] = queue.Queue(MOST_WAITING)
        self._dropped = 0  # counted by the threads that log, one at a time
        self._reported = 0  # of them, counted by the thread that writes
        self._is_closed = False
        self._thread = threading.Thread(target=self._write_all, name="journal", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queues a record."""
        try:
            self._waiting.put_nowait(record)
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Waits until all records are written, but not longer than twice LAST_S for a reader that is stopped. Python calls it
        again at its end, and must not wait again."""
        if self._is_closed:
            return
        self._is_closed = True
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_S)
        self._thread.join(LAST_S)
        super().close()

    def _write_all(self) -> None:
        for record in iter(self._waiting.get, None):
            self._write(record)
            if self._waiting.empty():
                self._report_dropped()
        self._report_dropped()

    def _report_dropped(self) -> None:
        if dropped := self._dropped - self._reported:
            self._reported += dropped
            text = f"{dropped} lines of the log were dropped: the reader of stderr was stopped or too slow"
            self._write(logging.makeLogRecord({"levelno": logging.WARNING, "levelname": "WARNING", "msg": text}))

    def _write(self, record: logging.LogRecord) -> None:
        try:
            data = f"{self.format(record)}\n".encode("utf-8", "backslashreplace")
            while data:  # not by sys.stderr: its lock, held by a write that blocks, would abort the end of the process
                data = data[os.write(self._descriptor, data) :]
        except OSError:
            pass  # there is no reader any more
        except (TypeError, ValueError, LookupError):  # text and arguments do not fit
            self.handleError(record)


def log_to_stderr() -> JournalHandler:
    """Writes the log, the warnings of libraries, and the traceback of each thread that an exception ends, to stderr. Close
    the handler at the end."""
    handler = JournalHandler(sys.stderr.fileno())
    handler.setFormatter(JournalFormatter("JOURNAL_STREAM" in os.environ))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    logging.captureWarnings(True)
    threading.excepthook = _log_exception
    return handler


def _log_exception(args: threading.ExceptHookArgs) -> None:
    name = "" if args.thread is None else args.thread.name
    log.critical("an exception has ended the thread %r", name, exc_info=args.exc_value)
