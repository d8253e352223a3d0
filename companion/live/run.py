"""`companion run`: the live service, until it is told to stop."""

from __future__ import annotations

import argparse
import faulthandler
import gc
import logging
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ..config.differences import safety_lines
from ..config.loader import load_config
from ..console import print_line
from ..paths import folders
from .sd_notify import Notifier

if TYPE_CHECKING:
    from .service import Service

log = logging.getLogger("companion")

PRIORITIES = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
"""syslog's, in front of each line: journald reads them."""


MAX_LATE_S = 0.5
"""Of ticks: what is missed beyond is not made up for."""
IDLE_WAIT_S = 0.03
"""A tick waits so long, at most, for the frame at hand: a report takes some milliseconds of Python, for which frames would
have to wait."""


class JournalFormatter(logging.Formatter):
    """`<N>message` for the journal, time and message for people."""

    def __init__(self, journal: bool) -> None:
        super().__init__("%(message)s" if journal else "%(asctime)s %(levelname)s %(message)s")
        self._journal = journal

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        return f"<{PRIORITIES.get(record.levelno, 5)}>{text}" if self._journal else text


def serve(service: Service, notifier: Notifier, stop: threading.Event, tick_s: float) -> int:
    """Runs until stopped or until a loop has ended; 0 or 1."""
    previous: list[str] = []
    ready = False
    next_alive_s = 0.0
    next_tick_s = time.monotonic()
    while not stop.is_set():
        # the rate is kept over what a tick takes, and a late one is made up for: blindness is said so often, not rarer
        next_tick_s = max(next_tick_s + tick_s, time.monotonic() - MAX_LATE_S)
        (stop if ready else service.loop.begun).wait(max(0.0, next_tick_s - time.monotonic()))  # told at once
        service.loop.wait_idle(IDLE_WAIT_S)
        service.tick()
        if ended := service.failures() or ("" if service.loop.running else "the pipeline has ended"):
            # an autopilot that flies on without our word must not wait for the watchdog
            log.critical("%s; the service ends, to be started again", ended)
            return 1
        if service.started and not ready:
            ready = True
            notifier.ready()
            log.info("ready: the loops run")
        stalled = service.stalled_part()
        now_s = time.monotonic()
        if now_s >= next_alive_s:
            next_alive_s = now_s + min(0.5, (notifier.watchdog_s or 1.0) / 4.0)
            if not service.started:
                notifier.extend_timeout(60.0)  # kernels are being compiled
            if not stalled:
                notifier.feed_watchdog()
        now = [d.line() for d in service.diagnostics]
        _log_changes(now, previous)
        notifier.status("; ".join(service.diagnostic_texts) or "OK")
        previous = now
    return 0


def _log_changes(now: list[str], before: list[str]) -> None:
    """Each line once, when it comes and when it goes; numbers in it may go on changing."""
    old, new = {_without_digits(t): t for t in before}, {_without_digits(t): t for t in now}
    for kind, line in new.items():
        if kind not in old:
            log.warning(line)
    for kind, line in old.items():
        if kind not in new:
            log.info("cleared: %s", line)


def _without_digits(line: str) -> str:
    return "".join(c for c in line if not c.isdigit())


def add_parser(subparsers: Any) -> None:
    """The command line of `companion run`."""
    parser = subparsers.add_parser("run", help="the live service: cameras and autopilot in, prisms out")
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", required=True, help="such as configs/oak.toml")


def run(args: argparse.Namespace) -> int:
    """0: stopped as told; 1: it could not run, or a part of it ended."""
    gc.disable()  # a start makes much and leaves nothing behind; it is put aside in the end, then collecting begins
    faulthandler.enable()  # systemd's watchdog sends SIGABRT: where each thread hung is then in the journal
    cast(dict[str, Any], sys.modules).setdefault("coverage", None)  # numba loads it where it is installed, for nothing
    config = load_config(args.config)
    from ..kernels.warmup import Loading, WarmupError

    world = ("world",) if config.publish.world else ()
    loading = Loading("extractor", *world)  # beside by far most of the modules
    stop = threading.Event()

    def end(*_: object) -> None:
        stop.set()
        loading.cancel()  # no child compiles on for a minute

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    loading.start()
    from .service import Service

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JournalFormatter("JOURNAL_STREAM" in os.environ))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    notifier = Notifier()

    def warm_up() -> None:
        try:
            loading.finish()
        except WarmupError:
            if stop.is_set():
                return  # the loop ends before it begins
            raise
        gc.freeze()
        gc.enable()

    for line in safety_lines(config):
        log.warning("safety key changed: %s", line)
    service = Service(config, folders(), warm_up)
    try:
        service.open()
        return serve(service, notifier, stop, 1.0 / config.service.blind_hz)
    finally:
        notifier.stopping()
        try:
            service.close()
        finally:
            print_line("stopped")
