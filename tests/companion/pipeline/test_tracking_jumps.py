"""Tracks across jumps of the autopilot's estimate of heading or position: the vehicle has not moved by them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from companion.config.loader import Config
from companion.pipeline.configured import make_pipeline
from companion.pipeline.encode import wire_bytes
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.quaternion import product
from companion.pipeline.results import PrismsResult
from companion.pipeline.state import PipelineState
from companion.pipeline.state_messages import state_from_message, state_message
from companion.pipeline.track_messages import tracks_message
from companion.pipeline.tracking import TracksResult
from core.frames import quaternion_from_euler
from core.tracking.params import TrackingParams
from core.types import AttitudeSample, CameraInfo, Intrinsics, PoseSample
from drivers.base import Event
from drivers.simulation.flight import SimulatedFlight
from osape_client.proto import osape_v1_pb2 as pb

SMALL = CameraInfo("front", Intrinsics(96, 72, 67.5, 67.5, 47.5, 35.5), ke_per_m=0.0015)
ON = dataclasses.replace(Config(), tracking=TrackingParams(enabled=True, most_tracks=512))
LEVEL = dataclasses.replace(ON, sync=dataclasses.replace(ON.sync, use_pose=False))
TURN = quaternion_from_euler(0.0, 0.0, math.radians(25.0))
STEP_M = 2.0
"""Less than the vehicle could fly between two frames by the tracker's own limit."""
STEADY_HITS = 6


@pytest.fixture(scope="module")
def events() -> list[Event]:
    return list(SimulatedFlight("street", cameras=(SMALL,), duration_s=2.0).events())


def jump_ns(events: list[Event]) -> int:
    """An instant in the middle of the flight."""
    stamps = [e.t_ns for e in events if isinstance(e, AttitudeSample)]
    return (stamps[0] + stamps[-1]) // 2


def heading_jumps(events: list[Event], at_ns: int) -> list[Event]:
    """The events with a heading that jumps at an instant."""
    return [
        dataclasses.replace(e, q_ned_frd_wxyz=product(TURN, e.q_ned_frd_wxyz))
        if isinstance(e, AttitudeSample) and e.t_ns >= at_ns
        else e
        for e in events
    ]


def position_jumps(events: list[Event], at_ns: int) -> list[Event]:
    """The events with a position that jumps at an instant, without a reset counter."""
    return [
        dataclasses.replace(e, position_ned_m=(e.position_ned_m[0], e.position_ned_m[1] + STEP_M, e.position_ned_m[2]))
        if isinstance(e, PoseSample) and e.t_ns >= at_ns
        else e
        for e in events
    ]


def run(pipeline: Pipeline, events: list[Event]) -> list[tuple[PrismsResult, TracksResult]]:
    """The results of all frames with their tracks."""
    found = []
    for event in events:
        for output in pipeline.handle(event):
            tracks = pipeline.track(output)
            if tracks is not None:
                assert isinstance(output, PrismsResult)
                found.append((output, tracks))
    return found


def steady_ids(result: TracksResult) -> set[int]:
    assert result.tracks is not None
    return set(result.tracks.ids[result.tracks.hits >= STEADY_HITS].tolist())


def share_beside(result: PrismsResult, tracks: TracksResult) -> float:
    """Share of the steady tracks that stand at no plane of the frame, of those that lie in the image."""
    assert result.model is not None
    assert result.transform is not None
    assert tracks.tracks is not None
    planes = tracks.tracks.planes[tracks.tracks.hits >= STEADY_HITS].astype(np.float64)
    at = np.array(result.transform.translation_m[:2])
    middle = 0.5 * (planes[:, 0:2] + planes[:, 2:4]) - at
    edges = result.model.free.azimuth_edges_rad
    azimuth = np.arctan2(middle[:, 1], middle[:, 0]) - 0.5 * (edges[0] + edges[-1])
    inside = np.abs((azimuth + np.pi) % (2.0 * np.pi) - np.pi) < 0.4 * (edges[-1] - edges[0])
    near = [min(distance(row, m + at) for row in result.model.planes) < 0.6 for m in middle[inside]]
    assert len(near) >= 3
    return 1.0 - float(np.mean(near))


def distance(row: np.ndarray, at: np.ndarray) -> float:
    e = row[2:4] - row[:2]
    q = np.clip(((at - row[:2]) @ e) / max(float(e @ e), 1e-9), 0.0, 1.0)
    return float(np.linalg.norm(row[:2] + q * e - at))


@pytest.mark.parametrize(
    ("config", "jump"),
    [(ON, heading_jumps), (LEVEL, heading_jumps), (ON, position_jumps)],
    ids=["heading, ned", "heading, level", "position"],
)
def test_tracks_keep_their_place_relative_to_the_vehicle(events, config, jump):
    at_ns = jump_ns(events)
    found = run(make_pipeline(config, (SMALL,)), jump(events, at_ns))
    first = next(k for k, (result, _) in enumerate(found) if result.t_exposure_ns >= at_ns)
    before, after = found[first - 1], found[first + 1]
    without = run(make_pipeline(config, (SMALL,)), events)
    kept = len(steady_ids(before[1]) & steady_ids(after[1])) / len(steady_ids(before[1]))
    usual = steady_ids(without[first - 1][1]) & steady_ids(without[first + 1][1])
    assert kept >= 0.9 * len(usual) / len(steady_ids(without[first - 1][1]))
    assert share_beside(*after) <= share_beside(*without[first + 1]) + 0.1


@pytest.mark.parametrize("config", [ON, LEVEL], ids=["ned", "level"])
@pytest.mark.parametrize("jump", [heading_jumps, position_jumps])
def test_a_jump_moves_the_tracks_once_also_in_a_replay(events, config, jump):
    """A state from before the jump, and one from after it, give the same tracks bit for bit."""
    at_ns = jump_ns(events)
    changed = jump(events, at_ns)
    for share in (0.3, 0.75):
        cut = int(share * len(changed))
        pipeline = make_pipeline(config, (SMALL,))
        run(pipeline, changed[:cut])
        again = make_pipeline(config, (SMALL,), few_samples(restored(pipeline)))
        one, other = run(pipeline, changed[cut:]), run(again, changed[cut:])
        assert len(one) == len(other) >= 4
        for (_, a), (_, b) in zip(one, other, strict=True):
            assert wire_bytes(tracks_message(a)) == wire_bytes(tracks_message(b))


def restored(pipeline: Pipeline) -> PipelineState:
    """The state of a pipeline out of its message."""
    return state_from_message(pb.StateSnapshot.FromString(wire_bytes(state_message(pipeline.state()))))


def few_samples(state: PipelineState) -> PipelineState:
    """A state without the samples of before an earlier jump, as after a longer flight."""
    return dataclasses.replace(state, attitudes=state.attitudes[-4:], poses=state.poses[-4:])
