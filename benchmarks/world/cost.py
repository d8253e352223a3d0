"""What the merged world costs: a frame into worlds of a thousand to a million planes, and a hundred thousand questions."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.client_queries import world_space
from benchmarks.world.flights import CONDITION, TRUE, Flight, flown, renderings
from companion.pipeline.transform import LevelTransform, transform_model
from core.extractor import Extractor
from core.params import Params
from core.types import ExtractorState
from core.world.params import WorldParams
from core.world.serialize import SavedSection
from core.world.snapshot import WorldSnapshot
from core.world.world import Observation, World
from osape_client.query.space import Occupancy

Floats = NDArray[np.float64]
SIZES = (1_000, 10_000, 100_000, 1_000_000)
AREA_M2 = 100.0
"""Ground for each plane: a plane every ten metres."""
WAYS, PLANES = 100_000, 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Medians over frames, thread time. add_ms: a frame merged; changes_ms: what changed since the frame before, as it is
    streamed; memory_bytes: of each plane, all tables together."""

    planes: int
    add_ms: float
    p99_ms: float
    changes_ms: float
    memory_bytes: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """ways a second on one core, in one call; radius_m of the ball; answers: shares of occupied, free, unknown."""

    radius_m: float
    per_s: float
    answers: tuple[float, float, float]


def observations(flight: Flight, seed: int, most: int) -> list[Observation]:
    """The first frames of a flight as the world takes them."""
    extractor, state, out = Extractor(Params()), ExtractorState(), []
    for seen in flown(flight, TRUE, seed, renderings(flight, CONDITION, seed)[:most]):
        model, state = extractor.extract(seen.rendered.depth_mm, seen.rendered.info, seen.R_level_optical, state=state)
        at = (float(seen.place_m[0]), float(seen.place_m[1]), float(seen.place_m[2]))
        out.append(
            Observation(model=transform_model(model, LevelTransform(seen.heading_rad, at)), place_m=at, t_ns=seen.t_ns)
        )
    return out


def saved(planes: int, seed: int) -> SavedSection:
    """So many upright planes; the first thousand are the same whatever the number, and the others lie around them."""
    rng = np.random.Generator(np.random.PCG64(seed))
    inner = 0.5 * math.sqrt(SIZES[0] * AREA_M2)
    outer = 0.5 * math.sqrt(planes * AREA_M2)
    xy = rng.uniform(-inner, inner, (SIZES[0], 2))
    if planes > SIZES[0]:
        # an outer square without the inner one: either coordinate lies outside, by rejection in one go
        more = rng.uniform(-outer, outer, (2 * planes + 1000, 2))
        xy = np.concatenate([xy, more[np.abs(more).max(axis=1) > inner][: planes - len(xy)]])
    turn, length = rng.uniform(0.0, math.tau, planes), rng.uniform(1.0, 8.0, planes)
    half = 0.5 * length[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    top = rng.uniform(-8.0, -2.0, planes)
    weight = 100.0 * length
    along = length**2 / 12.0
    zero = np.zeros(planes)
    moments = np.column_stack(
        [
            weight,
            zero,
            zero,
            weight * along * np.cos(turn) ** 2,
            weight * along * np.cos(turn) * np.sin(turn),
            weight * along * np.sin(turn) ** 2,
        ]
    )
    return SavedSection(
        number=1,
        reset_counter=0,
        begun_ns=0,
        newest_ns=0,
        box=np.column_stack([xy - half, xy + half, top, zero]),
        moments=moments,
        margin_m=np.full(planes, 0.1),
        flags=np.zeros(planes, np.uint8),
        hits=np.full(planes, 40, np.int32),
        age_s=zero,
    )


def costs(frames: Sequence[Observation], rounds: int, sizes: Sequence[int] = SIZES) -> list[Cost]:
    """Frames into worlds of each size, taken in turns so that what else the machine does falls on all alike."""
    worlds = []
    for planes in sizes:
        world = World(WorldParams(most_planes=planes + 10_000))
        world.load((saved(planes, 1),))
        worlds.append(world)
    add: list[list[float]] = [[] for _ in sizes]
    changes: list[list[float]] = [[] for _ in sizes]
    for k in range(rounds * len(frames)):
        one = frames[k % len(frames)]
        observation = Observation(model=one.model, place_m=one.place_m, t_ns=(k + 1) * 100_000_000)
        for n in range(len(sizes)):
            world = worlds[(n + k) % len(sizes)]
            begin = time.thread_time_ns()
            world.add(observation)
            middle = time.thread_time_ns()
            world.changes(observation.t_ns, world.frame - 1)
            end = time.thread_time_ns()
            add[(n + k) % len(sizes)].append(1e-6 * (middle - begin))
            changes[(n + k) % len(sizes)].append(1e-6 * (end - middle))
    out = []
    for planes, world, a, c in zip(sizes, worlds, add, changes, strict=True):
        section = world.section
        assert section is not None
        memory = sum(t.nbytes for t in section.tables) / len(section.tables.planes)
        a, c = a[len(frames) :], c[len(frames) :]  # the first round compiles, and makes the free blocks
        out.append(
            Cost(
                planes=planes,
                add_ms=float(np.median(a)),
                p99_ms=float(np.percentile(a, 99)),
                changes_ms=float(np.median(c)),
                memory_bytes=memory,
            )
        )
    return out


def asked(radius_m: float, repeats: int = 5) -> Asked:
    """A hundred thousand ways of about 1.7 m against five hundred planes in free space, in one call on one core."""
    rng = np.random.Generator(np.random.PCG64(5))
    xy, turn = rng.uniform(-40.0, 40.0, (PLANES, 2)), rng.uniform(0.0, math.tau, PLANES)
    along = rng.uniform(0.5, 8.0, (PLANES, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    top = rng.uniform(-6.0, -1.0, PLANES)
    planes = np.column_stack([xy, xy + along, top, top + rng.uniform(0.5, 4.0, PLANES)]).astype(np.float32)
    cells = np.array([[x, y, -1] for x in range(-5, 5) for y in range(-5, 5)], np.int32)
    masks = rng.integers(0, 2**63, (len(cells), 256), dtype=np.uint64)
    masks[rng.random(masks.shape) < 0.9] = np.uint64(0xFFFFFFFFFFFFFFFF)
    picture = WorldSnapshot(
        section=1,
        slots=np.arange(PLANES, dtype=np.int32),
        planes=planes,
        margin_m=np.full(PLANES, 0.1, np.float32),
        flags=np.zeros(PLANES, np.uint8),
        hits=np.ones(PLANES, np.int32),
        seen_ns=np.zeros(PLANES, np.int64),
        blocks=cells,
        masks=masks,
    )
    a = np.column_stack([rng.uniform(-38.0, 38.0, (WAYS, 2)), rng.uniform(-6.0, -1.0, WAYS)])
    b = a + rng.normal(0.0, 1.05, (WAYS, 3))
    times, answers = [], np.zeros(0, np.uint8)
    for _ in range(repeats):
        space = world_space(picture)
        begin = time.thread_time_ns()
        answers = space.segments(a, b, radius_m)
        times.append(1e-9 * (time.thread_time_ns() - begin))
    shares = tuple(float((answers == kind).mean()) for kind in (Occupancy.OCCUPIED, Occupancy.FREE, Occupancy.UNKNOWN))
    return Asked(radius_m=radius_m, per_s=WAYS / float(np.median(times)), answers=(shares[0], shares[1], shares[2]))
