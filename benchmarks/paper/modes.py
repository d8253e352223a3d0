"""What only the whole shows: both modes of the extractor on open ground, before a beam, with thresholds varied."""

from __future__ import annotations

import numpy as np

from benchmarks.fidelity.metrics import score
from benchmarks.paper.cases import (
    CAMERA,
    CONDITION_WORDS,
    CONDITIONS,
    EXACT,
    MODES,
    frames_of,
    held_out,
    measure,
    middle,
    model_of,
    named_frames,
    progress,
    rays_under,
)
from benchmarks.paper.equations import Finding
from benchmarks.paper.forms import extractor_of, params_of
from benchmarks.paper.geometry import SAMPLE
from benchmarks.paper.plots import words
from benchmarks.scenes import catalogue as scenes
from core.extractor import Extractor
from core.params import Params
from drivers.simulation.scenes import GroundTruth, SceneBuilder


def open_ground() -> Finding:
    """Flat ground with nothing on it, from 2 m above."""
    rows: list[list[str | float]] = []
    for condition in CONDITIONS:
        for mode in MODES:
            progress(f"open ground: {condition.name}, {mode}")
            seed = held_out(1)[0]
            found = measure(named_frames("open", seed, condition), condition, "open", seed, params_of(mode))
            rows.append([CONDITION_WORDS[condition.name], words(mode), float(found.planes), 100.0 * found.open_stopped])
    return Finding(
        name="open_ground",
        title="Open ground, nothing on it, camera 2 m up",
        head=["depth", "model", "planes", "rays stopped, %"],
        digits=[0, 0, 0, 1],
        rows=rows,
        words=2,
    )


def beam() -> Finding:
    """A beam at 4 m in front of a wall at 10 m, exact depth: Eq. 9 over all pixels between both ends, and the rest."""
    s = SceneBuilder("beam", ground_truth=GroundTruth(30.0))
    s.wall("wall", (10.0, -14.0), (10.0, 14.0), 14.0, base=-5.0)
    s.cylinder("beam", (4.0, -8.0, -2.3), (4.0, 8.0, -2.3), 0.06)
    frames = frames_of(s.build(), EXACT, 0, count=1)
    rays = rays_under(frames[0], EXACT, Params())
    rows: list[list[str | float]] = []
    for mode in MODES:
        model = model_of(frames, extractor_of(params_of(mode)), keep_strips=True)
        found = score(frames[0], rays, model.planes.astype(np.float64))
        rows.append([words(mode), float(found.planes), found.mean_m, 100.0 * found.phantom, 100.0 * found.missed])
    return Finding(
        name="beam",
        title="A beam 0.12 m thick at 4 m before a wall at 10 m, exact depth",
        head=["model", "planes", "error, m", "phantom, %", "missed, %"],
        digits=[0, 0, 3, 1, 1],
        rows=rows,
        words=1,
    )


def vanished() -> Finding:
    """Strips' pixels that no plane of the printed form stands for: groups of up to three strips have no other branch."""
    rows: list[list[str | float]] = []
    for kind in SAMPLE:
        for condition in (EXACT, CAMERA):
            found = []
            for name in scenes.FAMILIES[kind]:
                progress(f"vanished strips: {name}, {condition.name}")
                frames = named_frames(name, held_out(1)[0], condition)
                model = model_of(frames, extractor_of(params_of("paper")), keep_strips=True)
                if model.strips is not None and model.strips.support_px.sum():
                    s = score(frames[-1], rays_under(frames[-1], condition, Params()), model.planes.astype(np.float64))
                    found.append((1.0 - model.support_px.sum() / model.strips.support_px.sum(), s.missed))
            lost, missed = ([float(v) for v in column] for column in zip(*found, strict=True))
            rows.append([kind, condition.name, 100.0 * middle(lost), 100.0 * max(lost), 100.0 * middle(missed)])
    return Finding(
        name="vanished",
        title="Algorithm 2: pixels of strips in groups of up to three that vanish",
        head=["scenes", "depth", "vanish, %", "worst, %", "rays missed, %"],
        digits=[0, 0, 1, 1, 2],
        rows=rows,
        words=2,
    )


def threshold() -> Finding:
    """The fit threshold between 0.1 and 0.3 m in ours: planes and error."""
    rows: list[list[str | float]] = []
    for kind, names in SAMPLE.items():
        for tolerance in (0.1, 0.12, 0.2, 0.3):
            planes, errors, missed = [], [], []
            for name in names:
                progress(f"fit threshold: {name}, {tolerance:g} m")
                frames = named_frames(name, held_out(1)[0], CAMERA)
                params = Params(line_tolerance_m=tolerance)
                model = model_of(frames, Extractor(params))
                s = score(frames[-1], rays_under(frames[-1], CAMERA, params), model.planes.astype(np.float64))
                planes.append(float(s.planes))
                errors.append(s.mean_m)
                missed.append(s.missed)
            rows.append([kind, tolerance, middle(planes), middle(errors), 100.0 * max(missed)])
    return Finding(
        name="threshold",
        title="The fit threshold, in ours: medians of three frames",
        head=["scenes", "threshold, m", "planes", "error, m", "missed, % (worst)"],
        digits=[0, 2, 0, 3, 2],
        rows=rows,
        words=1,
    )


def findings(quick: bool) -> list[Finding]:
    """All experiments of this file; quick: without those that need many frames."""
    short = [open_ground(), beam()]
    return short if quick else [*short, vanished(), threshold()]
