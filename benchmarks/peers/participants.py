"""The available methods, and why others are missing."""

from __future__ import annotations

from benchmarks.peers import octomap as peer_octomap
from benchmarks.peers import open3d_patches as peer_open3d
from benchmarks.peers.grid_prisms import CELLS_M
from benchmarks.peers.methods import Grid, Ours, Peer

SAFE, PAPER = "OSAPE, safe", "OSAPE, paper"
ROUGH = CELLS_M[-1]
"""Cell size of the grid that storage is compared with."""


def contestants() -> tuple[list[Peer], list[tuple[str, str]]]:
    """All that can run here, ours first, and (name, why not) of those that cannot."""
    grids = [*(Grid(cell) for cell in CELLS_M), Grid(ROUGH, simplified=False), Grid(ROUGH, sorted_pixels=False)]
    found: list[Peer] = [Ours("safe"), Ours("paper"), *grids]
    absent: list[tuple[str, str]] = []
    for name, peers in ((peer_octomap.NAME, peer_octomap.peers()), (peer_open3d.NAME, peer_open3d.peers())):
        if isinstance(peers, str):
            absent.append((name, peers))
        else:
            found.extend(peers)
    return found, absent
