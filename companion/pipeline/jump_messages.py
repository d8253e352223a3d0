"""Encodes and decodes the state of the detection of jumps of the autopilot's estimate (osape.v1)."""

from __future__ import annotations

from drivers.logs.codec import (
    attitude_from_message,
    attitude_message,
    pose_from_message,
    pose_message,
    set_vector,
)
from osape_client.proto import osape_v1_pb2 as pb

from .heading_jumps import HeadingState
from .position_sections import PositionState, Section


def heading_message(state: HeadingState) -> pb.HeadingState:
    """Encodes the state of the heading."""
    return pb.HeadingState(
        number=state.number,
        turned_rad=state.turned_rad,
        gap_ns=state.gap_ns,
        newest=None if state.newest is None else attitude_message(state.newest),
        jumps=[pb.HeadingState.Angle(t_ns=t_ns, angle_rad=angle_rad) for t_ns, angle_rad in state.jumps],
        sum_rad=state.sum_rad,
        sums=[pb.HeadingState.Angle(t_ns=t_ns, angle_rad=angle_rad) for t_ns, angle_rad in state.sums],
    )


def heading_from_message(message: pb.HeadingState) -> HeadingState:
    """Decodes the state of the heading."""
    return HeadingState(
        message.number,
        message.turned_rad,
        message.gap_ns,
        attitude_from_message(message.newest) if message.HasField("newest") else None,
        tuple((jump.t_ns, jump.angle_rad) for jump in message.jumps),
        message.sum_rad,
        tuple((mark.t_ns, mark.angle_rad) for mark in message.sums),
    )


def position_message(state: PositionState) -> pb.PositionState:
    """Encodes the state of the position."""
    message = pb.PositionState(
        number=state.number,
        since_ns=state.since_ns,
        newest=None if state.newest is None else pose_message(state.newest),
        begun=[
            pb.PositionState.Section(number=s.number, begins_ns=s.begins_ns, jump_ns=s.jump_ns) for s in state.begun
        ],
    )
    set_vector(message.sum_m, state.sum_m)
    for t_ns, sum_m in state.sums:
        set_vector(message.sums.add(t_ns=t_ns).sum_m, sum_m)
    return message


def position_from_message(message: pb.PositionState) -> PositionState:
    """Decodes the state of the position."""
    total = message.sum_m
    return PositionState(
        message.number,
        message.since_ns,
        pose_from_message(message.newest) if message.HasField("newest") else None,
        tuple(Section(s.number, s.begins_ns, s.jump_ns) for s in message.begun),
        (total.x, total.y, total.z),
        tuple((mark.t_ns, (mark.sum_m.x, mark.sum_m.y, mark.sum_m.z)) for mark in message.sums),
    )
