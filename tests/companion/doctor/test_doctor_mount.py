"""`companion doctor --mount` as a command, with a camera process and an autopilot over UDP."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from companion.autopilot.simulate_autopilot import simulated
from companion.cli import main
from companion.config.loader import load_config
from core.frames import euler_from_rotation, rotation_from_euler
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.flight_path import VehicleState

from ..live_service import NS, Live

pytestmark = pytest.mark.process

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "by_hand"
width_px = 160
fps = 20.0
device = "{cable}"
roll_deg = 0.0
pitch_deg = 0.0

[autopilot]
address = "udpin:127.0.0.1:{port}"
attitude_hz = 50.0
"""
TRUE_DEG = (3.0, -8.0)
"""Roll and pitch of the camera on the vehicle whose attitude the autopilot reports."""


def vehicle_of(motion: Callable[[int], VehicleState], live: Live) -> Callable[[int], VehicleState]:
    """The vehicle that carries the camera with TRUE_DEG.

    The simulated camera renders a vehicle that moves by `motion` with the configured mount; the autopilot therefore reports
    the attitude that gives the same camera attitude with the true mount."""
    mount = load_config(live.config).cameras[0]
    R_frd_configured = rotation_from_euler(
        math.radians(mount.roll_deg or 0.0), math.radians(mount.pitch_deg or 0.0), 0.0
    )
    R_frd_true = rotation_from_euler(math.radians(TRUE_DEG[0]), math.radians(TRUE_DEG[1]), 0.0)

    def state(t_ns: int) -> VehicleState:
        rendered = motion(t_ns)
        return dataclasses.replace(
            rendered, euler_rad=euler_from_rotation(rendered.R_ned_frd @ R_frd_configured @ R_frd_true.T)
        )

    return state


def measured(live: Live, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    """(status, the finding of the camera) while the autopilot reports the vehicle's attitude."""
    autopilot = simulated(live.flight())
    autopilot.profile.motion = vehicle_of(live.flight().state, live)
    autopilot.profile.boot_at_ns = time.monotonic_ns() - 30 * NS
    with AutopilotLink(autopilot, UdpEnd("127.0.0.1", live.port)):
        status = main(["doctor", "-c", str(live.config), "--json", "--mount", "--seconds", "120"])
    (finding,) = json.loads(capsys.readouterr().out)["mounts"]
    return status, finding


def test_the_printed_lines_correct_a_wrong_mount(
    tmp_path: Path, renders: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    live = Live(tmp_path, CONFIG, renders)
    for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY", "CACHE_DIRECTORY"):
        monkeypatch.setenv(name, live.environment[name])
    status, finding = measured(live, capsys)
    assert status == 1
    lines = dict(line.split(" = ") for line in finding["lines"][1:])
    assert lines["name"] == '"front"'
    assert (float(lines["roll_deg"]), float(lines["pitch_deg"])) == pytest.approx(TRUE_DEG, abs=0.6)
    pasted = live.config.read_text()
    for key in ("roll_deg", "pitch_deg"):
        pasted = pasted.replace(f"{key} = 0.0", f"{key} = {lines[key]}")
    assert pasted != live.config.read_text()
    live.config.write_text(pasted)
    status, finding = measured(live, capsys)
    assert status == 0, finding
    assert finding["ok"]
