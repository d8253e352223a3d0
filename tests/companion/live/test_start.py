"""A start of the service is quick: what it does not need it does not load."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from companion.config.loader import config_of
from companion.diagnostic import DiagnosticCode
from companion.live.event_queue import MAX_ITEMS
from companion.live.service import Service
from companion.paths import Folders
from core.types import AttitudeSample
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import until

pytestmark = pytest.mark.process

NOT_NEEDED = (
    "asyncio",
    "companion.autopilot.obstacle_output",
    "core.world.world",
    "cv2",
    "depthai",
    "linuxpy",
    "matplotlib",
    "rich",
    "scipy.interpolate",
    "scipy.spatial",
)
LOADED = f"""
import sys
import companion.live.run, companion.live.service, companion.kernels.warmup
print([m for m in {NOT_NEEDED!r} if m in sys.modules])
"""


def test_the_service_loads_no_camera_library_and_nothing_that_draws() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


THREADS = """
import os
from companion.cli import main
main(["--version"])
import numpy
print(len(os.listdir("/proc/self/task")), os.environ["OPENBLAS_NUM_THREADS"])
"""


def test_numpy_starts_no_threads_unless_configured() -> None:
    """On one core it makes none in either case."""
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    threads = [
        subprocess.run(
            [sys.executable, "-c", THREADS], env=environment | own, capture_output=True, text=True, check=True
        ).stdout.split()[-2:]
        for own in ({}, {"OPENBLAS_NUM_THREADS": "2"})
    ]
    assert threads == [["1", "1"], [str(min(2, len(os.sched_getaffinity(0)))), "2"]]


def test_a_long_start_is_not_a_stalled_part(tmp_path: Path) -> None:
    """Kernels that are compiled take longer than a loop may stand still."""
    (tmp_path / "run").mkdir()
    config = config_of({"service": {"hang_s": 0.5}, "record": {"record": "off"}}, "test")
    stalled: list[str] = []

    def warm_up() -> None:
        time.sleep(0.7)
        stalled.append(service.stalled_part())

    service = Service(config, Folders(tmp_path / "run", tmp_path / "state"), warm_up)
    try:
        service.open()
        assert service.parts.pipeline_thread.started.wait(60.0)
        assert stalled == [""]
        assert until(lambda: service.stalled_part() == "")
    finally:
        service.close()


def test_with_nothing_configured_the_missing_sections_are_reported(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    config = config_of({"record": {"record": "off"}}, "test")
    service = Service(config, Folders(tmp_path / "run", tmp_path / "state"), lambda: None)
    try:
        service.open()
        assert service.parts.pipeline_thread.started.wait(60.0)
        service.tick()
        assert service.diagnostic_texts == [
            "no camera is configured: add a [[camera]] to the configuration",
            "no autopilot is configured: set [autopilot] address",
        ]
        assert service.health.state == pb.Health.STATE_BLIND
    finally:
        service.close()


def test_dropped_samples_are_reported(tmp_path: Path) -> None:
    """Of those that came too quickly for the pipeline the oldest are gone: frames may lack their attitude for it."""
    (tmp_path / "run").mkdir()
    config = config_of({"record": {"record": "off"}}, "test")
    service = Service(config, Folders(tmp_path / "run", tmp_path / "state"), lambda: None)
    flood = [AttitudeSample(k, k, (1.0, 0.0, 0.0, 0.0)) for k in range(1, MAX_ITEMS + 101)]
    try:
        service.parts.event_queue.put(flood)
        service.tick()
        assert [d.code for d in service.diagnostics] == [
            DiagnosticCode.STARTING
        ]  # nothing sees yet, nothing is lacking
        service.open()
        assert service.parts.pipeline_thread.started.wait(60.0)
        service.tick()
        assert not any("samples" in t for t in service.diagnostic_texts)
        before = service.parts.event_queue.lost
        service.parts.event_queue.put(flood)
        service.tick()
        lost = service.parts.event_queue.lost - before
        assert lost >= 100
        assert f"{lost} attitude and position samples were lost" in " ".join(service.diagnostic_texts)
    finally:
        service.close()
