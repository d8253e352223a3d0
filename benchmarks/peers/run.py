"""One case of the side-by-side run: every peer on the same noisy frame, judged by the same rays and points."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.case import frames_of, true_rays
from benchmarks.fidelity.metrics import NAN, Rays, missed_rays, open_stopped_rays, phantom_rays
from benchmarks.fidelity.result import Case
from benchmarks.peers.cloud import Cloud, cloud_of
from benchmarks.peers.methods import Model, Peer
from benchmarks.scenes.catalogue import family_of
from companion.bench.timing import Times
from core.params import Params
from core.types import FrameModel
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
HM_M = Params().min_obstacle_height_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """One method on one frame. mean_m, p95_m: distance of a visible true obstacle point to the model's surface;
    body_mean_m: to its body, 0 inside; missed, phantom, phantom_open, open_stopped: rays, as in
    benchmarks.fidelity.metrics; valid: whether there is a model."""

    peer: str
    unit: str
    family: str
    case: Case
    valid: bool
    primitives: int
    facing: int
    bytes: int
    mean_m: float
    p95_m: float
    body_mean_m: float
    missed: int
    phantom: int
    phantom_open: int
    open_stopped: int
    obstacle_rays: int
    open_rays: int


def directions_of(frame: Rendered, rays: Rays) -> Floats:
    """(H, W, 3) unit vectors along the pixels' rays in level_cam."""
    k = frame.info.intrinsics
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    optical = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1)
    return np.asarray(optical @ frame.R_level_optical.T / rays.per_depth[..., None])


def figures(peer: Peer, case: Case, frame: Rendered, rays: Rays, model: Model, valid: bool) -> Figures:
    """A model's figures on a frame."""
    stop_m = model.stops(frame.info.intrinsics, frame.R_level_optical) * rays.per_depth
    truth = frame.truth.points_level_cam_m
    points = truth[rays.obstacle]
    off, inside = model.surface(points), model.body(points)
    phantom = phantom_rays(rays, stop_m, truth, directions_of(frame, rays))
    return Figures(
        peer=peer.name,
        unit=peer.unit,
        family=family_of(case.scene),
        case=case,
        valid=valid,
        primitives=model.primitives,
        facing=model.facing,
        bytes=model.bytes,
        mean_m=float(off.mean()) if len(off) else NAN,
        p95_m=float(np.percentile(off, 95, method="lower")) if len(off) else NAN,
        body_mean_m=float(inside.mean()) if len(inside) else NAN,
        missed=int(missed_rays(rays, stop_m).sum()),
        phantom=int((phantom & rays.obstacle).sum()),
        phantom_open=int((phantom & rays.open).sum()),
        open_stopped=int(open_stopped_rays(rays, stop_m).sum()),
        obstacle_rays=int(rays.obstacle.sum()),
        open_rays=int(rays.open.sum()),
    )


def run_case(case: Case, peers: Iterable[Peer]) -> list[Figures]:
    """All peers on the second of two frames of a case; the first is for those that remember."""
    frames = frames_of(case, 2)
    last = frames[-1]
    rays = true_rays(case, last, HM_M)
    clouds = [cloud_of(frame, case.ke_per_m) for frame in frames]
    found = []
    for peer in peers:
        peer.forget()
        built = [peer.build(frame, cloud) for frame, cloud in zip(frames, clouds, strict=True)][-1]
        valid = built.valid if isinstance(built, FrameModel) else True
        found.append(figures(peer, case, last, rays, peer.model(built), valid))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """A peer's times on the frames of one kind."""

    peer: str
    kind: str
    times: Times


CLOUD = "the others' cloud"
"""What all but ours are given; it is timed as if it were one of them."""


Build = Callable[[Rendered, Cloud], object]


def _clouding(ke_per_m: float) -> Build:
    def build(frame: Rendered, cloud: Cloud) -> object:
        return cloud_of(frame, ke_per_m)

    return build


def time_peers(peers: Sequence[Peer], kinds: dict[str, list[Case]], rounds: int, budget_s: float) -> list[Timing]:
    """Times of all peers on frames of several kinds, in turn on every frame, so that what happens to the machine happens
    to all of them. Once over all frames warms up. A peer stops after budget_s and three frames of a kind.

    The processor's time is that of the whole process: libraries with threads of their own do not get theirs for nothing."""
    out = []
    for kind, cases in kinds.items():
        frames = [frame for case in cases for frame in frames_of(case, 2)]
        ke = cases[0].ke_per_m
        clouds = [cloud_of(frame, ke) for frame in frames]
        builds: dict[str, Build] = {peer.name: peer.build for peer in peers}
        builds[CLOUD] = _clouding(ke)
        spent: dict[str, list[tuple[int, int]]] = {name: [] for name in builds}
        for i in range(len(frames) + rounds):
            frame, cloud = frames[i % len(frames)], clouds[i % len(frames)]
            warm = i < len(frames)
            for name, build in builds.items():
                done = spent[name]
                if len(done) >= 3 and 1e-9 * sum(cpu for _, cpu in done) > budget_s:
                    continue
                wall, cpu = time.perf_counter_ns(), time.process_time_ns()
                build(frame, cloud)
                if not warm:
                    done.append((time.perf_counter_ns() - wall, time.process_time_ns() - cpu))
            word = f"warming up, frame {i + 1}" if warm else f"round {i + 1 - len(frames)}/{rounds}"
            print(f"\rpeers: time of {kind}, {word}   ", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        for name, done in spent.items():
            ms = 1e-6 * np.array(done, np.float64)
            out.append(Timing(peer=name, kind=kind, times=Times(ms[:, 0], ms[:, 1])))
    return out
