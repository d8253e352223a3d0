"""Causes of frames that say nothing or were not used, to and from their numbers in the schema."""

from __future__ import annotations

from typing import Final

from core.types import InvalidCause
from osape_client.proto import osape_v1_pb2 as pb

from .sync import DropCause

CAUSES: Final[dict[InvalidCause | DropCause, pb.Cause]] = {
    InvalidCause.NO_MEASUREMENT: pb.CAUSE_NO_MEASUREMENT,
    InvalidCause.TOO_STEEP: pb.CAUSE_TOO_STEEP,
    InvalidCause.BAD_ROTATION: pb.CAUSE_BAD_ROTATION,
    InvalidCause.NON_FINITE: pb.CAUSE_NON_FINITE,
    InvalidCause.MOUNT_ERROR: pb.CAUSE_MOUNT_ERROR,
    InvalidCause.MOUNT_UNVERIFIED: pb.CAUSE_MOUNT_UNVERIFIED,
    DropCause.NO_ATTITUDE: pb.CAUSE_NO_ATTITUDE,
    DropCause.ATTITUDE_STALE: pb.CAUSE_ATTITUDE_STALE,
    DropCause.FRAME_TOO_OLD: pb.CAUSE_FRAME_TOO_OLD,
    DropCause.GAP_TOO_WIDE: pb.CAUSE_GAP_TOO_WIDE,
    DropCause.NO_RATES: pb.CAUSE_NO_RATES,
    DropCause.CLOCK_UNCERTAIN: pb.CAUSE_CLOCK_UNCERTAIN,
    DropCause.DUPLICATE_FRAME: pb.CAUSE_DUPLICATE_FRAME,
    DropCause.LATE_FRAME: pb.CAUSE_LATE_FRAME,
    DropCause.WRONG_SIZE: pb.CAUSE_WRONG_SIZE,
    DropCause.BUSY: pb.CAUSE_BUSY,
}


def cause_message(cause: InvalidCause | DropCause) -> pb.Cause:
    """The number of a cause; both kinds of NONE are CAUSE_NONE."""
    return CAUSES[cause] if cause else pb.CAUSE_NONE


def cause_from_number(number: int, kind: type[InvalidCause] | type[DropCause]) -> InvalidCause | DropCause:
    """The cause of this kind with a number. Raises ValueError where there is none: nothing may be taken from the message."""
    if number == pb.CAUSE_NONE:
        return kind.NONE
    for cause, known in CAUSES.items():
        if known == number and isinstance(cause, kind):
            return cause
    raise ValueError(f"cause {number} is not one of {kind.__name__}: was this written by a newer version?")
