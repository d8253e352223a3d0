"""How deep the processors may sleep: asked of the kernel as long as the service runs, and told where it is not heeded."""

from __future__ import annotations

import os
import signal
import struct
from pathlib import Path

import pytest

from companion.config import ConfigError, config_of
from companion.idle_latency import DEVICE, DRIVER, IdleLatency
from drivers.proto import osape_v1_pb2 as pb

from .live import PATIENCE_S, Live, flown, until

ALLOWED = os.access(DEVICE, os.R_OK | os.W_OK)
UNDRIVEN = not DRIVER.exists() or DRIVER.read_text().strip() == "none"
SERVICE = """
[service]
idle_latency_us = 41
[record]
record = "off"
"""


SEEING = (
    """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
[autopilot]
address = "udpin:127.0.0.1:{port}"
"""
    + SERVICE
)


def heeded_us() -> int:
    """The least that any process of this machine wishes."""
    return int(struct.unpack("=i", DEVICE.read_bytes())[0])


def held_by_us(device: Path, process: int | str = "self") -> int:
    """How many of our files it is, or of another process."""
    folder = Path(f"/proc/{process}/fd")
    return sum(os.path.realpath(file) == str(device) for file in folder.iterdir())


def test_the_wish_is_written_as_the_kernel_reads_it_and_held_until_the_end(tmp_path: Path) -> None:
    device, driver = tmp_path / "latency", tmp_path / "driver"
    device.touch()
    driver.write_text("acpi_idle\n")
    idle = IdleLatency(250, device, driver)
    assert idle.open() == ""
    assert device.read_bytes() == struct.pack("=i", 250)  # four bytes; text would mean hexadecimal to it
    assert held_by_us(device) == 1  # closed, it would no longer be heeded
    idle.close()
    idle.close()
    assert held_by_us(device) == 0


@pytest.mark.skipif(not ALLOWED, reason="no right to the kernel's PM QoS here")
def test_the_kernel_heeds_it_and_forgets_it() -> None:
    before_us = heeded_us()
    wish_us = min(before_us, 100) // 2
    idle = IdleLatency(wish_us)
    assert ("is not heeded" in idle.open()) == UNDRIVEN
    try:
        assert heeded_us() == wish_us
    finally:
        idle.close()
    assert heeded_us() == before_us


def test_a_service_asks_for_it_and_even_kill_9_takes_it_back(tmp_path: Path, renders: Path) -> None:
    """Where it has no right to, it flies all the same, and says so."""
    live = Live(tmp_path, SERVICE, renders)
    before_us = heeded_us() if ALLOWED else None
    try:
        live.start()
        assert until(lambda: "ready: the loops run" in live.said())
        if before_us is not None:
            # another service on this machine may wish for less
            assert heeded_us() == min(before_us, 41)
            assert live.process is not None
            assert held_by_us(DEVICE, live.process.pid) == 1
            assert ("idle_latency_us = 41 is not heeded" in live.said()) == UNDRIVEN
            live.stop(signal.SIGKILL)
            assert until(lambda: heeded_us() == before_us, 2.0)
        else:
            assert "idle_latency_us = 41 is not heeded" in live.said()
    finally:
        live.close()


def test_a_service_that_is_not_heeded_notes_it_in_each_report_and_flies_on(tmp_path: Path, renders: Path) -> None:
    """Nothing is wrong with what it sees: no trouble, no other state."""
    live = Live(tmp_path, SEEING, renders)
    (tmp_path / "sitecustomize.py").write_text(
        "import pathlib, companion.idle_latency as idle\nidle.DEVICE = pathlib.Path('/dev/full')\n"
    )
    live.environment["PYTHONPATH"] = f"{tmp_path}{os.pathsep}{live.environment['PYTHONPATH']}"
    try:
        live.start()
        ear = live.ear("health", pb.Health)
        with flown(live):
            report = ear.wait(lambda h: h.state == pb.Health.STATE_ACTIVE, PATIENCE_S)
            later = ear.wait(lambda h: h.number > report.number, 10.0)
        for h in (report, later):
            assert [note.split(": ")[0] for note in h.notes] == ["idle_latency_us = 41 is not heeded"]
            assert not any("idle_latency" in trouble for trouble in h.troubles)
        assert "idle_latency_us = 41 is not heeded" in live.said()
    finally:
        live.close()


def test_no_wish_touches_nothing(tmp_path: Path) -> None:
    device = tmp_path / "latency"
    device.touch()
    idle = IdleLatency(-1, device)
    assert idle.open() == ""
    assert device.read_bytes() == b""
    assert held_by_us(device) == 0


def test_a_kernel_without_it_is_told_with_the_remedy(tmp_path: Path) -> None:
    idle = IdleLatency(0, tmp_path / "nothing")
    said = idle.open()
    assert "idle_latency_us = 0 is not heeded" in said
    assert "No such file" in said
    assert "companion install" in said
    idle.close()


@pytest.mark.parametrize(("text", "why"), [("none\n", "none"), (None, "No such file")])
def test_a_kernel_without_a_driver_for_sleep_takes_the_wish_and_does_not_heed_it(
    tmp_path: Path, text: str | None, why: str
) -> None:
    device, driver = tmp_path / "latency", tmp_path / "current_driver"
    device.touch()
    if text is not None:
        driver.write_text(text)
    idle = IdleLatency(0, device, driver)
    said = idle.open()
    assert said.startswith(f"idle_latency_us = 0 is not heeded: {driver}: {why}")
    assert "idle=poll" in said
    idle.close()


def test_a_kernel_that_refuses_the_value_is_told_and_nothing_stays_open() -> None:
    full = Path("/dev/full")
    before = held_by_us(full)
    idle = IdleLatency(5, full)
    assert "No space left" in idle.open()
    assert held_by_us(full) == before


@pytest.mark.parametrize("wish_us", [-2, 100_001, 1.5, "0"])
def test_other_values_are_refused_by_name(wish_us: object) -> None:
    with pytest.raises(ConfigError, match="idle_latency_us"):
        config_of({"service": {"idle_latency_us": wish_us}}, "test")
