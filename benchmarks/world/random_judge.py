"""Random flights with faults through random scenes: whether the merged world calls free what is solid, or loses obstacles.

    python -m benchmarks.world.random_judge --seeds 0:50
    python -m benchmarks.world.random_judge --seeds 0:50 --vehicles

Faults: jumps of heading and position, drift, gaps of frames, invalid frames, masks, noise and bias of the depth, positions
that are repeated while the vehicle moves, late frames of a second camera; obstacles that move, appear and disappear. The
judge uses the true scene and the pose that each frame was delivered with, in the order of the exposures:

- A free cell is wrong where no frame of its section and of the last `free_age_s` can have had it in view with nothing in
  front ("unseen"), or where a later frame observed the solid that it is in ("solid"). Allowed: max(0.3 m, 3 sigma).
- A section is wrong that begins without a jump or a gap ("section").
- An observed place is lost where no plane is near although fewer than five later frames looked through it.

Not judged: what arrives with sides in view only where nothing was free before, which docs/explanation/merged-world.md names."""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.client_queries import world_space
from core.world.evidence import CLEAR_LIMIT
from core.world.free_grid import CELL_M, SIDE, TALL
from core.world.params import WorldParams
from core.world.snapshot import WorldSnapshot
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace

from .random_flights import FAULT_SHARE, FAULTS, LATE_FAULTS, LATE_SHARE, NS, Flight, Seen
from .random_scene import KE_PER_M, LAYERS_M, RANGE_M, VIEW_RAD, Box, Floats, Mask, random_boxes, turn, vehicles

FREE_AGES_S = (4.0, 12.0, 12.0)
"""`free_age_s`, by seed."""
_SLACK_M, _SIGMAS, _BESIDE = 0.3, 3.0, 4
"""_BESIDE: rays to each side, a degree, within which a place may have been in view."""
_LOST_M = 0.5
"""Farthest plane that still stands for an observed place, without noise and margin."""
_GAP_NS = 5 * NS
_OFTEN = 7
_MOST_CELLS, _MOST_PLACES = 2000, 1500
"""Cells and places that are judged at one time."""


@dataclass(slots=True, eq=False)
class Places:
    """Observed places of sides, in the frame of the world."""

    at_m: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    range_m: Floats = field(default_factory=lambda: np.zeros(0))
    seen_ns: Floats = field(default_factory=lambda: np.zeros(0))
    through: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(slots=True, eq=False)
class Judge:
    """Judges a world by the frames of its present section. boxes: true scene."""

    boxes: list[Box]
    free_age_s: float
    frames: list[Seen] = field(default_factory=list)
    places: Places = field(default_factory=Places)
    sections: int = 0
    cells: int = 0
    judged_places: int = 0
    wrong: list[tuple[float, str, tuple[float, ...]]] = field(default_factory=list)

    def take(self, seen: Seen, world: World, before: WorldSnapshot) -> None:
        """Notes a frame that the world received. before: the world without it."""
        if not seen.model.valid:
            return
        sections = world.counts.sections
        if self.frames:
            last, newest_ns = self.frames[-1], max(f.t_ns for f in self.frames)
            jumped = (seen.counter, seen.section) != (last.counter, last.section)
            if jumped and seen.t_ns < newest_ns:
                return  # of before the jump
            if not jumped and sections != self.sections and seen.t_ns - newest_ns <= _GAP_NS:
                self.wrong.append((seen.t_ns / NS, "section", ()))
            if jumped or sections != self.sections:
                self.frames, self.places = [], Places()
        self.sections = sections
        seen.arrived.extend(p for p in seen.observation().model.planes.astype(np.float64) if stands_in_free(p, before))
        self.frames.append(seen)
        self._note_places(seen)

    def _note_places(self, seen: Seen) -> None:
        look, p = seen.look, self.places
        on = np.arange(4, look.depth_m.shape[1] - 4, 24)
        layer, k = np.nonzero((look.depth_m[:, on] < RANGE_M - 1.0) & look.measured[on])
        k = on[k]
        r = look.depth_m[layer, k]
        azimuth = look.heading_rad + (k / (len(look.measured) - 1) - 0.5) * VIEW_RAD
        points = look.at_m + r[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        points = points @ turn(seen.psi_rad).T + seen.offset_m
        z = 0.5 * (LAYERS_M[layer] + LAYERS_M[layer + 1])
        if len(p.at_m):
            free = _in_view(seen, p.at_m, _LOST_M)
            p.through += free & (p.seen_ns < seen.t_ns)
        p.at_m = np.concatenate([p.at_m, np.column_stack([points, z])])[-_MOST_PLACES:]
        p.range_m = np.concatenate([p.range_m, r])[-_MOST_PLACES:]
        p.seen_ns = np.concatenate([p.seen_ns, np.full(len(r), float(seen.t_ns))])[-_MOST_PLACES:]
        p.through = np.concatenate([p.through, np.zeros(len(r))])[-_MOST_PLACES:]

    def check(self, world: World, now_ns: int) -> None:
        """Adds what is wrong in the world to `wrong`."""
        picture = world.picture(now_ns)
        space = world_space(picture)
        middles = free_cells(picture.blocks, picture.masks)
        middles = middles[(middles[:, 2] > LAYERS_M[0]) & (middles[:, 2] < LAYERS_M[-1])]
        middles = middles[now_ns % 7 :: 1 + len(middles) // _MOST_CELLS]
        middles = middles[space.points(middles) == Occupancy.FREE]
        free_ns, solid_ns = np.full(len(middles), -np.inf), np.full(len(middles), -np.inf)
        for seen in sorted(self.frames, key=lambda f: f.t_ns):
            if now_ns - seen.t_ns <= self.free_age_s * NS:
                free_ns[_in_view(seen, middles, -_SLACK_M)] = seen.t_ns
            solid_ns[self._inside(seen, middles)] = seen.t_ns
        self.cells += len(middles)
        for kind, bad in (("unseen", np.isinf(free_ns)), ("solid", (solid_ns > free_ns) & np.isfinite(free_ns))):
            self.wrong += [(now_ns / NS, kind, tuple(p)) for p in middles[bad].tolist()]
        self._check_places(space, now_ns)

    def _inside(self, seen: Seen, points: Floats) -> Mask:
        """(P,) whether points lie deep in a solid that a frame measured before them, where it had been free."""
        true = seen.to_true(points[:, :2])
        layer = np.searchsorted(LAYERS_M, points[:, 2]) - 1
        k, r = seen.look.index(true)
        out = np.zeros(len(points), np.bool_)
        count = seen.look.depth_m.shape[1]
        good = (k >= _BESIDE) & (k < count - _BESIDE)
        i, depth = np.full(len(points), -1), np.full(len(points), np.inf)
        i[good], depth[good] = seen.look.box[layer[good], k[good]], seen.look.depth_m[layer[good], k[good]]
        for beside in (-_BESIDE, _BESIDE):
            at = np.clip(k + beside, 0, count - 1)
            good &= (seen.look.box[layer, at] == i) & seen.look.measured[at]
        slack = _SLACK_M + _SIGMAS * KE_PER_M * np.minimum(depth, RANGE_M) ** 2
        for b in np.unique(i[good]):
            if b >= 0:
                mine = good & (i == b) & (depth < RANGE_M - 1.0)
                out |= mine & (self.boxes[b].depth(true, seen.look.t_s) > slack) & (r > depth)
        return out & _behind(seen, points)

    def _check_places(self, space: WorldSpace, now_ns: int) -> None:
        p = self.places
        kept = p.through < CLEAR_LIMIT
        if not kept.any():
            return
        self.judged_places += int(kept.sum())
        far_m = np.full(len(p.at_m), np.inf)
        far_m[kept] = space.nearest(p.at_m[kept])[0]
        lost = kept & (far_m > _LOST_M + _SIGMAS * KE_PER_M * p.range_m**2)
        self.wrong += [(now_ns / NS, "lost", tuple(q)) for q in p.at_m[lost].tolist()]


def _in_view(seen: Seen, points: Floats, behind_m: float) -> Mask:
    """(P,) whether a frame may have had points (P, 3) of the world in view, and nothing before them or less than behind_m
    behind them, and 3 sigma, in any ray beside."""
    true = seen.to_true(points[:, :2])
    layer = np.searchsorted(LAYERS_M, points[:, 2]) - 1
    k, r = seen.look.index(true)
    count = seen.look.depth_m.shape[1]
    out = np.zeros(len(points), np.bool_)
    off = behind_m + math.copysign(_SIGMAS, behind_m) * KE_PER_M * r**2
    for beside in (-_BESIDE, 0, _BESIDE):
        at = np.clip(k + beside, 0, count - 1)
        out |= (np.minimum(seen.look.depth_m[layer, at], RANGE_M + 1.0) > r + off) & seen.look.measured[at]
    return out & (k >= 0)


def _behind(seen: Seen, points: Floats) -> Mask:
    """(P,) whether the way from the camera to points (P, 3) crosses a plane that has arrived, at its heights."""
    at, out = np.array(seen.observation().place_m[:2]), np.zeros(len(points), np.bool_)
    to = points[:, :2] - at
    for p in seen.arrived:
        along, begin = p[2:4] - p[0:2], p[0:2] - at
        cross = to[:, 0] * along[1] - to[:, 1] * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            r = (begin[0] * along[1] - begin[1] * along[0]) / cross
            s = (begin[0] * to[:, 1] - begin[1] * to[:, 0]) / cross
        out |= (r > 0.0) & (r < 1.0) & (s > 0.02) & (s < 0.98) & (points[:, 2] > p[4]) & (points[:, 2] < p[5])
    return out


def stands_in_free(plane: Floats, world: WorldSnapshot) -> bool:
    """Returns whether a plane (6,) crosses a free cell."""
    share = np.linspace(0.0, 1.0, 2 + int(np.hypot(*(plane[2:4] - plane[0:2])) / 0.1))[:, None]
    xy = plane[0:2] + share * (plane[2:4] - plane[0:2])
    z = np.arange(plane[4] + 0.05, plane[5], 0.4)
    points = np.column_stack([np.repeat(xy, len(z), axis=0), np.tile(z, len(xy))])
    cells = np.floor(points / CELL_M).astype(np.int64)
    blocks = cells // [SIDE, SIDE, TALL]
    for block, mask in zip(world.blocks, world.masks, strict=True):
        x, y, bit = (cells[(blocks == block).all(axis=1)] % [SIDE, SIDE, TALL]).T
        if ((mask[x * SIDE + y] >> bit.astype(np.uint64)) & np.uint64(1)).any():
            return True
    return False


def free_cells(blocks: NDArray[np.int32], masks: NDArray[np.uint64]) -> Floats:
    """Returns (N, 3): middles of the free cells of a picture."""
    cells = [np.zeros((0, 3))]
    for (bx, by, bz), mask in zip(blocks, masks, strict=True):
        bits = np.unpackbits(mask.view(np.uint8).reshape(len(mask), 8), axis=1, bitorder="little")
        column, iz = np.nonzero(bits)
        cells.append(np.stack([bx * SIDE + (column >> 4), by * SIDE + (column & 15), bz * TALL + iz], axis=1))
    return np.asarray((np.concatenate(cells) + 0.5) * CELL_M)


def judged(seed: int, duration_s: float = 12.0, every: int = 25, among_vehicles: bool = False) -> Judge:
    """Returns the judgement of the flight of a seed. every: frames from one judgement to the next; among_vehicles: with more
    late frames."""
    rng = np.random.default_rng([17, seed])
    boxes = vehicles(rng, duration_s) if among_vehicles else random_boxes(rng, duration_s)
    boxes = [b for b in boxes if b.depth(np.zeros((1, 2)), 0.0)[0] < -2.0]
    params = WorldParams(most_planes=4096, most_free_blocks=512, free_age_s=FREE_AGES_S[seed % len(FREE_AGES_S)])
    faults = (LATE_FAULTS, LATE_SHARE) if among_vehicles else (FAULTS, FAULT_SHARE)
    flight = Flight(rng, boxes, duration_s, *faults)
    world, judge = World(params), Judge(boxes, params.free_age_s)
    for k, (due_s, seen) in enumerate(flight.delivered()):
        before = world.picture(seen.t_ns)
        world.add(seen.observation())
        judge.take(seen, world, before)
        if k % every == every - 1:
            judge.check(world, round((100.0 + due_s) * NS))
    return judge


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:10", help="first and last + 1")
    parser.add_argument("--duration", type=float, default=12.0, help="s of each flight")
    parser.add_argument("--vehicles", action="store_true", help="moving vehicles, more late frames, judged more often")
    options = parser.parse_args(arguments)
    first, end = map(int, options.seeds.split(":"))
    cells = places = 0
    total: Counter[str] = Counter()
    for seed in range(first, end):
        judge = judged(seed, options.duration, _OFTEN if options.vehicles else 25, options.vehicles)
        cells, places = cells + judge.cells, places + judge.judged_places
        found = Counter(kind for _, kind, _ in judge.wrong)
        total += found
        first_wrong = f", first {judge.wrong[0]}" if found else ""
        print(f"seed {seed}: {judge.cells} free cells, {judge.judged_places} places{first_wrong}", flush=True)
    print(f"seeds {options.seeds}: {cells} free cells, {places} observed places, wrong: {dict(total)}")
    return int(total.total() > 0)


if __name__ == "__main__":
    sys.exit(main())
