"""The merged world to and from its message. Needs protobuf and numpy only: a planner's process reads it too."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from core.world_picture import WorldPicture
from core.world_saved import ON_WIRE, box_of_records, wire_records
from drivers.proto import osape_v1_pb2 as pb

SCHEMA_VERSION = 1
BLOCK_BYTES = 256 * 8


def world_message(picture: WorldPicture, removed: NDArray[np.int32], now_ns: int) -> pb.WorldUpdate:
    """What a picture holds, and the slots that are empty now; the rest is for the sender to fill in."""
    return pb.WorldUpdate(
        schema_version=SCHEMA_VERSION, section=picture.section, planes=wire_records(picture, now_ns),
        removed=removed.tolist(), blocks=picture.blocks.ravel().tolist(),
        masks=zlib.compress(picture.masks.astype("<u8").tobytes(), 1) if len(picture.masks) else b"",
    )  # fmt: skip


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
    unpack = zlib.decompressobj()
    try:
        raw = unpack.decompress(message.masks, count * BLOCK_BYTES + 1) if message.masks else b""
    except zlib.error as error:
        raise ValueError(f"masks of {len(message.masks)} bytes cannot be unpacked ({error})") from error
    if len(raw) != count * BLOCK_BYTES:
        raise ValueError(f"masks of {len(raw)} bytes or more, expected {count * BLOCK_BYTES}")
    blocks = np.array(message.blocks, np.int32).reshape(-1, 3)
    return blocks, np.frombuffer(raw, "<u8").astype(np.uint64).reshape(-1, 256)


def picture_of(
    section: int, records: NDArray[np.void], blocks: NDArray[np.int32], masks: NDArray[np.uint64], t_ns: int
) -> WorldPicture:
    """The picture of planes and blocks that came in messages; t_ns: what their ages count from."""
    return WorldPicture(
        section=section, slots=records["slot"].astype(np.int32), planes=box_of_records(records).astype(np.float32),
        margin_m=(records["margin_mm"] / 1000.0).astype(np.float32), flags=records["flags"].astype(np.uint8),
        hits=records["hits"].astype(np.int32), seen_ns=t_ns - records["age_s"].astype(np.int64) * 1_000_000_000,
        blocks=blocks, masks=masks,
    )  # fmt: skip
