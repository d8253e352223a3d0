"""Tracked obstacles from the pipeline to the log, the stream and the client."""

from __future__ import annotations

import dataclasses
import math
import threading
from pathlib import Path

import numpy as np
import pytest
import zmq

from companion.config.loader import Config
from companion.config.service import PublishConfig
from companion.live.staleness import StalenessMonitor
from companion.live.stream_output import StreamOutput
from companion.log.log_writer import LogWriter, write_recording
from companion.log.provenance import run_info
from companion.pipeline.configured import make_pipeline
from companion.pipeline.encode import wire_bytes
from companion.pipeline.results import PrismsResult
from companion.pipeline.state_messages import state_from_message, state_message
from companion.pipeline.track_messages import tracks_message
from companion.pipeline.tracking import TracksResult, tracking_frame
from companion.replay.replay import Options, replay
from companion.replay.replay_report import replay_problems
from companion.streams.publication import PublicationStamps
from core.frames import level_cam_at, quaternion_from_euler
from core.tracking.params import TrackingParams
from core.types import AttitudeSample, CameraInfo, CameraMount, DepthFrame, Intrinsics
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import SimulatedFlight
from osape_client import TracksSubscriber, TrackState, tracks_from_message
from osape_client.proto import osape_v1_pb2 as pb

SMALL = CameraInfo("front", Intrinsics(96, 72, 67.5, 67.5, 47.5, 35.5), ke_per_m=0.0015)
ON = dataclasses.replace(Config(), tracking=TrackingParams(enabled=True, most_tracks=512))
LEVEL = dataclasses.replace(ON, sync=dataclasses.replace(ON.sync, use_pose=False))


@pytest.fixture(scope="module")
def events() -> list[object]:
    return list(SimulatedFlight("street", cameras=(SMALL,), duration_s=1.5).events())


def run(config: Config, events: list[object]) -> list[TracksResult]:
    pipeline = make_pipeline(config, (SMALL,))
    outputs = [output for event in events for output in pipeline.handle(event)]  # type: ignore[arg-type]
    return [t for output in outputs if (t := pipeline.track(output)) is not None]


def test_tracking_is_off_by_default_and_changes_no_frame(events):
    plain, tracked = make_pipeline(Config(), (SMALL,)), make_pipeline(ON, (SMALL,))
    assert run(Config(), events) == []
    for event in events:
        a, b = plain.handle(event), tracked.handle(event)
        for one, other in zip(a, b, strict=True):
            tracked.track(other)
            if isinstance(one, PrismsResult) and one.model is not None:
                np.testing.assert_array_equal(one.model.planes, other.model.planes)
    assert plain.state().trackers == ()


def test_each_frame_has_tracks_in_its_own_frame(events):
    for config, name in ((ON, "ned"), (LEVEL, "level")):
        results = run(config, events)
        assert len(results) >= 12
        for r in results:
            assert r.frame == name
            assert r.valid
            assert r.tracks is not None
            assert len(r.tracks.ids) > 5
        steady = results[8].tracks
        firm = set(steady.ids[steady.hits >= 6].tolist())
        assert len(firm) >= 3
        assert len(firm & set(results[-1].tracks.ids.tolist())) >= 0.7 * len(firm)


@pytest.mark.parametrize("config", [ON, LEVEL], ids=["ned", "level"])
def test_a_frame_with_a_stamp_of_the_past_changes_no_track(events, config):
    """1.1 s back, where attitudes are still held: the image is a new one, its attitude would be an old one."""
    frames = [k for k, e in enumerate(events) if isinstance(e, DepthFrame)]
    at = frames[-3]
    late = dataclasses.replace(events[at], t_exposure_ns=events[at].t_exposure_ns - 1_100_000_000)
    one, other = run(config, events), run(config, [*events[: at + 1], late, *events[at + 1 :]])
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert wire_bytes(tracks_message(a)) == wire_bytes(tracks_message(b))


def test_without_a_position_tracks_lie_on_the_planes_of_the_frame(events):
    pipeline = make_pipeline(LEVEL, (SMALL,))
    for event in events:
        for output in pipeline.handle(event):
            tracks = pipeline.track(output)
            if tracks is None:
                continue
            model = output.model
            long = model.planes[np.hypot(*(model.planes[:, 2:4] - model.planes[:, 0:2]).T) > 1.0]
            seen = tracks.tracks.planes[tracks.tracks.unseen_ns == 0]
            for plane in long:
                middle = 0.5 * (plane[:2] + plane[2:4])
                assert min(distance(row, middle) for row in seen) < 0.6


@pytest.mark.parametrize("config", [ON, LEVEL], ids=["ned", "level"])
def test_the_tracker_gets_the_place_of_the_camera_north_and_east_of_the_vehicle(events, config):
    """Without a position from the vehicle itself."""
    mount = CameraMount(yaw_rad=0.3, x_m=0.4, y_m=-0.2, z_m=0.1)
    pipeline = make_pipeline(config, (dataclasses.replace(SMALL, mount=mount),))
    turn = quaternion_from_euler(0.1, -0.05, 1.2)
    events = [dataclasses.replace(e, q_ned_frd_wxyz=turn) if isinstance(e, AttitudeSample) else e for e in events[:60]]
    results = [o for e in events for o in pipeline.handle(e) if isinstance(o, PrismsResult) and o.attitude is not None]
    assert results
    for r in results:
        found, _ = tracking_frame(r)
        origin = r.pose.position_ned_m if r.pose is not None else (0.0, 0.0, 0.0)
        lever_ned_m = level_cam_at(turn, mount)[3]
        assert found is not None
        assert found.positioned is (config is ON)
        np.testing.assert_allclose(found.camera_m, np.add(origin, lever_ned_m), atol=1e-6)


def distance(row: np.ndarray, at: np.ndarray) -> float:
    e = row[2:4] - row[:2]
    q = np.clip(((at - row[:2]) @ e) / max(float(e @ e), 1e-9), 0.0, 1.0)
    return float(np.linalg.norm(row[:2] + q * e - at))


def test_the_message_holds_the_tracks(events):
    result = run(ON, events)[-1]
    message = pb.Tracks.FromString(wire_bytes(tracks_message(result)))
    tracks = tracks_from_message(message)
    assert result.tracks is not None
    np.testing.assert_array_equal(tracks.ids, result.tracks.ids)
    np.testing.assert_array_equal(tracks.planes, result.tracks.planes)
    np.testing.assert_array_equal(tracks.confidence, result.tracks.confidence)
    assert set(tracks.states) <= set(TrackState) - {TrackState.UNKNOWN}
    assert tracks.valid
    message.margin_m.append(1.0)
    with pytest.raises(ValueError, match="margin_m"):
        tracks_from_message(message)


def test_a_message_says_what_had_no_room(events):
    result = next(r for r in run(ON, events) if r.tracks is not None)
    full = dataclasses.replace(result, tracks=dataclasses.replace(result.tracks, left_out=3, evicted=5))
    tracks = tracks_from_message(tracks_message(full))
    assert (tracks.left_out, tracks.evicted) == (3, 5)
    assert tracks_from_message(tracks_message(result)).left_out == 0


def test_a_moving_obstacle_is_predicted_with_its_error():
    message = pb.Tracks(schema_version=1, frame="ned", valid=True)
    message.objects.add(
        id=3,
        centre_m=pb.Vector3(x=5.0, y=1.0, z=-1.0),
        velocity_x_m_s=1.0,
        velocity_y_m_s=-2.0,
        position_sigma_m=0.1,
        velocity_sigma_m_s=0.2,
    )
    obstacle = tracks_from_message(message).objects[0]
    centre, sigma = obstacle.predicted(0.5)
    assert centre == pytest.approx((5.5, 0.0, -1.0))
    assert sigma == pytest.approx(math.sqrt(0.01 + 0.01))


def test_a_dropped_frame_has_no_tracks_and_is_invalid(events):
    frames = [e for e in events if not hasattr(e, "q_ned_frd_wxyz")]
    results = run(ON, frames)
    assert results
    assert all(r.tracks is None and not r.valid for r in results)
    assert not tracks_message(results[0]).valid


def test_the_state_survives_its_message(events):
    pipeline = make_pipeline(ON, (SMALL,))
    half = len(events) // 2
    for event in events[:half]:
        for output in pipeline.handle(event):
            pipeline.track(output)
    state = state_from_message(pb.StateSnapshot.FromString(wire_bytes(state_message(pipeline.state()))))
    assert state.trackers == pipeline.state().trackers
    other = make_pipeline(ON, (SMALL,), state)
    for event in events[half:]:
        for one, again in zip(pipeline.handle(event), other.handle(event), strict=True):
            a, b = pipeline.track(one), other.track(again)
            assert (a is None) == (b is None)
            if a is not None and b is not None:
                assert wire_bytes(tracks_message(a)) == wire_bytes(tracks_message(b))


def test_a_log_without_all_depth_images_continues_the_tracks(events):
    """Such a log holds the state of the camera before each recorded depth image, see `[record] depth_hz`."""
    pipeline, other = make_pipeline(ON, (SMALL,)), make_pipeline(ON, (SMALL,))
    half = len(events) // 2
    for event in events[:half]:
        for output in pipeline.handle(event):
            pipeline.track(output)
        if not isinstance(event, DepthFrame):
            assert not list(other.handle(event))
    state = pipeline.camera_state("front")
    assert [name for name, _ in state.trackers] == ["front"]
    other.resume(state_from_message(pb.StateSnapshot.FromString(wire_bytes(state_message(state)))))
    compared = 0
    for event in events[half:]:
        for one, again in zip(pipeline.handle(event), other.handle(event), strict=True):
            a, b = pipeline.track(one), other.track(again)
            assert (a is None) == (b is None)
            if a is not None and b is not None:
                assert wire_bytes(tracks_message(a)) == wire_bytes(tracks_message(b))
                compared += 1
    assert compared >= 3


def test_a_state_of_another_format_is_not_used(events):
    pipeline = make_pipeline(ON, (SMALL,))
    for event in events[: len(events) // 2]:
        for output in pipeline.handle(event):
            pipeline.track(output)
    message = state_message(pipeline.state())
    message.trackers[0].format = 999
    assert state_from_message(message).trackers == ()


def test_a_camera_with_another_description_gets_new_ids(events):
    pipeline = make_pipeline(ON, (SMALL,))
    ids: list[set[int]] = [set(), set()]
    for k, event in enumerate(events):
        if k == len(events) // 2:
            pipeline.announce(dataclasses.replace(SMALL, ke_per_m=0.002))
        for output in pipeline.handle(event):
            result = pipeline.track(output)
            if result is not None and result.tracks is not None:
                ids[k >= len(events) // 2] |= set(result.tracks.ids.tolist())
    assert min(map(len, ids)) > 5
    assert not ids[0] & ids[1]


@pytest.mark.parametrize("config", [ON, LEVEL], ids=["ned", "level"])
def test_replay_checks_the_tracks_of_a_log_that_begins_in_flight(events, config, tmp_path):
    """A file whose opening snapshot holds tracks, as the second file of a flight."""
    pipeline, half = make_pipeline(config, (SMALL,)), len(events) // 2
    path = tmp_path / "second.mcap"
    with LogWriter(path) as log:
        for k, event in enumerate(events):
            if k == half:
                log.begin(run_info("live", config), (SMALL,), pipeline.state(), event.t_arrival_ns)
            outputs = pipeline.handle(event)
            if k >= half:
                log.event(event)
            for output in outputs:
                tracks = pipeline.track(output)
                if k >= half:
                    log.output(output)
                    if tracks is not None:
                        log.tracks(tracks, wire_bytes(tracks_message(tracks)))
    result = replay(path, Options(check=True))
    assert replay_problems(result) == []
    assert result.tracks is not None
    assert result.tracks.compared >= 5
    with McapRecording(path) as recording:
        logged = [item.message for item in recording.messages("tracks")]
    assert len(logged) == result.tracks.compared
    assert min(len(m.id) for m in logged) > 5


def test_replay_reports_tracks_that_differ(events, tmp_path):
    recorded, written = tmp_path / "in.mcap", tmp_path / "out.mcap"

    class Source:
        cameras = (SMALL,)

        def events(self):
            yield from events

    write_recording(Source(), recorded, run_info("simulated", ON))
    replay(recorded, Options(output=written))
    assert replay_problems(replay(written, Options(check=True))) == []
    changed = tmp_path / "changed.mcap"
    rewrite(written, changed)
    problems = replay_problems(replay(changed, Options(check=True)))
    assert len(problems) == 1
    assert "the tracks of 1 of" in problems[0]
    assert "confidence[0]" in problems[0]


def rewrite(source: Path, target: Path) -> None:
    """A copy of a log with the confidence of one track changed."""
    with McapRecording(source) as recording, LogWriter(target) as log:
        assert recording.run is not None
        log.begin(recording.run, recording.cameras, state_from_message(recording.snapshot))
        changed = False
        for item in recording.messages():
            if item.key in ("run", "camera_info", "calibration", "state"):
                continue
            if item.key == "tracks" and not changed and item.message.confidence:
                item.message.confidence[0] = 0.25
                changed = True
            log.write(item.key, item.message, item.t_log_ns, item.camera, item.sequence)


def test_the_stream_exists_only_where_tracking_is_enabled(events, tmp_path):
    addresses = PublishConfig(prisms="", health="", surround="", depth="", tracks=f"ipc://{tmp_path}/tracks", keys="")
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        for enabled in (False, True):
            config = dataclasses.replace(ON if enabled else Config(), publish=addresses)
            output = StreamOutput(
                config, PublicationStamps("boot"), StalenessMonitor(("front",), 0.3), threading.Lock()
            )
            output.open(tmp_path, context, None)
            assert ("tracks" in output.publishers) is enabled
            if enabled:
                result = run(ON, events)[0]
                data = wire_bytes(tracks_message(result))
                with TracksSubscriber(addresses.tracks) as subscriber:
                    received = None
                    for _ in range(50):  # until the subscription is there
                        output.publish_tracks(result, data)
                        received = subscriber.wait(0.1)
                        if received is not None:
                            break
                    assert received is not None
                    assert received.content.publication.boot_id == "boot"
                    assert received.content.sequence == result.sequence
                    assert received.tracks.ids.tolist() == result.tracks.ids.tolist()
                    assert received.stale  # the flight's clock is not this machine's
            output.close()
    finally:
        context.destroy(linger=0)
