"""The merged world as a message (osape.v1.WorldUpdate). It is decoded by osape_client/world/decode.py."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from core.world.serialize import MOST_MARGIN_M, packed
from core.world.snapshot import WorldSnapshot
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.world.decode import BLOCK_HEIGHT_M, NO_GROUND_CM, PLANE_RECORD, SCHEMA_VERSION

from ..pipeline.encode import wire_bytes

NS = 1_000_000_000


def world_message(picture: WorldSnapshot, removed: NDArray[np.int32], now_ns: int) -> pb.WorldUpdate:
    """The message of a picture and of the slots that are empty now; the caller sets the remaining fields."""
    return pb.WorldUpdate(
        schema_version=SCHEMA_VERSION,
        section=picture.section,
        planes=plane_records(picture, now_ns),
        removed=removed.tolist(),
        blocks=picture.blocks.ravel().tolist(),
        masks=zlib.compress(picture.masks.astype("<u8").tobytes(), 1) if len(picture.masks) else b"",
        ground=_packed_ground(picture),
    )


def snapshot_message(picture: WorldSnapshot, now_ns: int) -> pb.WorldUpdate:
    """The message of a picture of the whole world. It may be newer than the last message of the stream; the next changes
    repeat the difference."""
    message = world_message(picture, np.zeros(0, np.int32), now_ns)
    message.snapshot = True
    return message


def update_bytes(message: pb.WorldUpdate) -> bytes:
    """The encoded message, its publication last: a subscriber that finds it has the whole message. Fields are encoded in the order
    of their numbers, and those of the ground and the cause are higher."""
    content, last = pb.WorldUpdate(), pb.WorldUpdate(publication=message.publication)
    content.CopyFrom(message)
    content.ClearField("publication")
    return wire_bytes(content) + wire_bytes(last)


def plane_records(picture: WorldSnapshot, now_ns: int) -> bytes:
    """The planes of a picture as PLANE_RECORDs, their ages counted at now_ns."""
    age_s = np.maximum(0, now_ns - picture.seen_ns) // NS
    # beyond the greatest range of a camera, a margin covers all that it sees
    margin_m = np.clip(picture.margin_m, 0.0, MOST_MARGIN_M)
    records = packed(PLANE_RECORD, picture.planes, margin_m, picture.flags, picture.hits, age_s)
    records["slot"] = picture.slots
    return records.tobytes()


def _packed_ground(picture: WorldSnapshot) -> bytes:
    """The ground of a picture's blocks; empty where none is known. Rounded so that it is nowhere lower than it was."""
    if picture.ground is None or np.isnan(picture.ground[:, :, 0]).all():
        return b""
    known = ~np.isnan(picture.ground[:, :, 0])
    z, noise = (picture.ground[:, :, k].astype(np.float64) for k in (0, 1))
    above = BLOCK_HEIGHT_M * picture.blocks[:, 2].astype(np.float64)[:, None]  # upper edge of each block
    wire = np.full((*known.shape, 2), NO_GROUND_CM, "<u2")
    wire[:, :, 0][known] = np.clip(np.floor(100.0 * (z - above) + 1e-3), 0, NO_GROUND_CM - 1)[known]
    wire[:, :, 1][known] = np.clip(np.ceil(100.0 * noise - 1e-3), 0, NO_GROUND_CM - 1)[known]
    return zlib.compress(wire.tobytes(), 1)
