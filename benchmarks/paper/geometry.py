"""Lemma 1, the roll threshold, Algorithms 1 and 2 and Eq. 17: each rule as printed, given what real frames hold."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.paper.cases import (
    CAMERA,
    EXACT,
    NAN,
    Floats,
    frames_of,
    held_out,
    middle,
    model_of,
    named_frames,
    progress,
)
from benchmarks.paper.equations import Finding
from core.extractor import Extractor
from core.params import Params
from core.types import StripTable
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered

WS_M, HS_M = 2.0, 1.0
STANDS_OUT_M = 0.1
SAMPLE = {"structured": ("street", "corner", "window"), "unstructured": ("trees", "stones", "mixture")}


def lemma_distance(frame: Rendered, theta_rad: float) -> Floats:
    """(H, W) horizontal distance of each pixel by Lemma 1: f / D_theta with D = f / Z and the paper's theta."""
    k = frame.info.intrinsics
    v = np.arange(k.height)[:, None]
    factor = k.fy * math.cos(theta_rad) - (v - k.cy) * math.sin(theta_rad)
    return np.asarray(frame.truth.depth_m * factor / k.fy)


def drift(frame: Rendered, column: int) -> float:
    """How far sideways, m, what one image column sees of the obstacles reaches."""
    seen = frame.truth.obstacle(0.0)[:, column]
    y = frame.truth.points_level_cam_m[:, column, 1][seen]
    return float(y.max() - y.min()) if seen.any() else NAN


def lemma() -> Finding:
    """Lemma 1 on a wall at 8 m that is 4 m high, over pitch: exact depth, camera 2 m up."""
    s = SceneBuilder("wall")
    s.ground()
    s.wall("wall", (8.0, -12.0), (8.0, 12.0), 4.0)
    scene = s.build()
    rows: list[list[str | float]] = []
    for pitch in (0.0, -10.0, -20.0, -30.0, 10.0, 20.0, 30.0):
        frame = frames_of(scene, EXACT, 0, pitch_deg=pitch, count=1)[0]
        seen = frame.truth.obstacle(0.0)
        true = frame.truth.points_level_cam_m[..., 0]
        theta = math.radians(-pitch)  # nose down is positive
        errors = [
            float(np.abs(distance[seen] - true[seen]).max())
            for distance in (frame.truth.depth_m, lemma_distance(frame, -theta), lemma_distance(frame, theta))
        ]
        rows.append([f"{pitch:+.0f}°", *errors, drift(frame, 4), drift(frame, 320)])
    head = ["pitch (nose up)", "depth itself, m", "theta nose up, m", "theta nose down, m"]
    return Finding(
        name="lemma",
        title="Lemma 1 on a wall at 8 m: greatest error of the horizontal distance; sideways drift within one column",
        head=[*head, "drift, edge column, m", "drift, middle column, m"],
        digits=[0, 2, 2, 2, 2, 2],
        rows=rows,
        words=1,
    )


def small_roll() -> Finding:
    """What rolls at and below the threshold, which are not undone, do to heights on a wall at 10 m."""
    s = SceneBuilder("wall")
    s.ground()
    s.wall("wall", (10.0, -12.0), (10.0, 12.0), 4.0)
    scene = s.build()
    rows: list[list[str | float]] = []
    for roll in (0.5, 1.0, 1.9, 2.0):
        frame = frames_of(scene, EXACT, 0, roll_deg=roll, count=1)[0]
        k = frame.info.intrinsics
        v = (np.arange(k.height)[:, None] - k.cy) / k.fy
        seen = frame.truth.obstacle(0.0)
        taken = np.broadcast_to(v, seen.shape) * frame.truth.depth_m  # z as if the camera were level
        rows.append([roll, float(np.abs(taken[seen] - frame.truth.points_level_cam_m[..., 2][seen]).max())])
    return Finding(
        name="small_roll",
        title="Rolls up to the threshold of 2°, left as they are: greatest error of height at 10 m",
        head=["roll, degrees", "error of height, m"],
        digits=[1, 2],
        rows=rows,
    )


def strips_of(name: str, seed: int) -> StripTable:
    """The strips of a frame as ours finds them, under a camera's noise and faults, in order of column."""
    model = model_of(named_frames(name, seed, CAMERA), Extractor(Params()), keep_strips=True)
    if model.strips is None:
        raise ValueError(f"{name}: the frame gave no strips ({model.cause.text})")
    return model.strips


def algorithm_1(x_m: Floats, y_m: Floats, width_m: float = WS_M) -> list[int]:
    """Algorithm 1 as printed: the cluster of each strip, in the order given; only each cluster's last strip counts."""
    last_x: list[float] = []
    last_y: list[float] = []
    out = []
    for x, y in zip(x_m.tolist(), y_m.tolist(), strict=True):
        best, nearest = -1, width_m
        if last_x:
            gaps = np.hypot(np.array(last_x) - x, np.array(last_y) - y)
            at = int(np.argmin(gaps))
            if gaps[at] < nearest:
                best = at
        if best < 0:
            best = len(last_x)
            last_x.append(x)
            last_y.append(y)
        else:
            last_x[best], last_y[best] = x, y
        out.append(best)
    return out


def torn_share(strips: StripTable, cluster: list[int]) -> float:
    """Of the pairs of strips in neighbouring columns that the vehicle cannot pass between (horizontal gap below Ws,
    vertical below Hs): the share that is in two clusters."""
    number = np.array(cluster)
    torn, near = 0, 0
    by_column: dict[int, list[int]] = {}
    for i, u in enumerate(strips.u.tolist()):
        by_column.setdefault(u, []).append(i)
    for u, mine in by_column.items():
        there = np.array(by_column.get(u + 1, []), np.int64)
        for i in mine:
            across = np.hypot(strips.x_m[there] - strips.x_m[i], strips.y_m[there] - strips.y_m[i]) < WS_M
            above = np.maximum(strips.top_m[there] - strips.bottom_m[i], strips.top_m[i] - strips.bottom_m[there])
            close = across & (above < HS_M)
            near += int(close.sum())
            torn += int((close & (number[there] != number[i])).sum())
    return torn / near if near else NAN


def clustering() -> Finding:
    """Algorithm 1 as printed and ours on the same strips."""
    rows: list[list[str | float]] = []
    for kind, names in SAMPLE.items():
        for how in ("Algorithm 1", "ours"):
            found = []
            for name in names:
                progress(f"clusters: {name}, {how}")
                strips = strips_of(name, held_out(1)[0])
                x, y = strips.x_m.astype(np.float64), strips.y_m.astype(np.float64)
                cluster = algorithm_1(x, y) if how == "Algorithm 1" else strips.cluster.tolist()
                found.append((float(len(set(cluster))), torn_share(strips, cluster)))
            clusters, torn = ([float(v) for v in column] for column in zip(*found, strict=True))
            rows.append([kind, how, middle(clusters), 100.0 * middle(torn), 100.0 * max(torn)])
    return Finding(
        name="clustering",
        title="Algorithm 1 on the same strips: medians of three frames each",
        head=["scenes", "how", "clusters", "neighbours torn apart, %", "worst, %"],
        digits=[0, 0, 0, 1, 1],
        rows=rows,
        words=2,
    )


def deleted(before: Floats, at: Floats, after: Floats, width_m: float = WS_M) -> tuple[bool, bool, float]:
    """(deleted by the text's cross product, by the listing's dot product, how far it stands out towards the camera) of
    the middle one of three strips at (x, y), x forward, y right, from left to right. Standing out is negative in a pocket."""
    a, b = at - before, after - at
    chord = after - before
    length = float(np.hypot(*chord))
    cross = float(a[0] * b[1] - a[1] * b[0])
    # seen from the camera the chord runs to the right: what lies on its far side stands farther out in x
    out = -cross / length if length > 0.0 else 0.0
    near = length < width_m
    return near and out < 0.0, near and float(a @ (at - after)) > 0.0, out


def corners_of(strips: StripTable) -> list[tuple[Floats, Floats, Floats]]:
    """Three strips in a row of one cluster: neighbouring columns, overlapping in height."""
    last: dict[int, list[int]] = {}
    out = []
    place = np.column_stack([strips.x_m, strips.y_m]).astype(np.float64)
    for i in range(len(strips.u)):
        chain = last.setdefault(int(strips.cluster[i]), [])
        if chain:
            j = chain[-1]
            overlap = min(strips.bottom_m[i], strips.bottom_m[j]) - max(strips.top_m[i], strips.top_m[j])
            if strips.u[i] == strips.u[j]:
                continue
            if strips.u[i] != strips.u[j] + 1 or overlap <= 0.0:
                chain.clear()
        chain.append(i)
        if len(chain) >= 3:
            a, b, c = chain[-3:]
            out.append((place[a], place[b], place[c]))
    return out


def products() -> Finding:
    """The text's rule and the listing's on the strips of real frames that stand out or in by more than noise."""
    rows: list[list[str | float]] = []
    for kind, names in SAMPLE.items():
        found = []
        for name in names:
            progress(f"Algorithm 2: {name}")
            found += [deleted(*corner) for corner in corners_of(strips_of(name, held_out(1)[0]))]
        text, listing, out = (np.array(column) for column in zip(*found, strict=True))
        for what, mine in (("spike towards the camera", out > STANDS_OUT_M), ("pocket", out < -STANDS_OUT_M)):
            shares = [100.0 * float(rule[mine].mean()) if mine.any() else NAN for rule in (text, listing)]
            rows.append([kind, what, float(mine.sum()), *shares])
    return Finding(
        name="products",
        title=f"Algorithm 2: strips that stand out or in by more than {STANDS_OUT_M:g} m between two neighbours",
        head=["scenes", "what", "strips", "deleted by the text's cross product, %", "by the listing's dot product, %"],
        digits=[0, 0, 0, 0, 0],
        rows=rows,
        words=2,
    )


def line_errors(turn_rad: float, ke_per_m: float, rng: np.random.Generator) -> tuple[float, float]:
    """Greatest distance of a fitted wall's ends from the truth, m: by regression of x on y, as eta's moments allow
    (no XX in the paper's Z direction), and by total least squares with all moments. The wall is 4 m long, 8 m away."""
    along = np.array([math.sin(turn_rad), math.cos(turn_rad)])
    true = np.array([8.0, 1.0]) + np.linspace(-2.0, 2.0, 60)[:, None] * along
    noisy = true * (1.0 / (1.0 / true[:, :1] + 0.2 * ke_per_m * rng.standard_normal((60, 1)))) / true[:, :1]
    mean = noisy.mean(axis=0)
    d = noisy - mean
    xx, xy, yy = (float((d[:, i] * d[:, j]).mean()) for i, j in ((0, 0), (0, 1), (1, 1)))
    slope = xy / yy if yy > 1e-12 else 0.0
    total = 0.5 * math.atan2(2.0 * xy, yy - xx)
    errors = []
    for direction in (np.array([slope, 1.0]) / math.hypot(slope, 1.0), np.array([math.sin(total), math.cos(total)])):
        normal = np.array([-direction[1], direction[0]])
        errors.append(float(np.abs((true[[0, -1]] - mean) @ normal).max()))
    return errors[0], errors[1]


def merging() -> Finding:
    """Eq. 17's moments on a wall turned towards the view axis."""
    rows: list[list[str | float]] = []
    rng = np.random.Generator(np.random.PCG64(17))
    for degrees in (0.0, 45.0, 75.0, 88.0, 89.0, 89.5, 90.0):
        found = [line_errors(math.radians(degrees), 0.005, rng) for _ in range(200)]
        printed, ours = (float(np.median(column)) for column in zip(*found, strict=True))
        rows.append([degrees, printed, ours])
    return Finding(
        name="merging",
        title="Eq. 17: error of a wall's ends by its moments (no ZZ) and by all of them, at ke = 0.005, 25 pixels a strip",
        head=["turned from across the view, °", "eta as printed, m", "with ZZ, m"],
        digits=[1, 3, 3],
        rows=rows,
    )


def findings() -> list[Finding]:
    """All experiments of this file."""
    return [lemma(), small_roll(), clustering(), products(), merging()]
