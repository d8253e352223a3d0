"""Decoding of the merged world's message (osape.v1.WorldUpdate).

Every function raises ValueError for a message whose parts do not fit together, and never takes more memory than the message
announces."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from ..proto import osape_v1_pb2 as pb
from .snapshot import WorldSnapshot

SCHEMA_VERSION = 1
NO_GROUND_CM = 65535
"""Height of a column's ground where it is unknown."""
BLOCK_HEIGHT_M = 32.0
PLANE_RECORD = np.dtype(
    [
        ("x_cm", "<i4"),
        ("y_cm", "<i4"),
        ("ends_cm", "<i2", (4,)),
        ("top_cm", "<i4"),
        ("height_cm", "<u2"),
        ("margin_mm", "<u2"),
        ("flags", "u1"),
        ("hits", "<u2"),
        ("age_s", "<u4"),
        ("slot", "<u4"),
    ]
)
"""One plane: the middle of its two ends, the ends a_x, a_y, b_x, b_y relative to it, z of the upper edge and the height."""
MOST_BLOCKS = 1 << 18
"""Largest number of blocks of a message, that of the largest world that can be configured: 0.9 GB. Their compressed masks could
announce any amount of memory."""
_MASK_BYTES, _GROUND_BYTES = 256 * 8, 256 * 4


def records_from_message(message: pb.WorldUpdate) -> NDArray[np.void]:
    """(N,) PLANE_RECORD: the planes of a message."""
    if len(message.planes) % PLANE_RECORD.itemsize:
        raise ValueError(f"planes of {len(message.planes)} bytes, expected a multiple of {PLANE_RECORD.itemsize}")
    return np.frombuffer(message.planes, PLANE_RECORD)


def planes_from_records(records: NDArray[np.void]) -> NDArray[np.float64]:
    """(N, 6) a_x, a_y, b_x, b_y, top, bottom in metres."""
    x, y = records["x_cm"].astype(np.float64), records["y_cm"].astype(np.float64)
    top = records["top_cm"].astype(np.float64)
    ends = records["ends_cm"] + np.column_stack([x, y, x, y])
    return np.column_stack([ends, top, top + records["height_cm"]]) / 100.0


def blocks_from_message(message: pb.WorldUpdate) -> tuple[NDArray[np.int32], NDArray[np.uint64]]:
    """(indices (B, 3), masks (B, 256)) of a message's blocks of free space."""
    blocks = _indices(message)
    raw = _decompressed(message.masks, len(blocks) * _MASK_BYTES, "masks")
    return blocks, np.frombuffer(raw, "<u8").astype(np.uint64).reshape(-1, 256)


def _indices(message: pb.WorldUpdate) -> NDArray[np.int32]:
    """(B, 3) of a message's blocks."""
    count, rest = divmod(len(message.blocks), 3)
    if rest:
        raise ValueError(f"{len(message.blocks)} indices of blocks, expected a multiple of 3")
    if count > MOST_BLOCKS:
        raise ValueError(f"{count} blocks, expected at most {MOST_BLOCKS}")
    return np.array(message.blocks, np.int32).reshape(-1, 3)


def ground_from_message(message: pb.WorldUpdate) -> NDArray[np.float32]:
    """(B, 256, 2) z and noise of the ground in the columns of a message's blocks, as in a WorldSnapshot; nan where it is
    unknown."""
    block_z = _indices(message)[:, 2].astype(np.float64)
    out = np.full((len(block_z), 256, 2), np.nan)
    if message.ground:
        raw = _decompressed(message.ground, len(out) * _GROUND_BYTES, "ground")
        wire = np.frombuffer(raw, "<u2").reshape(out.shape)
        known = wire[:, :, 0] != NO_GROUND_CM
        out[known] = (wire / 100.0)[known]
        out[:, :, 0] += BLOCK_HEIGHT_M * block_z[:, None]
    return out.astype(np.float32)


def snapshot_from_parts(
    section: int,
    records: NDArray[np.void],
    blocks: NDArray[np.int32],
    masks: NDArray[np.uint64],
    ground: NDArray[np.float32],
    t_ns: int,
) -> WorldSnapshot:
    """The snapshot of planes and blocks collected from messages. t_ns: the time that the planes' ages refer to."""
    return WorldSnapshot(
        section=section,
        slots=records["slot"].astype(np.int32),
        planes=planes_from_records(records).astype(np.float32),
        margin_m=(records["margin_mm"] / 1000.0).astype(np.float32),
        flags=records["flags"].astype(np.uint8),
        hits=records["hits"].astype(np.int32),
        seen_ns=t_ns - records["age_s"].astype(np.int64) * 1_000_000_000,
        blocks=blocks,
        masks=masks,
        ground=ground,
    )


def _decompressed(compressed: bytes, size: int, name: str) -> bytes:
    """Exactly `size` bytes."""
    decompressor = zlib.decompressobj()
    try:
        raw = decompressor.decompress(compressed, size + 1) if compressed else b""
    except zlib.error as error:
        raise ValueError(f"{name} of {len(compressed)} bytes cannot be decompressed ({error})") from error
    if len(raw) != size:
        raise ValueError(f"{name} of {len(raw)} bytes or more, expected {size}")
    if compressed and (not decompressor.eof or decompressor.unused_data):
        raise ValueError(f"{name}: the compressed bytes end early or too late; is the message damaged?")
    return raw
