"""The first frame of a live page."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from ..live_service import ROOT
from ..scripted_service import ScriptedService

pytestmark = pytest.mark.process

PROGRAM = """
import json, sys
from pathlib import Path
import numpy as np
from companion.viewer.live_view import load_drawing
from companion.viewer.live_page import frame_of
from companion.viewer.live_camera import Shown
from osape_client.proto import osape_v1_pb2 as pb
from tests.companion.view_scenes import INFO

if sys.argv[2] == "loaded":
    load_drawing()
before = set(sys.modules)
preview = pb.DepthPreview(width_px=320, height_px=240, depth_mm=np.full((240, 320), 4000, "<u2").tobytes())
message = pb.PrismsFrame.FromString(Path(sys.argv[1]).read_bytes())
data = frame_of(Shown(1, INFO, message, preview, message.t_exposure_ns), 0)
print(json.dumps([sorted(set(sys.modules) - before), len(data["planes"]), bool(data["depth"])]))
"""


def new_modules(message: Path, how: str) -> list[str]:
    """What a process imports for its first frame."""
    command = [sys.executable, "-c", PROGRAM, str(message), how]
    modules, planes, has_depth = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout)
    assert planes
    assert has_depth
    return list(modules)


def test_the_first_frame_imports_nothing_after_the_load(scripted: ScriptedService, tmp_path: Path) -> None:
    message = tmp_path / "message"
    message.write_bytes(scripted.message().SerializeToString())
    assert new_modules(message, "loaded") == []
    assert new_modules(message, "not loaded"), "otherwise load_drawing is not needed"
