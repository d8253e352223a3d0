"""`companion run`: runs the live service until it is stopped."""

from __future__ import annotations

import argparse
import faulthandler
import gc
import logging
import resource
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from .. import end_at_interrupt, raise_at_interrupt
from ..common_options import add_config
from ..config.differences import expert_lines, safety_lines
from ..config.installed import INSTALLED, config_path
from ..config.loader import Config, ConfigError, load_config
from ..config.startup import run_problems
from ..diagnostic import Diagnostic, without_digits
from ..paths import Folders, folders
from ..stop_signal import at_stop_signal
from .journal import log_to_stderr
from .record_note import RecordRate, record_note
from .sd_notify import Notifier

if TYPE_CHECKING:
    from .service import Service

log = logging.getLogger("companion")

START_S = 180.0
"""Longest time of the imports and of opening the parts, for systemd. Seen: 1 s on a cloud computer, above 60 s on an emulated
processor. The main loop extends it while kernels are loaded or compiled."""
BLIND_HZ = 12.5
"""Rate of the main loop, which publishes a blind frame for each blind camera."""
MAX_LATE_S = 0.5
"""Largest delay of a tick that later ticks make up for."""
CLEARED_S = 1.0
"""On an overloaded computer a camera becomes blind and recovers several times a second, each time for another cause."""
IDLE_WAIT_S = 0.03
"""Longest wait of a tick for the end of the frame being processed: a report takes some milliseconds of Python, which
would delay the frame."""
MOST_FILES = 65_536
"""Limit of open files: each connection of a subscriber takes one, and without one libzmq aborts the process. The usual limit of
1024 is for programs that use select(), which the service does not."""


def serve(service: Service, notifier: Notifier, stop: threading.Event, tick_s: float) -> int:
    """Runs the main loop until stopped (0), or until a required part has ended or the computer was suspended (1)."""
    logged: dict[tuple[str, str], tuple[str, float]] = {}
    ready = False
    record_rate = RecordRate()
    next_alive_s = 0.0
    next_tick_s = time.monotonic()
    while not stop.is_set():
        # fixed rate independent of the duration of a tick: blind cameras are reported at BLIND_HZ
        next_tick_s = max(next_tick_s + tick_s, time.monotonic() - MAX_LATE_S)
        # the wait for the start ends at once when the pipeline runs
        (stop if ready else service.parts.pipeline_thread.started).wait(max(0.0, next_tick_s - time.monotonic()))
        service.parts.pipeline_thread.wait_idle(IDLE_WAIT_S)
        service.tick()
        if ended := service.parts.failures() or service.suspension.fault():
            # the autopilot must not wait for the watchdog: end at once so that systemd restarts the service
            log.critical("%s; the service ends so that systemd restarts it", ended)
            return 1
        if service.started and not ready:
            ready = True
            notifier.ready()
            log.info("ready")
        stalled = service.stalled_part()
        now_s = time.monotonic()
        if now_s >= next_alive_s:
            next_alive_s = now_s + min(0.5, (notifier.watchdog_s or 1.0) / 4.0)
            if not service.started:
                notifier.extend_timeout(60.0)  # kernels are being loaded or compiled
            if not stalled:
                notifier.feed_watchdog()
            if service.parts.recorder is not None and (
                note := record_rate.note(service.parts.recorder.status, time.monotonic_ns())
            ):
                log.info(note)
        log_changes(service.diagnostics, logged, now_s)
        kind = "; ".join(f"{d.camera} {without_digits(d.text)}" for d in service.diagnostics)
        notifier.status("; ".join(service.diagnostic_texts) or "OK", kind, now_s)
    return 0


def log_changes(now: list[Diagnostic], logged: dict[tuple[str, str], tuple[str, float]], now_s: float) -> None:
    """Logs each diagnostic when it appears and when it has been absent for CLEARED_S; changes of numbers within it are not
    logged.

    logged: those that were logged and are not cleared, by camera and kind: (line, when it was last present); updated here."""
    for diagnostic in now:
        line = diagnostic.line()
        kind = diagnostic.camera, without_digits(line)
        if kind not in logged:
            log.warning(line)
        logged[kind] = line, now_s
    for kind, (line, present_s) in tuple(logged.items()):
        if now_s - present_s > CLEARED_S:
            log.info("cleared: %s", line)
            del logged[kind]


def add_parser(subparsers: Any) -> None:
    """The command line of `companion run`."""
    parser = subparsers.add_parser("run")
    add_config(parser, f"configuration (default: {INSTALLED})")


def check_live(config: Config, source: Path) -> None:
    """Raises ConfigError where a camera is a recording, which the service would wait for in vain or take for the present, where
    one could open the device of another, and where a stream could not be opened."""
    if problems := run_problems(config):
        raise ConfigError(str(source), problems)


def _kernels_of(config: Config) -> list[str]:
    """The sets of kernels that the service needs."""
    wanted = {
        "extractor": True,
        "world": bool(config.publish.world),
        "tracking": config.tracking.enabled,
        "sharing": config.share.enabled,
        "simulated": any(camera.kind == "simulated" for camera in config.cameras),
    }
    return [name for name, is_wanted in wanted.items() if is_wanted]


def run(args: argparse.Namespace) -> int:
    """0: stopped on request; 1: a part could not start or has ended."""
    end_at_interrupt()  # until `_run` handles it
    journal = log_to_stderr()
    try:
        return _run(config_path(args.config))
    finally:
        raise_at_interrupt()
        journal.close()


def _prepare_process() -> None:
    gc.disable()  # the start creates many objects that stay; they are frozen at its end, then collection is enabled
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_FILES if hard == resource.RLIM_INFINITY else min(MOST_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    faulthandler.enable()  # the watchdog of systemd sends SIGABRT: the journal then holds a traceback of each thread
    cast(dict[str, Any], sys.modules).setdefault("coverage", None)  # numba would import it where installed, without use


def _log_configuration(config: Config, here: Folders) -> None:
    """Logs the changed safety and expert keys, and where frames are published and the flight is recorded."""
    for line in safety_lines(config):
        log.warning("safety key changed: %s", line)
    for line in expert_lines(config):
        log.warning("expert key changed: %s", line)
    if address := config.publish.address("prisms", here.run):
        log.info("frames are published on %s", address)
    log.info(record_note(config, here))


def _run(path: Path) -> int:
    _prepare_process()
    config = load_config(path)
    check_live(config, path)
    from ..kernels.compilation import WarmupError
    from ..kernels.loading import Loading

    loading = Loading(*_kernels_of(config))  # loads beside the imports, which take longer
    notifier = Notifier()
    notifier.extend_timeout(START_S)
    loading.start()
    from .service import Service

    stop = threading.Event()

    def end() -> None:
        stop.set()
        loading.cancel()  # ends a child process that compiles

    at_stop_signal(end)  # a signal before it ends the process at once; a child that compiles then ends by itself

    def warm_up() -> None:
        try:
            loading.finish()
        except WarmupError:
            if not stop.is_set():
                raise
            service.parts.pipeline_thread.stop()  # before it begins: a frame would compile the kernels
            return
        gc.freeze()
        gc.enable()

    here = folders()
    _log_configuration(config, here)
    service = Service(config, here, warm_up, lambda: loading.text)
    return _open_and_serve(service, notifier, stop)


def _open_and_serve(service: Service, notifier: Notifier, stop: threading.Event) -> int:
    """Runs the service and closes it, also where it could not be opened."""
    opened = False
    try:
        service.open()
        opened = True
        return serve(service, notifier, stop, 1.0 / BLIND_HZ)
    finally:
        notifier.stopping()
        try:
            service.close()
        finally:
            if opened:
                log.info("stopped")
