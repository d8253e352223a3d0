"""The main loop of `companion run`: it ends when a required part has ended, so that systemd restarts it."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from companion.autopilot.failsafe import AutopilotNow
from companion.config.avoidance import AvoidParams
from companion.config.loader import Config
from companion.config.service import AutopilotConfig, RecordParams
from companion.diagnostic import Diagnostic, DiagnosticCode
from companion.live import run as run_module
from companion.live.run import BLIND_HZ, log_changes, serve
from companion.live.sd_notify import Notifier
from companion.live.service import Service
from companion.paths import Folders
from tests.ports import free_port

pytestmark = pytest.mark.process


def blind(text: str, camera: str = "front") -> Diagnostic:
    return Diagnostic(DiagnosticCode.CAMERA_UNAVAILABLE, camera, f"camera {camera} is blind: {text}")


def lines(*found: Diagnostic) -> list[str]:
    return [d.line() for d in found]


def test_causes_that_alternate_do_not_fill_the_journal(caplog: pytest.LogCaptureFixture) -> None:
    """As on an overloaded computer: the main loop runs 12.5 times a second, and each time there is another cause or none."""
    caplog.set_level(logging.INFO, "companion")
    logged: dict[tuple[str, str], tuple[str, float]] = {}
    for tick in range(250):
        found = [[blind(f"superseded by frame {tick}")], [blind(f"exposure {tick} ms old")], []][tick % 3]
        log_changes(found, logged, 0.08 * tick)
    assert caplog.messages == lines(blind("superseded by frame 0"), blind("exposure 1 ms old"))
    caplog.clear()
    for tick in range(250, 275):
        log_changes([], logged, 0.08 * tick)
    last = lines(blind("exposure 247 ms old"), blind("superseded by frame 249"))
    assert caplog.messages == [f"cleared: {line}" for line in last]
    log_changes([blind("superseded by frame 7")], logged, 30.0)
    assert caplog.messages[2:] == lines(blind("superseded by frame 7"))


def test_cameras_whose_names_differ_by_a_digit_are_logged_each(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "companion")
    logged: dict[tuple[str, str], tuple[str, float]] = {}
    one, two = blind("no frame for 2 s", "cam1"), blind("no frame for 3 s", "cam2")
    log_changes([one], logged, 0.0)
    log_changes([one, two], logged, 1.0)
    log_changes([two], logged, 3.0)
    assert caplog.messages == [*lines(one, two), f"cleared: {one.line()}"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_it_ends_at_once_when_no_obstacles_are_sent_any_more(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """ArduPilot flies on without obstacle messages: the restart must be fast."""
    config = Config(
        autopilot=AutopilotConfig(address=f"udpin:127.0.0.1:{free_port()}"),
        avoid=AvoidParams(send=True),
        record=RecordParams(record="off"),
    )
    service = Service(config, Folders(tmp_path, tmp_path), lambda: None)

    def broken() -> AutopilotNow:
        raise OSError("an error that nobody thought of")

    try:
        service.open()
        assert service.parts.obstacle_output is not None
        stop, ended = threading.Event(), []
        loop = threading.Thread(target=lambda: ended.append(serve(service, Notifier(), stop, 0.02)))
        loop.start()
        loop.join(0.5)
        assert ended == []  # it runs
        service.parts.obstacle_output.sender._ask = broken
        loop.join(60.0)
        assert ended == [1]
        assert "the obstacle sender has ended" in caplog.text
    finally:
        stop.set()
        with pytest.raises(OSError, match="nobody thought of"):  # from the last decision, which is tried once more
            service.close()


class Clock:
    """Time that passes only while something waits or works. It stands in for the module `time` and for the stop event."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def wait(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.mark.parametrize("tick_s", [0.001, 0.02, 0.07])
def test_the_main_loop_reports_blind_cameras_ten_times_a_second_whatever_a_tick_takes(
    monkeypatch: pytest.MonkeyPatch, tick_s: float
) -> None:
    """The interval does not contain the time of a tick, and ticks that a pause has delayed are made up for."""
    clock, ticks = Clock(), list[float]()

    def tick() -> None:
        ticks.append(clock.now_s)
        clock.now_s += tick_s + (0.4 if len(ticks) == 50 else 0.0)

    service = started_service(clock, tick)
    stop: Any = SimpleNamespace(wait=clock.wait, is_set=lambda: clock.now_s >= 1020.0)
    monkeypatch.setattr(run_module, "time", clock)
    assert serve(service, Notifier({}), stop, 1.0 / BLIND_HZ) == 0
    assert len(ticks) >= 20 * BLIND_HZ - 1
    assert BLIND_HZ >= 10.0


def started_service(clock: Clock, tick: Callable[[], None]) -> Any:
    """A service without parts, with the diagnostics that `tick` puts into `diagnostics` and `diagnostic_texts`."""
    thread = SimpleNamespace(wait_idle=lambda seconds: None, started=clock)
    return SimpleNamespace(
        parts=SimpleNamespace(pipeline_thread=thread, failures=lambda: "", recorder=None),
        suspension=SimpleNamespace(fault=lambda: ""),
        tick=tick,
        started=True,
        stalled_part=lambda: "",
        diagnostics=[],
        diagnostic_texts=[],
    )


def test_systemd_gets_a_status_when_its_content_changes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The age in the text changes with each tick. Each STATUS is a signal on D-Bus: there were 12 a second."""
    clock = Clock()
    begun_s, received = clock.now_s, list[tuple[float, str]]()

    def tick() -> None:
        with suppress(BlockingIOError):
            while True:
                received.append((clock.now_s - begun_s, systemd.recv(500).decode()))
        t_s = clock.now_s - begun_s
        text = f"its newest exposure is {t_s:.1f} s old" if t_s > 2.0 else ""
        if t_s > 30.0:  # on an overloaded computer the camera becomes blind and recovers several times a second
            text = ("superseded", "")[len(received) % 2]
        service.diagnostics = [blind(text)] if text else []
        service.diagnostic_texts = [d.text for d in service.diagnostics]

    service = started_service(clock, tick)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.setblocking(False)
        stop: Any = SimpleNamespace(wait=clock.wait, is_set=lambda: clock.now_s >= begun_s + 40.0)
        monkeypatch.setattr(run_module, "time", clock)
        assert serve(service, Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify")}), stop, 1.0 / BLIND_HZ) == 0
    status = [(t_s, text) for t_s, text in received if text.startswith("STATUS=")]
    assert [text for t_s, text in status if t_s < 2.0] == ["STATUS=OK"]
    ages = [text for t_s, text in status if 2.0 < t_s < 30.0]
    assert ages[0].startswith("STATUS=camera front is blind: its newest exposure is 2.")
    assert len(ages) == 3, "with other numbers alone it is sent every 10 s"
    assert 8 <= len([text for t_s, text in status if t_s > 30.0]) <= 11
