"""The merged world of each golden stream, in a form for reading; `make golden` writes it anew beside the streams' results."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from companion.config.loader import Config
from companion.live.world_thread import observation_of
from companion.pipeline.configured import make_pipeline
from companion.pipeline.results import PrismsResult
from companion.replay.replay import process
from companion.replay.summary import ReplayCounts
from core.world.serialize import bytes_of
from core.world.world import Observation, World
from drivers.logs.reader import McapRecording

from .golden import DATA, STREAMS, Result, made_with, recording_path

WORLDS = DATA / "golden" / "worlds.json"
ELSEWHERE = 0.1
"""On another kind of processor: share by which the counts may differ."""


def observations_of(path: Path) -> list[Observation]:
    """What the world takes of a log: its frames with a position."""
    with McapRecording(path) as recording:
        pipeline = make_pipeline(Config(), recording.cameras)
        results = [o for _, outputs in process(recording.events(), pipeline, ReplayCounts()) for o in outputs]
    observations = [observation_of(o) for o in results if isinstance(o, PrismsResult)]
    return [s for s in observations if s is not None]


def merged(observations: list[Observation]) -> World:
    """The world of a flight."""
    world = World()
    for observation in observations:
        world.add(observation)
    return world


def world_bytes(world: World) -> bytes:
    """All that is known at its newest frame: planes with moments, and free space."""
    newest_ns = 0 if world.section is None else world.section.newest_ns
    picture = world.picture(newest_ns)
    ground = b"" if picture.ground is None else picture.ground.tobytes()
    return bytes_of(world.saved()) + picture.blocks.tobytes() + picture.masks.tobytes() + ground


def worlds() -> Result:
    """Of each stream: counts, each plane in centimetres with its number of observations, a digest of all of it."""
    found: Result = {"made_with": made_with()}
    for name in STREAMS:
        world = merged(observations_of(recording_path(name)))
        numbers = world.numbers()
        picture = world.picture(0 if world.section is None else world.section.newest_ns)
        found[name] = {
            "frames": numbers["frames"],
            "planes": len(picture.planes),
            "joined": numbers["joined"],
            "free_cells": int(np.unpackbits(picture.masks.view(np.uint8)).sum()),
            "digest": hashlib.sha256(world_bytes(world)).hexdigest()[:16],
            "rows": [
                [*np.rint(100.0 * row.astype(np.float64)).astype(int).tolist(), int(hits)]
                for row, hits in zip(picture.planes, picture.hits, strict=True)
            ],
        }
    return found


def dumps(found: Result) -> str:
    """Indented JSON, each plane on a line of its own."""
    text = json.dumps(found, indent=1)
    return (
        re.sub(r"\[\s+(-?\d+(?:,\s+-?\d+)*)\s+\]", lambda m: "[" + re.sub(r"\s+", " ", m.group(1)) + "]", text) + "\n"
    )


def load() -> Result:
    """The golden worlds."""
    return dict(json.loads(WORLDS.read_text()))


def differences(golden: Result, now: Result) -> Iterator[str]:
    """What is not as it should be, in words. Exact where both were made with the same."""
    exact = golden["made_with"] == now["made_with"]
    for name in STREAMS:
        before, after = golden.get(name, {}), now[name]
        for key in ("frames", "planes", "joined", "free_cells", "digest"):
            one, other = before.get(key), after[key]
            if exact or one is None or key == "frames":
                differs = one != other
            elif key == "digest":
                differs = False
            else:
                differs = abs(one - other) > max(2, ELSEWHERE * one)
            if differs:
                yield f"{name}: {key}: {one} -> {other}"
        if exact and before:
            old, new = (sorted(map(tuple, rows)) for rows in (before["rows"], after["rows"]))
            yield from (f"{name}: plane gone {row} cm, observations" for row in old if row not in new)
            yield from (f"{name}: plane new {row} cm, observations" for row in new if row not in old)
