"""Tables as bytes, in the encoding of Protocol Buffers; the numbers of the fields are the caller's.

To make an object of each prism and let the library write it takes eight times as long, as much as to find them all. A
field that is nothing is written here, too, which the library leaves out: it reads the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernels import inner
from .prism_table import PrismTable

_HEAD_BYTES = 64
"""At most, of a prism but for its vertices and planes: keys, lengths and numbers."""
_FIXED = 20
"""Bytes of its keys and of the numbers that take the same always."""
_CLUSTER, _TOP, _BOTTOM, _CLOSED, _MARGIN, _VERTICES, _PLANE = range(7)
"""Places in the keys of a prism's fields, and in their numbers."""
_WRITTEN = (0, 5, 5, 0, 5, 2, 2)
"""How each is written: 0 a whole number, 2 so many bytes, 5 a float32. With eight times the field's number it is its key."""


def packed_bytes(field: int, content: bytes) -> bytes:
    """Bytes, or a message of these bytes. field: its number in the message around it, 1 to 15."""
    head, left = bytearray((field * 8 + 2,)), len(content)
    while left > 127:
        head.append(left & 127 | 128)
        left >>= 7
    head.append(left)
    return bytes(head) + content


def packed_floats(field: int, values: NDArray[np.float32]) -> bytes:
    """A repeated float, by rows. field: its number in the message, 1 to 15."""
    return packed_bytes(field, values.astype("<f4", copy=False).tobytes())


def packed_whole(
    fields: tuple[int, int, int], support_px: NDArray[np.int32], flags: NDArray[np.uint8], cluster: NDArray[np.int32]
) -> bytes:
    """Three repeated whole numbers, those of planes, (N,) each. fields: their numbers in the message, 1 to 15."""
    keys = np.array(fields, np.uint8) * np.uint8(8) + np.uint8(2)
    out = np.empty(3 * _HEAD_BYTES + 12 * len(cluster), np.uint8)
    size = _write_whole(keys, support_px, flags, cluster, out)
    return out[:size].tobytes()


def packed_prisms(field: int, fields: tuple[int, ...], table: PrismTable) -> bytes:
    """A repeated message of prisms. field: its number; fields: those of cluster, top, bottom, closed, margin, vertices and
    planes in such a message. All are 1 to 15."""
    keys = np.array([8 * number + written for number, written in zip(fields, _WRITTEN, strict=True)], np.uint8)
    room = _HEAD_BYTES * len(table) + 8 * len(table.vertices_m) + 5 * len(table.plane)
    out = np.empty(room, np.uint8)
    size = _write(
        field * 8 + 2, keys, table.cluster, table.heights_m.view(np.uint32), table.closed, table.margin_m.view(np.uint32),
        table.vertex_begin, table.edge_begin, table.vertices_m.view(np.uint32), table.plane, out,
    )  # fmt: skip
    return out[:size].tobytes()


@inner
def _write(key, keys, cluster, heights, closed, margin, vertex_begin, edge_begin, vertices, plane, out):
    """Floats as their bits. The number of bytes."""
    at = 0
    for k in range(cluster.shape[0]):
        packed = 0
        for e in range(edge_begin[k], edge_begin[k + 1]):
            packed += _length(_unsigned(plane[e]))
        corners = 8 * (vertex_begin[k + 1] - vertex_begin[k])
        inside = _FIXED + _length(_unsigned(cluster[k])) + _length(corners) + corners + _length(packed) + packed
        out[at] = key
        at = _whole(out, at + 1, inside)
        out[at] = keys[_CLUSTER]
        at = _whole(out, at + 1, _unsigned(cluster[k]))
        out[at] = keys[_TOP]
        at = _float(out, at + 1, heights[k, 0])
        out[at] = keys[_BOTTOM]
        at = _float(out, at + 1, heights[k, 1])
        out[at], out[at + 1], out[at + 2] = keys[_CLOSED], closed[k], keys[_MARGIN]
        at = _float(out, at + 3, margin[k])
        out[at] = keys[_VERTICES]
        at = _whole(out, at + 1, corners)
        for v in range(vertex_begin[k], vertex_begin[k + 1]):
            at = _float(out, at, vertices[v, 0])
            at = _float(out, at, vertices[v, 1])
        out[at] = keys[_PLANE]
        at = _whole(out, at + 1, packed)
        for e in range(edge_begin[k], edge_begin[k + 1]):
            at = _whole(out, at, _unsigned(plane[e]))
    return at


@inner
def _write_whole(keys, support_px, flags, cluster, out):
    """Each in turn. The number of bytes."""
    n = cluster.shape[0]
    sizes = (0, 0, 0)
    for k in range(n):
        sizes = (
            sizes[0] + _length(_unsigned(support_px[k])),
            sizes[1] + _length(_unsigned(flags[k])),
            sizes[2] + _length(_unsigned(cluster[k])),
        )
    out[0] = keys[0]
    at = _whole(out, 1, sizes[0])
    for k in range(n):
        at = _whole(out, at, _unsigned(support_px[k]))
    out[at] = keys[1]
    at = _whole(out, at + 1, sizes[1])
    for k in range(n):
        at = _whole(out, at, _unsigned(flags[k]))
    out[at] = keys[2]
    at = _whole(out, at + 1, sizes[2])
    for k in range(n):
        at = _whole(out, at, _unsigned(cluster[k]))
    return at


@inner
def _unsigned(value):
    """An int32's bits: a reader takes no more of one below zero."""
    return np.int64(value) & 0xFFFFFFFF


@inner
def _length(value):
    """How many bytes a whole number takes."""
    count = 1
    while value > 127:
        value >>= 7
        count += 1
    return count


@inner
def _whole(out, at, value):
    """A whole number, seven bits a byte, the lowest first, at a place; the place behind it."""
    while value > 127:
        out[at] = value & 127 | 128
        value >>= 7
        at += 1
    out[at] = value
    return at + 1


@inner
def _float(out, at, bits):
    for b in range(4):
        out[at + b] = (bits >> (8 * b)) & 255
    return at + 4
