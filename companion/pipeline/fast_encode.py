"""Encodes the model of a frame in the Protocol Buffers wire format; the caller gives the field numbers.

Building a Python object per prism and encoding it with the library takes eight times as long, which is as long as the
extraction of all prisms. Zero-valued fields, which the library omits, are written here; the decoded message is the
same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.jit import inner
from core.stages.prism_table import NO_PRISMS, prism_table
from core.types import FrameModel

# indices into `fields`: of the enclosing message, of planes, of a prism, of the free ranges
(
    PLANES, PRISMS, FREE,
    CORNERS, PLANE_MARGIN, SUPPORT, FLAGS, PLANE_CLUSTER,
    CLUSTER, TOP, BOTTOM, CLOSED, MARGIN, VERTICES, EDGES,
    AZIMUTHS, LAYERS, FREE_FROM, FREE_TO, END,
) = range(20)  # fmt: skip
_VARINT, _BYTES, _FLOAT = 0, 2, 5
"""Wire types: a field's key is 8 * number + wire type."""
_HEAD_BYTES = 64
"""Upper bound of the bytes of a prism without its vertices and planes, and of the rest of a model: keys, lengths,
numbers."""
_FIXED = 20
"""Bytes of a prism's keys and of its fields of fixed size."""
_MAX_VARINT_BYTES = 5
"""Largest size of an encoded 32-bit integer."""


def encode_model(fields: NDArray[np.uint8], model: FrameModel) -> bytes:
    """Encodes planes, prisms and free ranges. fields: (20,) uint8, the field numbers by the indices above, each 1 to
    15."""
    table, free = prism_table(model.prisms) if len(model.prisms) else NO_PRISMS, model.free
    planes, ranges = len(model.planes), free.free_from_m.size
    floats = 7 * planes + len(free.azimuth_edges_rad) + len(free.layer_edges_m) + 2 * ranges
    prisms = _HEAD_BYTES * len(table) + 8 * len(table.vertices_m) + _MAX_VARINT_BYTES * len(table.plane)
    out = np.empty(4 * _HEAD_BYTES + 4 * floats + 3 * _MAX_VARINT_BYTES * planes + ranges + prisms, np.uint8)
    size = write_model(
        fields, model.planes, model.margin_m, model.support_px, model.flags, model.cluster, table.cluster, table.heights_m,
        table.closed, table.margin_m, table.vertex_begin, table.edge_begin, table.vertices_m, table.plane,
        free.azimuth_edges_rad, free.layer_edges_m, free.free_from_m, free.free_to_m, free.end, out,
    )  # fmt: skip
    return out[:size].tobytes()


@inner
def write_model(
    fields, planes, plane_margin, support_px, flags, plane_cluster, cluster, heights, closed, margin, vertex_begin, edge_begin,
    vertices, plane, azimuths, layers, free_from, free_to, end, out,
):  # fmt: skip
    """The kernel of `encode_model`: writes to `out` and returns the number of bytes."""
    at = _write_planes(fields, planes, plane_margin, support_px, flags, plane_cluster, out)
    at = _write_prisms(fields, cluster, heights, closed, margin, vertex_begin, edge_begin, vertices, plane, out, at)
    return _write_free(fields, azimuths, layers, free_from, free_to, end, out, at)


@inner
def _write_planes(fields, planes, margin, support_px, flags, cluster, out):
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
    at = _tag_and_length(out, 0, fields[PLANES], inside)
    at = _tag_and_length(out, at, fields[CORNERS], 24 * n)
    for k in range(n):
        at = _floats(out, at, planes[k])
    at = _floats(out, _tag_and_length(out, at, fields[PLANE_MARGIN], 4 * n), margin)
    at = _tag_and_length(out, at, fields[SUPPORT], sizes[0])
    for k in range(n):
        at = _varint(out, at, _unsigned(support_px[k]))
    at = _tag_and_length(out, at, fields[FLAGS], sizes[1])
    for k in range(n):
        at = _varint(out, at, _unsigned(flags[k]))
    at = _tag_and_length(out, at, fields[PLANE_CLUSTER], sizes[2])
    for k in range(n):
        at = _varint(out, at, _unsigned(cluster[k]))
    return at


@inner
def _write_prisms(fields, cluster, heights, closed, margin, vertex_begin, edge_begin, vertices, plane, out, at):
    for k in range(cluster.shape[0]):
        packed = 0
        for e in range(edge_begin[k], edge_begin[k + 1]):
            packed += _length(_unsigned(plane[e]))
        corners = 8 * (vertex_begin[k + 1] - vertex_begin[k])
        inside = _FIXED + _length(_unsigned(cluster[k])) + _length(corners) + corners + _length(packed) + packed
        at = _tag_and_length(out, at, fields[PRISMS], inside)
        out[at] = 8 * fields[CLUSTER] + _VARINT
        at = _varint(out, at + 1, _unsigned(cluster[k]))
        out[at] = 8 * fields[TOP] + _FLOAT
        at = _float(out, at + 1, heights[k, 0])
        out[at] = 8 * fields[BOTTOM] + _FLOAT
        at = _float(out, at + 1, heights[k, 1])
        out[at], out[at + 1] = 8 * fields[CLOSED] + _VARINT, closed[k]
        out[at + 2] = 8 * fields[MARGIN] + _FLOAT
        at = _float(out, at + 3, margin[k])
        at = _tag_and_length(out, at, fields[VERTICES], corners)
        for v in range(vertex_begin[k], vertex_begin[k + 1]):
            at = _floats(out, at, vertices[v])
        at = _tag_and_length(out, at, fields[EDGES], packed)
        for e in range(edge_begin[k], edge_begin[k + 1]):
            at = _varint(out, at, _unsigned(plane[e]))
    return at


@inner
def _write_free(fields, azimuths, layers, free_from, free_to, end, out, at):
    count = end.shape[0] * end.shape[1]
    sizes = (4 * azimuths.shape[0], 4 * layers.shape[0], 4 * count, 4 * count, count)
    inside = 5
    for size in sizes:
        inside += _length(size) + size
    at = _tag_and_length(out, at, fields[FREE], inside)
    at = _floats(out, _tag_and_length(out, at, fields[AZIMUTHS], sizes[0]), azimuths)
    at = _floats(out, _tag_and_length(out, at, fields[LAYERS], sizes[1]), layers)
    at = _tag_and_length(out, at, fields[FREE_FROM], sizes[2])
    for d in range(free_from.shape[0]):
        at = _floats(out, at, free_from[d])
    at = _tag_and_length(out, at, fields[FREE_TO], sizes[3])
    for d in range(free_to.shape[0]):
        at = _floats(out, at, free_to[d])
    at = _tag_and_length(out, at, fields[END], sizes[4])
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
