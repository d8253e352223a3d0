"""The Rerun recording of a log, read by Rerun's own tool."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.cli import main
from companion.viewer.placement import ned_from_level_cam, placed_model
from companion.viewer.rerun_file import measured_mm
from core.frames import rotation_frd_optical
from core.types import FAR_MM, SATURATED_MM

from ..small_recordings import write_flight
from ..view_scenes import blind, frame, tilted


def rerun_tool(*arguments: str) -> str:
    done = subprocess.run([sys.executable, "-m", "rerun", *arguments], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.process
def test_a_log_becomes_a_recording_that_rerun_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra rerun)")
    log, prisms, out = write_flight(tmp_path / "log.mcap"), tmp_path / "prisms.mcap", tmp_path / "out"
    assert main(["replay", str(log), "-o", str(prisms)]) == 0
    capsys.readouterr()
    assert main(["view", str(prisms), "-o", str(out), "--no-png", "--rerun", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["rerun"] == str(out / "flight.rrd")
    rerun_tool("rrd", "verify", report["rerun"])
    stats = rerun_tool("rrd", "stats", report["rerun"])
    rows = dict(re.findall(r"^(\S+): (\d+)$", stats, re.MULTILINE))
    for entity in ("/ned/obstacles/front", "/ned/vehicle/front/image/depth", "/ned/vehicle", "/ned/trajectory"):
        assert int(rows[entity]) >= 1, stats
    assert "DepthImage:meter" in rows


def test_without_rerun_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["view", str(write_flight(tmp_path / "a.mcap")), "-o", str(tmp_path / "o"), "--no-png", "--rerun"]) == 1
    assert "rerun-sdk" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_only_measured_depth_is_a_distance() -> None:
    depth = np.array([[0, 4, 5, 9_999, FAR_MM, SATURATED_MM]], np.uint16)
    np.testing.assert_array_equal(measured_mm(depth), [[0, 0, 5, 9_999, 0, 0]])


def test_planes_are_placed_where_the_camera_sees_them() -> None:
    """A plane's corner, from level_cam through the pixel grid: the camera's pose in ned gives the same point."""
    shown = tilted()
    placed = placed_model(shown)
    assert placed is not None
    assert shown.model is not None
    assert shown.R_ned_frd is not None
    assert shown.R_level_cam_optical is not None
    corner = np.array([*shown.model.planes[0, :2], shown.model.planes[0, 4]], dtype=float)
    optical = corner @ shown.R_level_cam_optical
    m = shown.info.mount
    lever = np.array([m.x_m, m.y_m, m.z_m])
    ned = shown.R_ned_frd @ (rotation_frd_optical(m) @ optical + lever) + shown.position_ned_m
    np.testing.assert_allclose([*placed.planes[0, :2], placed.planes[0, 4]], ned, atol=1e-4)


def test_without_position_the_vehicle_is_the_origin_and_blind_frames_have_no_place() -> None:
    assert ned_from_level_cam(replace(frame(), position_ned_m=None)).translation_m == (0.0, 0.0, 0.0)
    assert placed_model(blind()) is None
