"""The log of the service on a pipe that is not read."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.live import journal
from companion.live.journal import JournalFormatter, JournalHandler
from drivers.simulation.autopilot import ARDUPILOT
from tests.waiting import PATIENCE_S, until

from ..live_service import ROOT, Live, fill, flown, unread_output
from .test_service_avoids import CONFIG, FRONT, AvoidingService

pytestmark = pytest.mark.process


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)
    os.close(writer)


def record(text: str) -> logging.LogRecord:
    return logging.makeLogRecord({"levelno": logging.INFO, "levelname": "INFO", "msg": text})


def handler_on(descriptor: int) -> JournalHandler:
    handler = JournalHandler(descriptor)
    handler.setFormatter(JournalFormatter(journal=True))
    return handler


class Reader(threading.Thread):
    """Reads a pipe until its writer closes it."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(daemon=True)
        self.descriptor, self.data = descriptor, b""
        self.start()

    def run(self) -> None:
        while chunk := os.read(self.descriptor, 65536):
            self.data += chunk

    @property
    def lines(self) -> list[str]:
        return self.data.replace(b"\0", b"").decode().splitlines()


def test_a_pipe_that_is_not_read_blocks_no_thread_that_logs_and_dropped_lines_are_counted() -> None:
    descriptor, writer = os.pipe()
    fill(writer)
    handler = handler_on(writer)
    handler.handle(record("line 0"))
    assert until(handler._waiting.empty), "the thread has it, and waits for the reader"
    for number in range(1, journal.MOST_WAITING + 50):
        handler.handle(record(f"line {number}"))
    reader = Reader(descriptor)
    assert until(lambda: any("dropped" in line for line in reader.lines))
    assert until(handler._waiting.empty)
    handler.handle(record("after it"))
    handler.close()
    os.close(writer)
    reader.join(PATIENCE_S)
    written = [line for line in reader.lines if "line " in line]
    assert written == [f"<6>line {number}" for number in range(len(written))], "the first lines show the cause"
    dropped = journal.MOST_WAITING + 50 - len(written)
    assert reader.lines[len(written) :] == [
        f"<4>{dropped} lines of the log were dropped: the reader of stderr was stopped or too slow",
        "<6>after it",
    ]
    os.close(descriptor)


def test_the_last_lines_are_written_at_the_end(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    handler = handler_on(writer)
    for number in range(100):
        handler.handle(record(f"line {number}"))
    handler.close()
    assert os.read(reader, 65536).decode().splitlines() == [f"<6>line {number}" for number in range(100)]
    handler.close()


def test_the_end_does_not_wait_for_a_reader_that_is_stopped(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    written = fill(writer)
    handler = handler_on(writer)
    for number in range(journal.MOST_WAITING + 2):
        handler.handle(record(f"line {number}"))
    handler.close()  # returns
    os.read(reader, written)  # the thread goes on, and leaves the descriptors before they are closed
    assert until(handler._waiting.empty)


def test_a_reader_that_has_ended_ends_no_thread() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    handler = handler_on(writer)
    handler.handle(record("without a reader"))
    handler.close()
    assert not handler._thread.is_alive()
    os.close(writer)


BROKEN = """
import os, sys, threading
from companion.live.journal import log_to_stderr

def broken():
    raise ValueError("a broken part")

handler = log_to_stderr()
thread = threading.Thread(target=broken)
thread.start()
thread.join()
handler.close()
"""


def test_the_traceback_of_a_thread_is_in_the_journal() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BROKEN], cwd=ROOT, capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    assert "an exception has ended the thread 'Thread-1 (broken)'" in done.stderr
    assert done.stderr.endswith("ValueError: a broken part\n")


def test_a_process_whose_thread_has_failed_ends_although_stderr_is_not_read(pipe: tuple[int, int]) -> None:
    """A traceback that a thread writes by sys.stderr holds its lock, which the end of the interpreter needs."""
    _, writer = pipe
    fill(writer)
    assert subprocess.run([sys.executable, "-c", BROKEN], cwd=ROOT, stderr=writer, timeout=PATIENCE_S).returncode == 0


def test_a_warning_of_a_library_does_not_wait_for_the_reader(pipe: tuple[int, int]) -> None:
    """numpy warns from the thread that computes, and Python writes it to sys.stderr."""
    _, writer = pipe
    fill(writer)
    code = """
import numpy, sys
from companion.live.journal import log_to_stderr
handler = log_to_stderr()
numpy.array([1.0]) / numpy.array([0.0])
sys.stdout.write("computed")
handler.close()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=writer, text=True, timeout=PATIENCE_S
    )
    assert done.stdout == "computed"


def test_the_service_goes_on_while_its_output_is_not_read(tmp_path: Path, renders: Path) -> None:
    live = Live(
        tmp_path, CONFIG + "[expert]\nnoise_hold = 0.75\n", renders
    )  # a line before the start, as it is retired
    with (
        unread_output(tmp_path) as before,
        flown(live, ARDUPILOT) as line,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd,
    ):
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        live.environment |= {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "2000000"}
        service = AvoidingService(live, line, ARDUPILOT)
        try:
            service.correct_parameters()
            live.start(*before)
            assert until(service.has_obstacles)
            assert until(service.has_read_the_margin)
            os.kill(live.camera_pids()["front"], signal.SIGSTOP)
            assert until(lambda: {service.messages()[-1][1][i] for i in FRONT} == {266}), "the failsafe"
            assert until(lambda: any(t.startswith("OA: front blind: ") for t in service.texts())), "the main loop"
            systemd.setblocking(False)
            try:
                while systemd.recv(4096):
                    pass  # what was sent before
            except BlockingIOError:
                systemd.settimeout(PATIENCE_S)
            while systemd.recv(4096) != b"WATCHDOG=1":
                pass
            assert live.stop() == 0
        finally:
            live.close()
