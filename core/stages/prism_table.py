"""All prisms of a frame as tables. A `Prism` is made on access.

A frame has 50 to 80 prisms, and creating an object of each takes longer than finding them. Transforms, counts and
encoders use the tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from ..types import Prism, store_readonly


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PrismTable(Sequence[Prism]):
    """A read-only sequence of prisms; see `Prism` for the meaning of the fields.

    Raises:
        ValueError: a table has the wrong type or size, or a prism's top is not above its bottom."""

    cluster: NDArray[np.int32]  # (N,)
    heights_m: NDArray[np.float32]  # (N, 2), top and bottom, z down
    closed: NDArray[np.bool_]  # (N,)
    margin_m: NDArray[np.float32]  # (N,)
    vertex_begin: NDArray[np.int32]  # (N + 1,), first vertex of each prism, and the end
    edge_begin: NDArray[np.int32]  # (N + 1,), first edge of each prism, and the end
    vertices_m: NDArray[np.float32]  # (V, 2)
    plane: NDArray[np.int32]  # (E,), plane of each edge

    def __post_init__(self) -> None:
        n = len(self.cluster)
        store_readonly(self, np.int32, (n,), "cluster")
        store_readonly(self, np.float32, (n, 2), "heights_m")
        store_readonly(self, np.bool_, (n,), "closed")
        store_readonly(self, np.float32, (n,), "margin_m")
        store_readonly(self, np.int32, (n + 1,), "vertex_begin", "edge_begin")
        store_readonly(self, np.float32, (int(self.vertex_begin[-1]), 2), "vertices_m")
        store_readonly(self, np.int32, (int(self.edge_begin[-1]),), "plane")
        if not (self.heights_m[:, 0] < self.heights_m[:, 1]).all():
            raise ValueError("prisms: top must be less than bottom (z is down)")

    def __len__(self) -> int:
        return len(self.cluster)

    @overload
    def __getitem__(self, key: int) -> Prism: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Prism, ...]: ...
    def __getitem__(self, key: int | slice) -> Prism | tuple[Prism, ...]:
        if isinstance(key, slice):
            return tuple(self[k] for k in range(*key.indices(len(self))))
        n = len(self)
        if not -n <= key < n:
            raise IndexError(f"prism {key} of {n}")
        k = key % n
        top, bottom = self.heights_m[k].tolist()
        return Prism(
            cluster=int(self.cluster[k]),
            top_m=top,
            bottom_m=bottom,
            closed=bool(self.closed[k]),
            margin_m=float(self.margin_m[k]),
            vertices_m=self.vertices_m[self.vertex_begin[k] : self.vertex_begin[k + 1]],
            plane=self.plane[self.edge_begin[k] : self.edge_begin[k + 1]],
        )


def prism_table(prisms: Iterable[Prism]) -> PrismTable:
    """Returns the table of these prisms; a `PrismTable` itself."""
    if isinstance(prisms, PrismTable):
        return prisms
    every = tuple(prisms)
    vertices = [np.zeros((0, 2), np.float32), *(prism.vertices_m for prism in every)]
    edges = [np.zeros(0, np.int32), *(prism.plane for prism in every)]
    return PrismTable(
        cluster=np.array([prism.cluster for prism in every], np.int32),
        heights_m=np.array([(prism.top_m, prism.bottom_m) for prism in every], np.float32).reshape(-1, 2),
        closed=np.array([prism.closed for prism in every], np.bool_),
        margin_m=np.array([prism.margin_m for prism in every], np.float32),
        vertex_begin=np.cumsum([len(part) for part in vertices], dtype=np.int32),
        edge_begin=np.cumsum([len(part) for part in edges], dtype=np.int32),
        vertices_m=np.concatenate(vertices),
        plane=np.concatenate(edges),
    )


NO_PRISMS = prism_table(())
"""The table of a frame without prisms."""
