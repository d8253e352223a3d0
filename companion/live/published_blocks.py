"""Blocks of free space in the copies of subscribers.

The changes of the merged world contain the blocks that it holds. A block that another one has replaced would stay in
each copy, with its free cells, until the next snapshot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from core.world.snapshot import WorldSnapshot
from core.world.world import World


class PublishedBlocks:
    """Indices of all blocks that have been published since the last snapshot of the stream."""

    def __init__(self) -> None:
        self._published: set[tuple[int, ...]] = set()
        self._dropped = 0

    def snapshot(self, picture: WorldSnapshot, world: World) -> None:
        """Records a snapshot of the stream, which replaces the copies."""
        self._published = set(map(tuple, picture.blocks.tolist()))
        self._dropped = world.free_blocks_dropped

    def add(self, picture: WorldSnapshot) -> None:
        """Records a snapshot that one subscriber has requested."""
        self._published.update(map(tuple, picture.blocks.tolist()))

    def changes(self, picture: WorldSnapshot, world: World) -> WorldSnapshot:
        """Records changes of the stream. Returns them with an empty block for each published one that the world no longer
        holds."""
        self.add(picture)
        if world.free_blocks_dropped == self._dropped:
            return picture
        self._dropped = world.free_blocks_dropped
        gone = self._published.difference(map(tuple, world.free_blocks.tolist()))
        self._published -= gone
        return with_empty_blocks(picture, np.array(sorted(gone), np.int32).reshape(-1, 3))


def with_empty_blocks(picture: WorldSnapshot, blocks: np.ndarray[tuple[int, int], np.dtype[np.int32]]) -> WorldSnapshot:
    """Returns a picture with further blocks, (B, 3), in which nothing is known."""
    masks = np.zeros((len(blocks), picture.masks.shape[1]), np.uint64)
    ground = None
    if picture.ground is not None:
        unknown = np.full((len(blocks), *picture.ground.shape[1:]), np.nan, np.float32)
        ground = np.concatenate([picture.ground, unknown])
    return replace(
        picture,
        blocks=np.concatenate([picture.blocks, blocks]),
        masks=np.concatenate([picture.masks, masks]),
        ground=ground,
    )
