"""The service under a real systemd: installed, started, killed, hung, stopped, taken away again.

Times are printed, with wide limits: the emulated processor is slower than any board by an unknown factor."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from .vm import prepare, run_machine

pytestmark = pytest.mark.vm

TIMEOUT_S = 2700.0
"""Longest run of the machine: minutes on an idle host, a quarter of an hour and more on a busy one."""
WATCHDOG_S = 2.0


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory, pytestconfig: pytest.Config) -> dict[str, Any]:
    """What the script in the machine found out."""
    machine = prepare(tmp_path_factory.mktemp("machine"), Path(__file__).with_name("vm_checks.py"))
    findings, console = run_machine(machine, TIMEOUT_S)
    assert findings, console[-3000:]
    failed = {key: value for key, value in findings.items() if key.endswith("_failed")}
    assert failed == {}, f"{failed}\n{findings.get('journal', '')}\n{findings.get('install_output', '')}"
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled():
        for name in ("install", "start_to_ready", "killed_to_ready", "hung_to_end", "hung_to_ready", "stop"):
            sys.stdout.write(f"\n{name:16s} {findings[name + '_s']:7.2f} s (emulated processor)")
        sys.stdout.write("\n")
    return findings


def test_installed_once(found: dict[str, Any]) -> None:
    assert found["install_status"] == 0
    assert len(found["install_again_would"]) == 2  # a look at the kernels, a new start


def test_ready_without_camera_and_autopilot_and_saying_so(found: dict[str, Any]) -> None:
    assert found["ready"]
    assert found["NRestarts"] == "0"
    assert found["status"] == 1  # it is blind
    for words in ("BLIND", "camera front is blind", "the link to the autopilot is not open"):
        assert words in found["status_output"]
    assert "camera front is blind" in found["StatusText"]


def test_in_its_sandbox(found: dict[str, Any]) -> None:
    assert found["uid"] != 0
    assert int(found["capabilities"], 16) == 0
    assert found["no_new_privileges"] == "1"


def test_ready_again_after_kill_9(found: dict[str, Any]) -> None:
    assert found["killed_ready"]


def test_a_hang_is_ended_by_the_watchdog_with_its_stacks_in_the_journal(found: dict[str, Any]) -> None:
    assert found["hung_ended"]
    assert found["hung_to_end_s"] < WATCHDOG_S + 5.0
    assert found["watchdog_named"]
    assert found["stacks"]
    assert found["hung_ready"]


def test_stopped_as_documented(found: dict[str, Any]) -> None:
    assert found["stop_status"] == 0
    assert (found["ActiveState"], found["Result"]) == ("inactive", "success")
    assert found["left_processes"] == []


def test_depth_of_a_video_device_of_the_kernel(found: dict[str, Any]) -> None:
    assert found.get("camera_frames") == 12, found["camera_output"]
    assert found["camera_shape"] == [180, 320]
    assert found["camera_type"] == "uint16"
    assert found["camera_levels"] > 3  # a test picture, no empty buffer
    assert found["camera_stamps_rise"]
    assert found["camera_sequences_rise"]
    assert 0.0 < found["camera_oldest_ms"] < 2000.0


def test_images_of_both_eyes_of_a_video_device_of_the_kernel(found: dict[str, Any]) -> None:
    assert found["pair_shape"] == [360, 640, 3], found["camera_output"]
    assert found["pair_levels"] > 2  # an empty buffer has the green of zeros
    assert 0.0 < found["pair_age_ms"] < 2000.0


def test_the_kernels_mark_of_a_faulty_image_arrives(found: dict[str, Any]) -> None:
    assert found["faulty_marked"], found["camera_output"]


def test_a_device_in_use_is_named(found: dict[str, Any]) -> None:
    assert "another program uses it: end that program" in found["busy"]


def test_a_video_device_that_is_unplugged_is_lost_and_not_found_again(found: dict[str, Any]) -> None:
    assert "/dev/video0 was lost (No such device)" in found["camera_unplugged"]
    assert found["camera_held"] == 0  # no buffer keeps the device open
    assert "check that it is connected" in found["camera_gone"]


def test_taken_away_but_for_the_logs_until_asked_for(found: dict[str, Any]) -> None:
    assert found["uninstall_status"] == 0
    assert found["unit_left"] == "not-found"
    assert found["logs_left"]
    assert found["purge_status"] == 0
    assert found["purge_left"] == []
