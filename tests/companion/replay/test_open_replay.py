"""A log of frames with marked pixels, replayed with open space presumed: the same bytes, and open ranges in them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from companion.cli import main
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.pipeline.state import CameraState, PipelineState
from core.self_check.mount_check import MountState, MountVerdict
from core.types import TEXTURELESS_MM, CameraInfo, DepthFrame, Intrinsics
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import SimulatedFlight
from osape_client import decode

SMALL = CameraInfo("front", Intrinsics(96, 72, 67.5, 67.5, 47.5, 35.5), ke_per_m=0.0015, marks_smooth=True)


def sky_marked(frame: DepthFrame) -> DepthFrame:
    """The frame with its upper part textureless, down to what is measured."""
    depth = frame.depth_mm.copy()
    for u in range(depth.shape[1]):
        measured = np.flatnonzero((depth[:, u] > 0) & (depth[:, u] < 65_000))
        depth[: measured[0] if len(measured) else 0, u] = TEXTURELESS_MM
    return dataclasses.replace(frame, depth_mm=depth)


def verified(t_ns: int) -> PipelineState:
    """Of a flight whose mount was verified a moment before t_ns. Its filter is new, so that the verdict does not last."""
    mount = MountState(t_ns=t_ns, verdict=MountVerdict.VERIFIED, pending=MountVerdict.VERIFIED, ground=True)
    return PipelineState((("front", CameraState(mount=mount)),))


def test_a_replay_with_open_space_gives_the_same_bytes(tmp_path: Path) -> None:
    events = [
        sky_marked(e) if isinstance(e, DepthFrame) else e
        for e in SimulatedFlight("demo", cameras=(SMALL,), duration_s=1.0).events()
    ]
    source, first, second = (tmp_path / f"{name}.mcap" for name in ("source", "first", "second"))
    config = tmp_path / "presume.toml"
    config.write_text('[open_sky]\nmode = "presume"\nhorizon_deg = 10.0\n')
    with LogWriter(source) as log:
        start_ns = events[0].t_arrival_ns
        log.begin(run_info("simulated"), (SMALL,), verified(start_ns - 1), t_ns=start_ns)
        for event in events:
            log.event(event)
    assert main(["replay", str(source), "-o", str(first), "--config", str(config)]) == 0
    assert main(["replay", str(first), "-o", str(second)]) == 0  # the log holds its configuration
    assert first.read_bytes() == second.read_bytes()
    assert main(["replay", str(first), "--check"]) == 0
    with McapRecording(first) as recording:
        frames = [item.message for item in recording.messages("prisms")]
    profiles = [decode.free_from_message(f.free) for f in frames if f.valid]
    opened = [f.has_open for f in profiles]
    assert opened[0], "the verdict of the snapshot is in use"
    assert not opened[-1], "it was withdrawn"
    assert any(f.open_to_dm.any() for f in profiles if f.has_open)
