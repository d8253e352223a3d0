"""Union-find: the root of an element in a forest of parents."""

from __future__ import annotations

from .jit import inner


@inner
def root_of(parent, k):
    """Returns the root of element k, and halves the path. parent: (N,) int; a root is its own parent."""
    for _ in range(parent.shape[0]):
        if parent[k] == k:
            break
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k
