"""Encodes the model of a frame in the Protocol Buffers wire format; the caller gives the field numbers.

Building a Python object per prism and encoding it with the library takes eight times as long, which is as long as the
extraction of all prisms. Zero-valued fields, which the library omits, are written here; the decoded message is the
same."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import inner, record
from core.stages.prism_table import NO_PRISMS, PrismTable, prism_table
from core.types import FrameModel, FreeProfile

FIELD_NUMBERS = record(
    ("planes", np.uint8),
    ("prisms", np.uint8),
    ("free", np.uint8),
    ("plane_corners", np.uint8),
    ("plane_margin", np.uint8),
    ("plane_support", np.uint8),
    ("plane_flags", np.uint8),
    ("plane_cluster", np.uint8),
    ("prism_cluster", np.uint8),
    ("prism_top", np.uint8),
    ("prism_bottom", np.uint8),
    ("prism_closed", np.uint8),
    ("prism_margin", np.uint8),
    ("prism_vertices", np.uint8),
    ("prism_planes", np.uint8),
    ("free_azimuths", np.uint8),
    ("free_layers", np.uint8),
    ("free_from", np.uint8),
    ("free_to", np.uint8),
    ("free_end", np.uint8),
)
"""Field numbers, each 1 to 15: of the enclosing message, of planes, of a prism, of the free ranges."""
_VARINT, _BYTES, _FLOAT = 0, 2, 5
"""Wire types: a field's key is 8 * number + wire type."""
_HEAD_BYTES = 64
"""Upper bound of the bytes of a prism without its vertices and planes, and of the rest of a model: keys, lengths,
numbers."""
_FIXED = 20
"""Bytes of a prism's keys and of its fields of fixed size."""
_MAX_VARINT_BYTES = 5
"""Largest size of an encoded 32-bit integer."""


class PlaneArrays(NamedTuple):
    """The planes of a FrameModel: the arrays of these names."""

    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    support_px: NDArray[np.int32]
    flags: NDArray[np.uint8]
    cluster: NDArray[np.int32]


class PrismArrays(NamedTuple):
    """The arrays of a PrismTable."""

    cluster: NDArray[np.int32]
    heights_m: NDArray[np.float32]
    closed: NDArray[np.bool_]
    margin_m: NDArray[np.float32]
    vertex_begin: NDArray[np.int32]
    edge_begin: NDArray[np.int32]
    vertices_m: NDArray[np.float32]
    plane: NDArray[np.int32]


class FreeArrays(NamedTuple):
    """The arrays of a FreeProfile."""

    azimuth_edges_rad: NDArray[np.float32]
    layer_edges_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]
    end: NDArray[np.uint8]


def encode_model(fields: NDArray[np.uint8], model: FrameModel) -> bytes:
    """Encodes planes, prisms and free ranges. fields: (20,) uint8, the field numbers in the order of FIELD_NUMBERS."""
    table, free = prism_table(model.prisms) if len(model.prisms) else NO_PRISMS, model.free
    planes, ranges = len(model.planes), free.free_from_m.size
    floats = 7 * planes + len(free.azimuth_edges_rad) + len(free.layer_edges_m) + 2 * ranges
    prisms = _HEAD_BYTES * len(table) + 8 * len(table.vertices_m) + _MAX_VARINT_BYTES * len(table.plane)
    out = np.empty(4 * _HEAD_BYTES + 4 * floats + 3 * _MAX_VARINT_BYTES * planes + ranges + prisms, np.uint8)
    size = write_model(fields.view(FIELD_NUMBERS), _plane_arrays(model), _prism_arrays(table), _free_arrays(free), out)
    return out[:size].tobytes()


def _plane_arrays(m: FrameModel) -> PlaneArrays:
    return PlaneArrays(m.planes, m.margin_m, m.support_px, m.flags, m.cluster)


def _prism_arrays(t: PrismTable) -> PrismArrays:
    return PrismArrays(
        t.cluster, t.heights_m, t.closed, t.margin_m, t.vertex_begin, t.edge_begin, t.vertices_m, t.plane
    )


def _free_arrays(f: FreeProfile) -> FreeArrays:
    return FreeArrays(f.azimuth_edges_rad, f.layer_edges_m, f.free_from_m, f.free_to_m, f.end)


@inner
def write_model(fields, planes, prisms, free, out):
    """The kernel of `encode_model`: writes PlaneArrays, PrismArrays and FreeArrays to `out`, returns the number of bytes."""
    numbers = fields[0]
    at = _write_planes(numbers, planes, out)
    at = _write_prisms(numbers, prisms, out, at)
    return _write_free(numbers, free, out, at)


@inner
def _write_planes(numbers, arrays, out):
    planes, support_px, flags, cluster = arrays.planes, arrays.support_px, arrays.flags, arrays.cluster
    n = planes.shape[0]
    sizes = (0, 0, 0)
    for k in range(n):
        sizes = (
            sizes[0] + _length(_unsigned(support_px[k])),
            sizes[1] + _length(_unsigned(flags[k])),
            sizes[2] + _length(_unsigned(cluster[k])),
        )
    inside = 5
    for size in (24 * n, 4 * n, sizes[0], sizes[1], sizes[2]):
        inside += _length(size) + size
    at = _tag_and_length(out, 0, numbers.planes, inside)
    at = _tag_and_length(out, at, numbers.plane_corners, 24 * n)
    for k in range(n):
        at = _floats(out, at, planes[k])
    at = _floats(out, _tag_and_length(out, at, numbers.plane_margin, 4 * n), arrays.margin_m)
    at = _tag_and_length(out, at, numbers.plane_support, sizes[0])
    for k in range(n):
        at = _varint(out, at, _unsigned(support_px[k]))
    at = _tag_and_length(out, at, numbers.plane_flags, sizes[1])
    for k in range(n):
        at = _varint(out, at, _unsigned(flags[k]))
    at = _tag_and_length(out, at, numbers.plane_cluster, sizes[2])
    for k in range(n):
        at = _varint(out, at, _unsigned(cluster[k]))
    return at


@inner
def _write_prisms(numbers, prisms, out, at):
    cluster, heights, vertices, plane = prisms.cluster, prisms.heights_m, prisms.vertices_m, prisms.plane
    vertex_begin, edge_begin = prisms.vertex_begin, prisms.edge_begin
    for k in range(cluster.shape[0]):
        packed = 0
        for e in range(edge_begin[k], edge_begin[k + 1]):
            packed += _length(_unsigned(plane[e]))
        corners = 8 * (vertex_begin[k + 1] - vertex_begin[k])
        inside = _FIXED + _length(_unsigned(cluster[k])) + _length(corners) + corners + _length(packed) + packed
        at = _tag_and_length(out, at, numbers.prisms, inside)
        out[at] = 8 * numbers.prism_cluster + _VARINT
        at = _varint(out, at + 1, _unsigned(cluster[k]))
        out[at] = 8 * numbers.prism_top + _FLOAT
        at = _float(out, at + 1, heights[k, 0])
        out[at] = 8 * numbers.prism_bottom + _FLOAT
        at = _float(out, at + 1, heights[k, 1])
        out[at], out[at + 1] = 8 * numbers.prism_closed + _VARINT, prisms.closed[k]
        out[at + 2] = 8 * numbers.prism_margin + _FLOAT
        at = _float(out, at + 3, prisms.margin_m[k])
        at = _tag_and_length(out, at, numbers.prism_vertices, corners)
        for v in range(vertex_begin[k], vertex_begin[k + 1]):
            at = _floats(out, at, vertices[v])
        at = _tag_and_length(out, at, numbers.prism_planes, packed)
        for e in range(edge_begin[k], edge_begin[k + 1]):
            at = _varint(out, at, _unsigned(plane[e]))
    return at


@inner
def _write_free(numbers, free, out, at):
    azimuths, layers, end = free.azimuth_edges_rad, free.layer_edges_m, free.end
    free_from, free_to = free.free_from_m, free.free_to_m
    count = end.shape[0] * end.shape[1]
    sizes = (4 * azimuths.shape[0], 4 * layers.shape[0], 4 * count, 4 * count, count)
    inside = 5
    for size in sizes:
        inside += _length(size) + size
    at = _tag_and_length(out, at, numbers.free, inside)
    at = _floats(out, _tag_and_length(out, at, numbers.free_azimuths, sizes[0]), azimuths)
    at = _floats(out, _tag_and_length(out, at, numbers.free_layers, sizes[1]), layers)
    at = _tag_and_length(out, at, numbers.free_from, sizes[2])
    for d in range(free_from.shape[0]):
        at = _floats(out, at, free_from[d])
    at = _tag_and_length(out, at, numbers.free_to, sizes[3])
    for d in range(free_to.shape[0]):
        at = _floats(out, at, free_to[d])
    at = _tag_and_length(out, at, numbers.free_end, sizes[4])
    for d in range(end.shape[0]):
        for layer in range(end.shape[1]):
            out[at] = end[d, layer]
            at += 1
    return at


@inner
def _tag_and_length(out, at, field, size):
    """Writes key and length of a field of `size` bytes at `at`; returns the next index."""
    out[at] = 8 * field + _BYTES
    return _varint(out, at + 1, size)


@inner
def _unsigned(value):
    """The bits of an int32 as an unsigned number."""
    return np.int64(value) & 0xFFFFFFFF


@inner
def _length(value):
    """Size of an encoded integer, bytes."""
    count = 1
    while value > 127:
        value >>= 7
        count += 1
    return count


@inner
def _varint(out, at, value):
    """Writes a varint at `at`, seven bits per byte, lowest first; returns the next index."""
    while value > 127:
        out[at] = value & 127 | 128
        value >>= 7
        at += 1
    out[at] = value
    return at + 1


@inner
def _floats(out, at, values):
    """Writes float32 values in sequence."""
    for value in values:
        at = _float(out, at, value)
    return at


@inner
def _float(out, at, value):
    bits = np.float32(value).view(np.uint32)
    for b in range(4):
        out[at + b] = (bits >> (8 * b)) & 255
    return at + 4
