"""Processor time of a frame in this checkout over that in another one, measured in turns.

Run `python -m benchmarks.speed.turns OTHER`, where OTHER is the directory of another checkout. A process of each
extracts the same frames on the same core, a few at a time. The ratio of each pair of turns cancels what the machine
does in the meantime. The last kind has another attitude in each frame, as in flight."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
KINDS = {
    "street, level": ("street", 0.0, 0.0, 0.0),
    "street, tilted": ("street", 10.0, -10.0, 0.0),
    "street, pitched down, moving": ("street", 0.0, -30.0, 1.0),
    "trees, level": ("trees", 0.0, 0.0, 0.0),
    "trees, tilted": ("trees", 10.0, -10.0, 0.0),
}
"""Name -> (scene, roll and pitch in degrees, amplitude of their change from image to image)."""
_IMAGES = 12


def render(kind: str) -> list[Any]:
    """Returns a FrameSequence with one image for each image of a kind; their noise differs."""
    from companion.bench.frames import render_sequence

    scene, roll, pitch, change = KINDS[kind]
    views = []
    for i in range(_IMAGES):
        roll_deg, pitch_deg = roll + change * math.sin(i), pitch + change * math.cos(i)
        view = render_sequence(kind, scene, (640, 480), roll_deg=roll_deg, pitch_deg=pitch_deg, images=i + 1)
        views.append(replace(view, depth_mm=view.depth_mm[-1:]))
    return views


def work() -> None:
    """Extracts frames on request: reads lines of JSON (kind, frames), and writes lines of JSON (processor time of each
    in ns, hash of the models and states)."""
    import_module("companion")  # before core: each checkout has a directory of its own for compiled kernels
    from core.extractor import Extractor
    from core.params import Params
    from core.types import ExtractorState

    extractor, views = Extractor(Params()), dict[str, list[Any]]()
    states, done = dict.fromkeys(KINDS, ExtractorState()), dict.fromkeys(KINDS, 0)
    for line in sys.stdin:
        kind, frames = json.loads(line)
        views[kind] = views.get(kind) or render(kind)
        times, digest = [], hashlib.sha256()
        for _ in range(frames):
            view = views[kind][done[kind] % _IMAGES]
            begun = time.thread_time_ns()
            model, states[kind] = extractor.extract(view.depth_mm[0], view.info, view.R_level_optical, states[kind])
            times.append(time.thread_time_ns() - begun)
            done[kind] += 1
            free = model.free
            for array in (model.planes, model.margin_m, model.flags, free.free_from_m, free.free_to_m, free.end):
                digest.update(array.tobytes())
            digest.update(repr((states[kind], model.ground)).encode())
        print(json.dumps((times, digest.hexdigest())), flush=True)


class Worker:
    """A process that extracts frames with the code of one checkout."""

    def __init__(self, checkout: Path, core: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(HERE), "--worker", str(core)],
            cwd=checkout,
            env={**os.environ, "PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def extract(self, kind: str, frames: int) -> tuple[list[int], str]:
        """Returns the processor time of each of the next frames, ns, and the hash of their results. Raises RuntimeError
        if the process has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps((kind, frames)), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the process in {self._process.args!r} has ended: see its message above")
        times, digest = json.loads(line)
        return times, digest

    def close(self) -> None:
        """Ends the process."""
        self._process.communicate()


def compare(old: Worker, new: Worker, kind: str, pairs: int, frames: int) -> str:
    """Returns a row of the table: ratios of new over old, medians in ms, and whether all results are equal."""
    for worker in (old, new):
        worker.extract(kind, _IMAGES)
    spent: tuple[list[list[int]], list[list[int]]] = ([], [])
    same = True
    for pair in range(pairs):
        turns = {}
        for k in (0, 1) if pair % 2 else (1, 0):
            times, turns[k] = (old, new)[k].extract(kind, frames)
            spent[k].append(times)
        same &= turns[0] == turns[1]
    before, after = 1e-6 * np.array(spent[0]), 1e-6 * np.array(spent[1])
    ratio = np.median(after.sum(1) / before.sum(1))
    medians = f"{np.median(before):.2f} | {np.median(after):.2f}"
    tails = " | ".join(f"{np.percentile(t, 99) / np.median(t):.2f}" for t in (before, after))
    return f"| {kind} | {medians} | {ratio:.3f} | {after.mean() / before.mean():.3f} | {tails} | {'yes' if same else 'no'} |"


def main(arguments: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.speed.turns", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("other", type=Path, help="directory of the other checkout, whose times are the divisor")
    parser.add_argument("--pairs", type=int, default=200, help="turns of each checkout and kind (200)")
    parser.add_argument("--frames", type=int, default=3, help="frames of a turn (3)")
    args = parser.parse_args(arguments)
    if not (args.other / "core" / "extractor.py").is_file():
        parser.error(f"{args.other}: no core/extractor.py in it; name the directory of a checkout")
    if min(args.pairs, args.frames) < 1:
        parser.error("--pairs, --frames: at least 1")
    core = max(os.sched_getaffinity(0))
    old, new = Worker(args.other.resolve(), core), Worker(HERE.parents[2], core)
    print("| frame | other, ms | this, ms | ratio of pairs | of means | p99 / median, other | this | same results |")
    print("|---|---:|---:|---:|---:|---:|---:|---|")
    for kind in KINDS:
        print(compare(old, new, kind, args.pairs, args.frames), flush=True)
    old.close()
    new.close()
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        os.sched_setaffinity(0, {int(sys.argv[2])})
        work()
    else:
        sys.exit(main())
