"""The model of a frame, out of its message (osape.v1): decoded by the client library, as the algorithm's own types."""

from __future__ import annotations

import dataclasses
from typing import Final

from core.types import FrameModel, FrameStats, FreeProfile, Ground, InvalidCause, Prism
from osape_client import decode
from osape_client.proto import osape_v1_pb2 as pb

from .causes import cause_from_number

STATS: Final = tuple(f.name for f in dataclasses.fields(FrameStats))
"""Names of the counts of a frame."""


def model_from_message(message: pb.PrismsFrame) -> FrameModel | None:
    """The model of a message, in the message's frame; None for a dropped frame, which has none. Raises ValueError for a
    message whose parts do not fit together."""
    decoded = decode.model_from_message(message)
    if decoded is None:
        return None
    cause = cause_from_number(message.cause, InvalidCause)
    if not isinstance(cause, InvalidCause):
        raise ValueError(f"cause {message.cause} of a frame that was extracted")
    free, ground = decoded.free, decoded.ground
    return FrameModel(
        valid=decoded.valid,
        cause=cause,
        planes=decoded.planes,
        support_px=decoded.support_px,
        margin_m=decoded.margin_m,
        flags=decoded.flags,
        cluster=decoded.cluster,
        prisms=tuple(
            Prism(**{f.name: getattr(prism, f.name) for f in dataclasses.fields(Prism)}) for prism in decoded.prisms
        ),
        free=FreeProfile(**{f.name: getattr(free, f.name) for f in dataclasses.fields(FreeProfile)}),
        ground=Ground(**{f.name: getattr(ground, f.name) for f in dataclasses.fields(Ground)}),
        stats=FrameStats(**{name: getattr(message.stats, name) for name in STATS}),
        ke_per_m=message.ke_per_m,
    )
