"""Tracked obstacles and the tracker's state as messages (osape.v1.Tracks, osape.v1.TrackerState)."""

from __future__ import annotations

from typing import Final

from core.tracking.snapshot import STATE_VERSION, MovingObject, TrackerState
from osape_client.proto import osape_v1_pb2 as pb

from .causes import cause_message
from .tracking import NamedStates, TracksResult

SCHEMA_VERSION: Final = 1


def tracks_message(result: TracksResult) -> pb.Tracks:
    """Encodes the tracks after a frame."""
    message = pb.Tracks(
        schema_version=SCHEMA_VERSION,
        camera=result.camera,
        sequence=result.sequence,
        t_exposure_ns=result.t_exposure_ns,
        frame=result.frame,
        valid=result.valid,
        cause=cause_message(result.cause),
    )
    t = result.tracks
    if t is None:
        return message
    message.id.extend(t.ids.tolist())
    message.corners_m.extend(t.planes.ravel().tolist())
    message.margin_m.extend(t.margin_m.tolist())
    message.sigma_m.extend(t.sigma_m.tolist())
    message.confidence.extend(t.confidence.tolist())
    message.state.extend(t.state.tolist())
    message.hits.extend(t.hits.tolist())
    message.age_ns.extend(t.age_ns.tolist())
    message.unseen_ns.extend(t.unseen_ns.tolist())
    message.flags.extend(t.flags.tolist())
    message.object_id.extend(t.object_id.tolist())
    message.objects.extend(_object_message(o) for o in t.objects)
    message.left_out, message.evicted = t.left_out, t.evicted
    return message


def _object_message(o: MovingObject) -> pb.MovingObstacle:
    (x, y, z), (hx, hy, hz) = o.centre_m, o.half_size_m
    return pb.MovingObstacle(
        id=o.id,
        centre_m=pb.Vector3(x=x, y=y, z=z),
        half_size_m=pb.Vector3(x=hx, y=hy, z=hz),
        velocity_x_m_s=o.velocity_m_s[0],
        velocity_y_m_s=o.velocity_m_s[1],
        position_sigma_m=o.position_sigma_m,
        velocity_sigma_m_s=o.velocity_sigma_m_s,
        covariance_m2_s=o.cov_m2_s,
        hits=o.hits,
        age_ns=o.age_ns,
        unseen_ns=o.unseen_ns,
    )


def tracker_messages(states: NamedStates) -> list[pb.TrackerState]:
    """Encodes the states of the trackers."""
    return [
        pb.TrackerState(
            camera=camera,
            format=s.version,
            next_id=s.next_id,
            next_object_id=s.next_object_id,
            last_ns=s.last_ns,
            positioned=s.positioned,
            reset_counter=s.reset_counter,
            origin_m=pb.Vector3(x=s.origin_m[0], y=s.origin_m[1], z=s.origin_m[2]),
            velocity_x_m_s=s.velocity_m_s[0],
            velocity_y_m_s=s.velocity_m_s[1],
            slots=s.slots,
            tracks=s.tracks,
            cells=s.cells,
            objects=s.objects,
            history=s.history,
            views=s.views,
            position_jump_ns=s.position_jump_ns,
            heading_jump_ns=s.heading_jump_ns,
            lost_from_ns=[from_ns for from_ns, _ in s.losses],
            lost_to_ns=[to_ns for _, to_ns in s.losses],
        )
        for camera, s in states
    ]


def trackers_from_message(message: pb.StateSnapshot) -> NamedStates:
    """Decodes the states of the trackers. One of another format is left out: its tracker starts empty. The results of frames
    do not depend on it."""
    found = []
    for m in message.trackers:
        if m.format != STATE_VERSION:
            continue
        state = TrackerState(
            next_id=m.next_id,
            next_object_id=m.next_object_id,
            last_ns=m.last_ns if m.HasField("last_ns") else None,
            positioned=m.positioned,
            reset_counter=m.reset_counter,
            position_jump_ns=m.position_jump_ns,
            heading_jump_ns=m.heading_jump_ns,
            losses=tuple(zip(m.lost_from_ns, m.lost_to_ns, strict=True)),
            origin_m=(m.origin_m.x, m.origin_m.y, m.origin_m.z),
            velocity_m_s=(m.velocity_x_m_s, m.velocity_y_m_s),
            slots=m.slots,
            tracks=m.tracks,
            cells=m.cells,
            objects=m.objects,
            history=m.history,
            views=tuple(m.views),
        )
        found.append((m.camera, state))
    return tuple(found)
