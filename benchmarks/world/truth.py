"""Compares the merged world of a flight with the truth, from poses that the flight does not contain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.client_queries import world_space
from benchmarks.fidelity.metrics import NAN, Rays, distances, judge
from benchmarks.paper.cases import CAMERA, EXACT, rays_under
from benchmarks.world.flights import Estimate, Flight, Seen, flown
from companion.pipeline.transform import LevelTransform, transform_model
from companion.streams.world_messages import world_message
from core.extractor import Extractor
from core.params import Params
from core.types import ExtractorState
from core.world.world import Observation, World
from drivers.simulation.source import Rendered
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
SNAPSHOT_FRAMES = 50
"""From one snapshot in the stream to the next: 10 s, as the service sends them."""
_THIN = 3
"""Step of the evaluated pixels in rows and columns."""
_INSIDE_STEP_M = 0.25
_HEIGHTS_M = (1.0, 2.0)
BEHIND_M = (0.8, 1.5, 3.0)
"""Places so far behind a true point: what a world calls free there, something in view must have shown to be free."""
_UNSEEN_M = 0.3
"""A place counts as seen up to this far behind what a frame shows, and a pixel beside it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """One flight under one estimate. Shares are of 1; nan: there is nothing to ask about.

    closed: of the inside of what was flown around, called occupied. missed: obstacle rays that pass more than max(0.5 m,
    2 sigma) behind the truth, of those whose point the flight saw; missed_all: of all. phantom: rays stopped where nothing
    is. mean_m, p95_m: from seen true points to the nearest plane. false_free: seen true points called free; unseen_free: places
    BEHIND_M behind true points that no frame can have seen, called free; air: points half way to the truth called free. planes, frame_planes: of the world in the end, of all frames together. sections: 1 unless it
    jumped."""

    flight: str
    estimate: str
    frames: int
    closed: float
    missed: float
    missed_all: float
    phantom: float
    mean_m: float
    p95_m: float
    false_free: float
    unseen_free: float
    air: float
    planes: int
    frame_planes: int
    sections: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """The world after one frame. frame_planes: planes of all frames so far; stream_bytes: of all messages so far, plane_bytes
    the planes in them; free_cells: number of free cells."""

    planes: int
    frame_planes: int
    stream_bytes: int
    plane_bytes: int
    free_cells: int


@dataclass(slots=True)
class Merged:
    """A world, how it grew, and where it lies: drift_m is how far its newest frame is off."""

    world: World
    steps: list[Step]
    drift_m: Floats
    newest_ns: int


def merged(flight: Flight, estimate: Estimate, seed: int, rendered: list[Rendered]) -> Merged:
    """The world that a flight makes."""
    extractor, world, state = Extractor(Params()), World(), ExtractorState()
    steps: list[Step] = []
    frame_planes, stream, plane_bytes, since, section, epoch = 0, 0, 0, 0, -1, -1
    seen: Seen | None = None
    for k, seen in enumerate(flown(flight, estimate, seed, rendered)):
        model, state = extractor.extract(seen.rendered.depth_mm, seen.rendered.info, seen.R_level_optical, state=state)
        at = (float(seen.place_m[0]), float(seen.place_m[1]), float(seen.place_m[2]))
        world.add(
            Observation(model=transform_model(model, LevelTransform(seen.heading_rad, at)), place_m=at, t_ns=seen.t_ns)
        )
        frame_planes += len(model.planes)
        now = (0 if world.section is None else world.section.number), world.epoch(seen.t_ns)
        picture = world.picture(seen.t_ns)
        if now != (section, epoch) or k % SNAPSHOT_FRAMES == 0:
            message = world_message(picture, np.zeros(0, np.int32), seen.t_ns)
        else:
            message = world_message(*world.changes(seen.t_ns, since), seen.t_ns)
        (section, epoch), since = now, world.frame
        stream += message.ByteSize()
        plane_bytes += len(message.planes)
        free = int(np.unpackbits(picture.masks.view(np.uint8)).sum())
        steps.append(
            Step(
                planes=len(picture.planes),
                frame_planes=frame_planes,
                stream_bytes=stream,
                plane_bytes=plane_bytes,
                free_cells=free,
            )
        )
    assert seen is not None
    return Merged(world, steps, seen.drift_m, seen.t_ns)


def verdict(
    flight: Flight, estimate: Estimate, m: Merged, rendered: Sequence[Rendered], views: Sequence[Rendered]
) -> Verdict:
    """All figures of one flight."""
    space = world_space(m.world.picture(m.newest_ns))
    planes = space.snapshot.planes.astype(np.float64)
    there = planes - np.array([*m.drift_m[:2], *m.drift_m[:2], m.drift_m[2], m.drift_m[2]])
    found = [_view(v, there, space, m.drift_m, rendered) for v in views]
    total = {name: sum(f[name] for f in found) for name in found[0] if name != "off"}
    off = np.concatenate([f["off"] for f in found])
    numbers = m.world.numbers()
    return Verdict(
        flight=flight.name,
        estimate=estimate.name,
        frames=len(rendered),
        closed=_closed(flight, space, m.drift_m),
        missed=_share(total["missed_seen"], total["seen"]),
        missed_all=_share(total["missed"], total["obstacle"]),
        phantom=_share(total["phantom"], total["rays"]),
        mean_m=float(off.mean()) if len(off) else NAN,
        p95_m=float(np.percentile(off, 95)) if len(off) else NAN,
        false_free=_share(total["false_free"], total["seen"]),
        unseen_free=_share(total["unseen_free"], total["unseen"]),
        air=_share(total["air_free"], total["air"]),
        planes=len(planes),
        frame_planes=m.steps[-1].frame_planes,
        sections=numbers["sections"],
    )


def _view(
    view: Rendered, planes: Floats, space: WorldSpace, drift: Floats, flown_by: Sequence[Rendered]
) -> dict[str, Any]:
    """Counts of one view. planes: in the true ned."""
    rays = rays_under(view, EXACT, Params())
    level = in_level(planes, view)
    v = judge(view, rays, level)
    some = np.s_[::_THIN, ::_THIN]
    asked = rays.obstacle[some]
    ned = to_ned(view, view.truth.points_level_cam_m[some][asked])
    was_seen = seen_by(ned, flown_by)
    off = distances(view.truth.points_level_cam_m[some][asked][was_seen], level) if len(level) else np.zeros(0)
    surface = space.points(ned[was_seen] + drift)
    air, behind = half_way(view, rays), behind_truth(view, rays)
    unseen = behind[~could_see(behind, flown_by)]
    return {
        "obstacle": int(rays.obstacle.sum()),
        "missed": int((v.missed & rays.obstacle).sum()),
        "seen": int(was_seen.sum()),
        "missed_seen": int(v.missed[some][asked][was_seen].sum()),
        "phantom": int((v.phantom & (rays.obstacle | rays.open)).sum()),
        "rays": int((rays.obstacle | rays.open).sum()),
        "off": off,
        "false_free": int((surface == Occupancy.FREE).sum()),
        "unseen": len(unseen),
        "unseen_free": int((space.points(unseen + drift) == Occupancy.FREE).sum()),
        "air": len(air),
        "air_free": int((space.points(air + drift) == Occupancy.FREE).sum()),
    }


def _share(part: int, whole: int) -> float:
    return part / whole if whole else NAN


def _closed(flight: Flight, space: WorldSpace, drift: Floats) -> float:
    """Share of the inside that is called occupied."""
    if flight.inside is None:
        return NAN
    x, y, half = flight.around
    steps = np.arange(-1.3 * half, 1.3 * half, _INSIDE_STEP_M)
    grid = np.array([[x + a, y + b, -h] for a in steps for b in steps for h in _HEIGHTS_M])
    within = grid[flight.inside(grid)]
    return float((space.points(within + drift) == Occupancy.OCCUPIED).mean())


def in_level(planes: Floats, view: Rendered) -> Floats:
    """Planes (N, 6) of ned in level_cam of a view."""
    heading, at = _heading(view), view.position_ned_m
    c, s = math.cos(heading), math.sin(heading)
    ends = (planes[:, :4].reshape(-1, 2) - at[:2]) @ np.array([[c, -s], [s, c]])
    return np.hstack([ends.reshape(-1, 4), planes[:, 4:] - at[2]])


def to_ned(view: Rendered, points: Floats) -> Floats:
    """Points (P, 3) of level_cam in ned."""
    heading = _heading(view)
    c, s = math.cos(heading), math.sin(heading)
    return np.asarray(points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + view.position_ned_m)


def _heading(view: Rendered) -> float:
    R = view.R_ned_optical @ view.R_level_optical.T
    return math.atan2(R[1, 0], R[0, 0])


def seen_by(points: Floats, frames: Sequence[Rendered], least: int = 2) -> Mask:
    """(P,) whether at least this number of frames had each true point (ned) in view, within their range."""
    count = np.zeros(len(points), np.int64)
    for r in frames:
        k = r.info.intrinsics
        optical = (points - r.position_ned_m) @ r.R_ned_optical
        z = optical[:, 2]
        far_m = r.info.max_range_m / (1.0 + 3.0 * CAMERA.ke_per_m * r.info.max_range_m)
        within = np.flatnonzero((z > r.info.min_range_m) & (z < far_m))
        u = np.rint(k.fx * optical[within, 0] / z[within] + k.cx).astype(int)
        v = np.rint(k.fy * optical[within, 1] / z[within] + k.cy).astype(int)
        on = (u >= 0) & (u < k.width) & (v >= 0) & (v < k.height)
        within, u, v = within[on], u[on], v[on]
        met = np.abs(r.truth.depth_m[v, u] - z[within]) < 0.1 + 0.02 * z[within]
        count[within[met]] += 1
    return np.asarray(count >= least)


def half_way(view: Rendered, rays: Rays) -> Floats:
    """(P, 3) ned: half way to what each ray meets, well above the ground."""
    some = np.s_[:: 3 * _THIN, :: 3 * _THIN]
    points = view.truth.points_level_cam_m[some][rays.obstacle[some]]
    ned = to_ned(view, 0.5 * points)
    return ned[ned[:, 2] < -1.0]


def behind_truth(view: Rendered, rays: Rays) -> Floats:
    """(P, 3) ned: BEHIND_M behind what each ray meets, well above the ground."""
    some = np.s_[:: 3 * _THIN, :: 3 * _THIN]
    points = view.truth.points_level_cam_m[some][rays.obstacle[some]]
    range_m = np.linalg.norm(points, axis=1)[:, None]
    ned = np.concatenate([to_ned(view, points * (1.0 + far_m / range_m)) for far_m in BEHIND_M])
    return ned[ned[:, 2] < -1.0]


def could_see(points: Floats, frames: Sequence[Rendered]) -> Mask:
    """(P,) whether any frame had each point (ned) in its image with nothing more than _UNSEEN_M before it."""
    seen = np.zeros(len(points), np.bool_)
    for r in frames:
        k = r.info.intrinsics
        optical = (points - r.position_ned_m) @ r.R_ned_optical
        ahead = np.flatnonzero(~seen & (optical[:, 2] > 0.1))
        z = optical[ahead, 2]
        u = np.rint(k.fx * optical[ahead, 0] / z + k.cx).astype(int)
        v = np.rint(k.fy * optical[ahead, 1] / z + k.cy).astype(int)
        on = (u >= -1) & (u <= k.width) & (v >= -1) & (v <= k.height)
        ahead, z, u, v = ahead[on], z[on], u[on], v[on]
        for across, down in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            at = np.clip(v + down, 0, k.height - 1), np.clip(u + across, 0, k.width - 1)
            seen[ahead] |= r.truth.depth_m[at] > z - _UNSEEN_M
    return seen
