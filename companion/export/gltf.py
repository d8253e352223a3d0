"""The prisms of one frame, and the trajectory, as binary glTF 2.0 (.glb), which Blender and most viewers open.

glTF has y up and metres: north, east, down become -z, x, -y, so that north is away from the viewer."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.types import Prism

from ..log.foxglove_scene import prism_edges

_TRIANGLES, _LINE_STRIP = 4, 3
_FLOAT, _UINT = 5126, 5125
_ARRAY, _INDICES = 34962, 34963
_GLB: Final = 0x46546C67
_JSON, _BIN = 0x4E4F534A, 0x004E4942
OBSTACLE_RGBA: Final = [0.9, 0.45, 0.2, 1.0]
PATH_RGBA: Final = [1.0, 0.84, 0.31, 1.0]

Floats = NDArray[np.float32]


def glb(prisms: Sequence[Prism], trajectory_m: NDArray[np.float64], name: str) -> bytes:
    """The file. prisms: in ned; trajectory_m: (N, 3) in ned, drawn from two points on; name: of the frame."""
    made = _Buffer()
    meshes: list[dict[str, Any]] = []
    corners = _faces(prisms)
    if len(corners):
        indices = (4 * np.arange(len(corners) // 4, dtype=np.uint32)[:, None] + [0, 1, 2, 0, 2, 3]).astype(np.uint32)
        primitive = {
            "attributes": {"POSITION": made.add(corners, _ARRAY)},
            "indices": made.add(indices.ravel(), _INDICES),
            "mode": _TRIANGLES,
            "material": 0,
        }
        meshes.append({"name": f"obstacles of {name}", "primitives": [primitive]})
    if len(trajectory_m) > 1:
        line = {"attributes": {"POSITION": made.add(to_gltf(trajectory_m), _ARRAY)}, "mode": _LINE_STRIP, "material": 1}
        meshes.append({"name": "trajectory", "primitives": [line]})
    nodes = [{"name": mesh["name"], "mesh": k} for k, mesh in enumerate(meshes)]
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "osape-companion"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))} if nodes else {"name": "empty"}],
        "materials": [_material("obstacles", OBSTACLE_RGBA), _material("trajectory", PATH_RGBA)],
    }
    if nodes:
        content |= {"nodes": nodes, "meshes": meshes, **made.described()}
    return _packed(content, bytes(made.data))


def to_gltf(ned_m: NDArray[np.floating]) -> Floats:
    """(N, 3) points of ned in glTF's axes."""
    north, east, down = ned_m.T
    return np.stack([east, -down, -north], axis=1).astype(np.float32)


def _faces(prisms: Sequence[Prism]) -> Floats:
    """(4 N, 3) corners of the N edges of all prisms: a-top, b-top, b-bottom, a-bottom."""
    corners = [
        (*xy, z)
        for prism in prisms
        for a, b in prism_edges(prism)
        for xy, z in ((a, prism.top_m), (b, prism.top_m), (b, prism.bottom_m), (a, prism.bottom_m))
    ]
    return to_gltf(np.array(corners, np.float64).reshape(-1, 3))


def _material(name: str, rgba: list[float]) -> dict[str, Any]:
    surface = {"baseColorFactor": rgba, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    return {"name": name, "doubleSided": True, "pbrMetallicRoughness": surface}


class _Buffer:
    """The binary part with its views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add(self, values: NDArray[Any], target: int) -> int:
        """Appends float32 positions (N, 3) or uint32 indices (N,); returns the accessor's number."""
        is_position = values.ndim == 2
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes, "target": target}
        accessor: dict[str, Any] = {
            "bufferView": len(self._views),
            "componentType": _FLOAT if is_position else _UINT,
            "count": len(values),
            "type": "VEC3" if is_position else "SCALAR",
        }
        if is_position:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self._views.append(view)
        self._accessors.append(accessor)
        self.data += np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        return len(self._accessors) - 1

    def described(self) -> dict[str, Any]:
        """The JSON of the buffer."""
        return {"buffers": [{"byteLength": len(self.data)}], "bufferViews": self._views, "accessors": self._accessors}


def _packed(content: dict[str, Any], data: bytes) -> bytes:
    """Header and chunks; each chunk is padded to four bytes."""
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text
    if data:
        chunks += struct.pack("<II", len(data), _BIN) + data
    return struct.pack("<III", _GLB, 2, 12 + len(chunks)) + chunks
