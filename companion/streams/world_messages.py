"""The merged world to and from its message. Needs protobuf and numpy only: a planner's process reads it too."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from core.world.serialize import ON_WIRE, box_of_records, wire_records
from core.world.snapshot import WorldPicture
from drivers.proto import osape_v1_pb2 as pb

SCHEMA_VERSION = 1
BLOCK_BYTES = 256 * 8
GROUND_BYTES = 256 * 4
NO_GROUND_CM = 65535


def world_message(picture: WorldPicture, removed: NDArray[np.int32], now_ns: int) -> pb.WorldUpdate:
    """What a picture holds, and the slots that are empty now; the rest is for the sender to fill in."""
    return pb.WorldUpdate(
        schema_version=SCHEMA_VERSION, section=picture.section, planes=wire_records(picture, now_ns),
        removed=removed.tolist(), blocks=picture.blocks.ravel().tolist(),
        masks=zlib.compress(picture.masks.astype("<u8").tobytes(), 1) if len(picture.masks) else b"",
        ground=_packed_ground(picture),
    )  # fmt: skip


def _packed_ground(picture: WorldPicture) -> bytes:
    """The ground of a picture's blocks; empty where none is known. Rounded so that it is nowhere lower than it was."""
    if picture.ground is None or np.isnan(picture.ground[:, :, 0]).all():
        return b""
    known = ~np.isnan(picture.ground[:, :, 0])
    z, noise = (picture.ground[:, :, k].astype(np.float64) for k in (0, 1))
    above = 32.0 * picture.blocks[:, 2].astype(np.float64)[:, None]  # upper edge of each block
    wire = np.full((*known.shape, 2), NO_GROUND_CM, "<u2")
    wire[:, :, 0][known] = np.clip(np.floor(100.0 * (z - above) + 1e-3), 0, NO_GROUND_CM - 1)[known]
    wire[:, :, 1][known] = np.clip(np.ceil(100.0 * noise - 1e-3), 0, NO_GROUND_CM - 1)[known]
    return zlib.compress(wire.tobytes(), 1)


def records_of(message: pb.WorldUpdate) -> NDArray[np.void]:
    """The planes of a message. Raises ValueError."""
    if len(message.planes) % ON_WIRE.itemsize:
        raise ValueError(f"planes of {len(message.planes)} bytes, expected a multiple of {ON_WIRE.itemsize}")
    return np.frombuffer(message.planes, ON_WIRE)


def blocks_of(message: pb.WorldUpdate) -> tuple[NDArray[np.int32], NDArray[np.uint64]]:
    """(indices (B, 3), masks (B, 256)) of a message. Raises ValueError; never takes more memory than it announces."""
    if len(message.blocks) % 3:
        raise ValueError(f"{len(message.blocks)} indices of blocks, expected a multiple of 3")
    count = len(message.blocks) // 3
    raw = _unpacked(message.masks, count * BLOCK_BYTES, "masks")
    blocks = np.array(message.blocks, np.int32).reshape(-1, 3)
    return blocks, np.frombuffer(raw, "<u8").astype(np.uint64).reshape(-1, 256)


def ground_of(message: pb.WorldUpdate) -> NDArray[np.float32]:
    """(B, 256, 2) the ground of a message's blocks, as in a WorldPicture; nan where none is known. Raises ValueError."""
    iz = np.array(message.blocks, np.int32)[2::3].astype(np.float64)
    out = np.full((len(message.blocks) // 3, 256, 2), np.nan)
    if message.ground:
        raw = _unpacked(message.ground, len(out) * GROUND_BYTES, "ground")
        wire = np.frombuffer(raw, "<u2").reshape(out.shape)
        known = wire[:, :, 0] != NO_GROUND_CM
        out[known] = (wire / 100.0)[known]
        out[:, :, 0] += 32.0 * iz[:, None]
    return out.astype(np.float32)


def _unpacked(packed: bytes, size: int, name: str) -> bytes:
    """Exactly so many bytes, never more memory than that. Raises ValueError."""
    unpack = zlib.decompressobj()
    try:
        raw = unpack.decompress(packed, size + 1) if packed else b""
    except zlib.error as error:
        raise ValueError(f"{name} of {len(packed)} bytes cannot be unpacked ({error})") from error
    if len(raw) != size:
        raise ValueError(f"{name} of {len(raw)} bytes or more, expected {size}")
    return raw


def picture_of(
    section: int, records: NDArray[np.void], blocks: NDArray[np.int32], masks: NDArray[np.uint64],
    ground: NDArray[np.float32], t_ns: int,
) -> WorldPicture:  # fmt: skip
    """The picture of planes and blocks that came in messages; t_ns: what their ages count from."""
    return WorldPicture(
        section=section, slots=records["slot"].astype(np.int32), planes=box_of_records(records).astype(np.float32),
        margin_m=(records["margin_mm"] / 1000.0).astype(np.float32), flags=records["flags"].astype(np.uint8),
        hits=records["hits"].astype(np.int32), seen_ns=t_ns - records["age_s"].astype(np.int64) * 1_000_000_000,
        blocks=blocks, masks=masks, ground=ground,
    )  # fmt: skip
