"""A device that does not close does not hide why it was closed."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

import pytest

from companion.cameras.status import CameraCondition
from companion.cameras.supervisor import CameraSupervisor
from companion.config.camera import CameraConfig
from companion.config.service import SupervisorParams
from drivers.cameras import bounded_close
from drivers.cameras.bounded_close import close_within

pytestmark = pytest.mark.process

SCRIPT = """
import sys, threading
import companion.cameras.worker as worker
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings
from tests.drivers.oak_host import DEVICE_ALONE, HostLink, depth_message

class Hangs(HostLink):
    def close(self):
        threading.Event().wait()

settings = OakSettings(camera="front", match=DEVICE_ALONE)
worker.make_source = lambda section: OakSource(settings, Hangs(lambda k: depth_message(k, age_s=100.0)))
sys.exit(worker.main(sys.argv[1:]))
"""


@pytest.mark.parametrize("seconds", [0.05, 5.0])
def test_a_close_that_ends_is_awaited_and_its_error_dropped(seconds: float) -> None:
    closed = threading.Event()

    def close() -> None:
        closed.set()
        raise RuntimeError("the device is lost")

    assert close_within(close, seconds)
    assert closed.is_set()


def test_a_close_that_does_not_end_is_left_to_its_thread() -> None:
    release = threading.Event()
    begun_s = time.monotonic()
    assert not close_within(release.wait, 0.1)
    assert time.monotonic() - begun_s < 60.0
    release.set()


def test_the_cause_of_a_failed_opening_is_reported_though_the_device_does_not_close(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The camera's process was ended after open_s with `did not open within 30 s; check cable and power`."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    script = tmp_path / "camera.py"
    script.write_text(SCRIPT)
    params = SupervisorParams(open_s=60.0, first_backoff_s=30.0, longest_backoff_s=60.0)
    supervisor = CameraSupervisor(
        CameraConfig(name="front", kind="oak"),
        lambda info: None,
        lambda frame: None,
        params,
        (sys.executable, str(script)),
    )
    supervisor.open()
    try:
        end_s = time.monotonic() + 50.0
        while supervisor.status.condition is not CameraCondition.LOST and time.monotonic() < end_s:
            time.sleep(0.05)
        assert "the device's clock is not synchronised" in supervisor.status.cause
    finally:
        supervisor.close()


def test_a_device_whose_pipeline_fails_is_closed_in_bounded_time(monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.cameras.oak_pipeline import OakSettings, start_pipeline

    class Device:
        closes = 0

        def setMaxReconnectionAttempts(self, attempts: int) -> None:
            raise RuntimeError("X_LINK_ERROR")

        def close(self) -> None:
            self.closes += 1
            threading.Event().wait()

    monkeypatch.setattr(bounded_close, "CLOSE_S", 0.1)
    device = Device()
    with pytest.raises(RuntimeError, match="X_LINK_ERROR"):
        start_pipeline(OakSettings(camera="front"), device)
    assert device.closes == 1
