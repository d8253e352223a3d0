"""Runs the vehicles and the radio, and compares their obstacles in the end with the truth."""

from __future__ import annotations

import multiprocessing
import pickle
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import judge
from benchmarks.paper.cases import EXACT, rays_under
from benchmarks.sharing.delays import delays
from benchmarks.sharing.flights import Part, errors, flown, judged_poses, length_of, scene_of, ways
from benchmarks.sharing.pairs import Pair, pairs_of
from benchmarks.sharing.radio import Channel, Traffic, radio
from benchmarks.sharing.vehicle import Outcome, Task, fly
from benchmarks.sharing.virtual import play
from benchmarks.world.flights import frame
from benchmarks.world.truth import in_level, seen_by, to_ned
from core.params import Params
from core.world.world import Observation, World
from drivers.simulation.source import Rendered

NS = 1_000_000_000
Floats = NDArray[np.float64]
WINDOW_S = 10.0
START_UP_S = 5.0
"""All that is in view at the start is new at once; what is seen first later than this counts as in flight."""
IN_TIME_S = 0.5
"""Goal for the delay of a new obstacle."""
START_S = 1.0
_THIN = 3


@dataclass(frozen=True, slots=True)
class Missed:
    """Share of obstacle rays that pass behind the planes, and behind the planes with their margins in front and at both
    ends; number of rays."""

    share: float
    with_margins: float
    rays: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """One run. rate: greatest B/s of a vehicle over WINDOW_S; mean_rate: over the flight; latency_s: p50, p95 and greatest
    from the confirmation of a new obstacle by its owner until it is published by another vehicle, in flight; start_s: p95 with all that is in view at
    the start; in_time: share of all that are new in flight and arrive within IN_TIME_S; never: share of those that never
    arrived; alone, joint, one: obstacle rays missed by the first vehicle, by it with its neighbours, and by one vehicle that flew
    all parts; pairs: of receivers and senders."""

    scene: str
    vehicles: int
    seed: int
    rate: float
    mean_rate: float
    latency_s: tuple[float, float, float]
    start_s: float
    in_time: float
    never: float
    alone: Missed
    joint: Missed
    one: Missed
    pairs: tuple[Pair, ...]
    lost: float
    late_frames: int
    refused: dict[str, int]
    planes: int


def run(
    scene_name: str,
    vehicles: int,
    seed: int,
    bytes_per_s: float,
    channel: Channel,
    *,
    same_way: bool = False,
    processes: bool = False,
) -> Figures:
    """One run in simulated time; processes: in real time, each vehicle and the radio a process."""
    scene = scene_of(scene_name, length_of(vehicles), seed)
    offsets = errors(vehicles, seed)
    parts = [
        flown(scene, way, error, seed + 100 * k)
        for k, (way, error) in enumerate(zip(ways(vehicles, same_way=same_way), offsets, strict=True))
    ]
    if processes:
        with tempfile.TemporaryDirectory() as folder:
            outcomes, traffic, begin_ns = _play(parts, Path(folder), bytes_per_s, channel, seed)
    else:
        outcomes, traffic, begin_ns = play(parts, bytes_per_s, channel, seed)
    views = [frame(scene, pose, EXACT, seed, 0) for pose in judged_poses(vehicles)]
    name = f"{scene_name}{', same way' if same_way else ''}{', processes' if processes else ''}"
    return _figures(name, seed, parts, outcomes, traffic, views, begin_ns)


def _play(
    parts: Sequence[Part], folder: Path, bytes_per_s: float, channel: Channel, seed: int
) -> tuple[list[Outcome], Traffic, int]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    medium = context.Process(target=radio, args=(there, len(parts), channel, seed), daemon=True)
    medium.start()
    ports = here.recv()
    flying = []
    for k, part in enumerate(parts):
        frames = folder / f"{k}.pickle"
        frames.write_bytes(pickle.dumps(part.seen))
        mine, theirs = context.Pipe()
        task = Task(k + 1, frames, part.error.origin(), ports[k], bytes_per_s)
        process = context.Process(target=fly, args=(task, theirs), daemon=True)
        process.start()
        flying.append((process, mine))
    for _, mine in flying:
        mine.recv()  # ready
    begin_ns = time.monotonic_ns() + round(START_S * NS)
    for _, mine in flying:
        mine.send(begin_ns)
    outcomes = [mine.recv() for _, mine in flying]
    here.send("end")
    traffic: Traffic = here.recv()
    for process, _ in flying:
        process.join()
    medium.join()
    return outcomes, traffic, begin_ns


def _figures(
    scene: str,
    seed: int,
    parts: Sequence[Part],
    outcomes: Sequence[Outcome],
    traffic: Traffic,
    views: Sequence[Rendered],
    begin_ns: int,
) -> Figures:
    rates = [_rates(sent, begin_ns) for sent in traffic.sent]
    in_flight, never = _delays(outcomes, begin_ns + round(START_UP_S * NS))
    early, _ = _delays(outcomes, 0)
    pairs = pairs_of(parts, outcomes)
    flown_by = [r for part in parts for r in part.rendered]
    first, error = outcomes[0], parts[0].error
    assert first.shared is not None
    own = error.true_boxes(first.own), first.own_margin_m
    shared = error.true_boxes(first.shared.planes.astype(np.float64)), first.shared.margin_m
    alone, one = _missed(views, *own, flown_by), _missed(views, *_one_vehicle(parts), flown_by)
    joint = _missed(views, np.concatenate([own[0], shared[0]]), np.concatenate([own[1], shared[1]]), flown_by)
    datagrams = sum(map(len, traffic.sent)) * (len(parts) - 1)
    refused: dict[str, int] = {}
    for outcome in outcomes:
        for code, count in outcome.counts.items():
            if code != "accepted":
                refused[code] = refused.get(code, 0) + count
    return Figures(
        scene=scene, vehicles=len(parts), seed=seed, rate=max(r[0] for r in rates), mean_rate=max(r[1] for r in rates),
        latency_s=(float(np.percentile(in_flight, 50)), float(np.percentile(in_flight, 95)), float(in_flight.max())),
        start_s=float(np.percentile(early, 95)),
        in_time=(1.0 - never) * float((in_flight <= IN_TIME_S + 1e-9).mean()), never=never,
        alone=alone, joint=joint, one=one, pairs=tuple(pairs),
        lost=traffic.lost / max(1, datagrams), late_frames=sum(o.late_frames for o in outcomes), refused=refused,
        planes=len(own[0]),
    )  # fmt: skip


def _one_vehicle(parts: Sequence[Part]) -> tuple[Floats, Floats]:
    """(planes, margins) of one vehicle that flew all parts, of all sections: from one part to the next it may jump."""
    world = World()
    for k, seen in enumerate(s for part in parts for s in part.true):
        world.add(Observation(model=seen.model, place_m=seen.place_m, t_ns=(k + 1) * NS // 5))
    sections = world.saved()
    return np.concatenate([s.box for s in sections]), np.concatenate([s.margin_m for s in sections])


def _rates(sent: Sequence[tuple[int, int]], begin_ns: int) -> tuple[float, float]:
    """(greatest over WINDOW_S, mean) bytes per second since the begin of the flight."""
    t = np.array([at_ns for at_ns, _ in sent if at_ns >= begin_ns], np.float64) / NS
    size = np.array([n for at_ns, n in sent if at_ns >= begin_ns], np.float64)
    if not len(t):
        return 0.0, 0.0
    sums = [
        size[(t >= begin) & (t < begin + WINDOW_S)].sum() / WINDOW_S for begin in np.arange(t[0], t[-1] - WINDOW_S, 1.0)
    ]
    return float(max(sums, default=0.0)), float(size.sum() / max(1.0, t[-1] - t[0]))


def _delays(outcomes: Sequence[Outcome], since_ns: int) -> tuple[Floats, float]:
    """(delays of all new obstacles since then, for all receivers, in s; share that never arrived)."""
    found: list[float] = []
    missing = 0
    for sender in outcomes:
        for receiver in outcomes:
            if receiver is not sender:
                some, never = delays(sender.confirmed, receiver.received, sender.number, since_ns)
                found += some
                missing += never
    return np.array(found), missing / max(1, missing + len(found))


def _missed(views: Sequence[Rendered], planes: Floats, margin_m: Floats, flown_by: Sequence[Rendered]) -> Missed:
    """The obstacle rays that pass behind the truth, of those whose point the flights have seen."""
    missed = with_margins = seen = 0
    longer = lengthened(planes, margin_m)
    for view in views:
        rays = rays_under(view, EXACT, Params())
        v = judge(view, rays, in_level(planes, view))
        widest = judge(view, rays, in_level(longer, view), margin_m)
        some = np.s_[::_THIN, ::_THIN]
        asked = rays.obstacle[some]
        was_seen = seen_by(to_ned(view, view.truth.points_level_cam_m[some][asked]), flown_by)
        seen += int(was_seen.sum())
        missed += int(v.missed[some][asked][was_seen].sum())
        with_margins += int(widest.missed_margin[some][asked][was_seen].sum())
    return Missed(missed / max(1, seen), with_margins / max(1, seen), seen)


def lengthened(planes: Floats, margin_m: Floats) -> Floats:
    """Planes (N, 6) that are longer by their margins (N,) at both ends. A frame that is placed wrongly moves them to the side,
    too."""
    along = planes[:, 2:4] - planes[:, 0:2]
    along *= (margin_m / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9))[:, None]
    return np.column_stack([planes[:, 0:2] - along, planes[:, 2:4] + along, planes[:, 4:6]])
