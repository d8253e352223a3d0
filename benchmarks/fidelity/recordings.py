"""Evaluates recorded images: time, planes, ground, and the share of a frame's model that the next frame repeats.

`python -m benchmarks --only recordings`. The recordings are beside the checkout and not part of it; without them the
page says so."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.fidelity.recorded_directions import HALF_HEIGHT_M, TO_M, count_recording
from benchmarks.fidelity.stability import BORDER_PX, STEP_M, Found, Seen, found_again
from benchmarks.hardware_info import CHECKOUT
from benchmarks.paper.plots import figure, label
from benchmarks.speed.tables import table
from companion.bench.timing import Clock, Times, one_core
from companion.config.loader import Config, load_config
from companion.importers.folder import open_folder
from companion.importers.report import ImportOptions, Report
from companion.pipeline.configured import effective_cameras
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_quaternion
from core.types import CameraInfo, ExtractorState, FrameModel

DATA: Final = CHECKOUT.parent / "shared" / "data"
RECORDINGS: Final = (
    ("rs_d435_handheld", "indoor.toml", "RealSense D435, hand-carried through a workshop, 10 Hz"),
    ("o3d_livingroom_sim", "indoor.toml", "a photoreal simulated living room, 30 Hz"),
    ("cape_tunnel", "default.toml", "one frame of a corridor"),
)
"""Folder, configuration in configs/, description."""
REACHES_M: Final = (0.1, 0.2, 0.3, 0.5)
MAIN_REACH_M: Final = 0.3
ROUNDS, QUICK_ROUNDS = 4, 2
"""Number of passes over a recording; the first one is a warm-up."""


class TimedExtractor:
    """An extractor whose calls are timed."""

    def __init__(self, extractor: Extractor, clock: Clock) -> None:
        self._extractor, self._clock = extractor, clock
        self.open_sky = extractor.open_sky

    def extract(
        self,
        depth: Any,
        info: CameraInfo,
        R_level_optical: Any,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        """As the extractor's."""
        result: tuple[FrameModel, ExtractorState] = self._clock.run(
            lambda: self._extractor.extract(depth, info, R_level_optical, state, keep_strips=keep_strips)
        )
        return result


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Flown:
    """A recording and what became of it. results: one a frame; again, before: by reach, what of
    a frame is found in the next one, and what of that one was there before; one a pair of frames that can be compared."""

    name: str
    words: str
    info: CameraInfo
    results: list[PrismsResult]
    times: Times
    again: dict[float, list[Found]]
    before: dict[float, list[Found]]

    def models(self) -> list[FrameModel]:
        """The models of the valid frames."""
        return [r.model for r in self.results if r.valid and r.model is not None]


def section(out: Path, quick: bool, data: Path = DATA) -> str:
    """The Markdown of the page; its pictures go to `out`."""
    there = [r for r in RECORDINGS if (data / r[0]).is_dir()]
    if not there:
        return "No recordings lie beside this checkout (`../shared/data`), so there is nothing to tell.\n"
    with one_core():
        flown = [
            fly(data / name, name, words, config, QUICK_ROUNDS if quick else ROUNDS) for name, config, words in there
        ]
    pictures = []
    for f in flown:
        if len(f.results) > 20:
            draw(out / f"recording_{f.name}.png", f)
            pictures.append(f"![{f.words}: time, planes, share found again](recording_{f.name}.png)\n")
    return "\n".join([summary(flown), *tables(flown), *free_directions(there, data), *pictures])


def fly(folder: Path, name: str, words: str, config_name: str, rounds: int) -> Flown:
    """Models a recording some times over; of the last round the results are kept, of all but the first the times."""
    config = load_config(CHECKOUT / "configs" / config_name)
    clock = Clock()
    for i in range(rounds):
        print(f"recordings: {name}, {i + 1}/{rounds}", file=sys.stderr, flush=True)
        clock = Clock() if i <= 1 else clock
        infos, results = _round(folder, config, clock)
    pairs = comparable(results, infos[0])
    again = {reach: [found_again(a, b, reach) for a, b in pairs] for reach in REACHES_M}
    before = {reach: [found_again(b, a, reach) for a, b in pairs] for reach in REACHES_M}
    return Flown(
        name=name, words=words, info=infos[0], results=results, times=clock.times(), again=again, before=before
    )


def _round(folder: Path, config: Config, clock: Clock) -> tuple[tuple[CameraInfo, ...], list[PrismsResult]]:
    report = Report()
    source = open_folder(folder, ImportOptions(camera=config.camera("front"), use_tlog=False), report)
    infos = effective_cameras(config, source.cameras)
    pipeline = Pipeline(
        infos,
        lambda info: TimedExtractor(Extractor(config.extractor), clock),
        config.sync,
        mount_check=config.mount_check,
    )
    outputs = [output for event in source.events() for output in pipeline.handle(event)]
    for problem in report.all_problems():
        print(f"recordings: {problem}", file=sys.stderr)
    return infos, [output for output in outputs if isinstance(output, PrismsResult)]


def comparable(results: Sequence[PrismsResult], info: CameraInfo) -> list[tuple[Seen, Seen]]:
    """Adjacent valid frames with known positions."""
    seen = [seen_of(r, info) for r in results]
    return [(a, b) for a, b in pairwise(seen) if a is not None and b is not None]


def seen_of(result: PrismsResult, info: CameraInfo) -> Seen | None:
    """A result in ned with its camera; None: it is invalid or its position is unknown. For cameras aligned with the
    vehicle's axes, as in the recordings."""
    if (
        not result.valid
        or result.frame != "ned"
        or result.model is None
        or result.transform is None
        or result.attitude is None
    ):
        return None
    R = rotation_from_quaternion(result.attitude.q_ned_frd_wxyz) @ R_CAMFRD_OPTICAL
    return Seen(
        planes=result.model.planes.astype(np.float64),
        info=info,
        R_ned_optical=R,
        position_m=np.array(result.transform.translation_m),
    )


def summary(flown: Sequence[Flown]) -> str:
    """A paragraph for the index."""
    said = []
    for f in flown:
        planes = np.median([len(m.planes) for m in f.models()]) if f.models() else 0
        found = [x.by_area for x in f.again[MAIN_REACH_M] if x.area_m2 > 0.0]
        again = (
            f", {100 * np.mean(found):.0f} % of a frame's model found again in the next within {MAIN_REACH_M:g} m"
            if found
            else ""
        )
        said.append(f"{f.words}: {f.times.cpu():.1f} ms a frame, {planes:.0f} planes{again}")
    return "Images that the simulator of this project did not make. " + "; ".join(said) + ".\n"


def tables(flown: Sequence[Flown]) -> list[str]:
    """What each recording came to, and how much of a frame is found again."""
    rows = [[f.words, *_figures(f)] for f in flown]
    head = ["recording", "image", "frames", "that say something", "ms, median", "p99", "wall: median", "planes (least..most)", "prisms",
            "ground seen in", "ground, share of the measured pixels"]  # fmt: skip
    parts = [
        "## Time, planes, ground\n",
        "Milliseconds of the processor, one thread; planes, prisms and shares are medians.\n",
        table(head, rows),
    ]
    compared = [f for f in flown if f.again[MAIN_REACH_M]]
    if not compared:
        return parts
    again = [
        [f.words, f"{len(f.again[reach])}", f"{reach:g}", *_shares(f.again[reach]), *_shares(f.before[reach])[:2]]
        for f in compared
        for reach in REACHES_M
    ]
    return [
        *parts,
        "## What of one frame is found again in the next\n",
        f"The planes of a frame, set into the world by the recorded attitude and position, are covered with points {STEP_M:g} m apart. Asked are "
        f"those that the next exposure has in its image ({BORDER_PX:g} px off the border) and range; found again is a point with a plane of the "
        "next model within the distance in the table. By area a square metre counts as one wherever it is; by view it counts as large as it looks. "
        "Errors of the recorded poses, and what nearer things hide, count against it. *Was there before* asks the same of the next frame's model in this one's. "
        "Mean over pairs of frames, and the tenth that is worst.\n",
        table(
            [
                "recording",
                "pairs",
                "within, m",
                "by area",
                "worst tenth",
                "by view",
                "worst tenth",
                "was there before, by area",
                "worst tenth",
            ],
            again,
        ),
    ]


def free_directions(recordings: Sequence[tuple[str, str, str]], data: Path) -> list[str]:
    """How many of the free directions of each recording are called free, with the default configuration and that of rooms."""
    rows = []
    for name, _, words in recordings:
        for config in ("default.toml", "indoor.toml"):
            c = count_recording(data / name, CHECKOUT / "configs" / config)
            share = f"{100 * c.called / c.truly_free:.1f} %" if c.truly_free else ""
            rows.append([words, config, str(c.frames), str(c.truly_free), share, str(c.wrong)])
    return [
        "## Free directions\n",
        f"A direction is truly free if something is measured within {HALF_HEIGHT_M:g} m above and below the camera, and nothing nearer than {TO_M:g} m. "
        f"*Called free*: up to {TO_M:g} m in the layer at the camera's height. *Wrong*: a measured point lies in what is called free. "
        "The default configuration closes openings that are narrower than 2 m, that of rooms those narrower than 0.6 m.\n",
        table(["recording", "configuration", "frames", "truly free directions", "called free", "wrong"], rows),
    ]


def _figures(f: Flown) -> list[str]:
    k, models = f.info.intrinsics, f.models()
    counts = [len(m.planes) for m in models]
    seen = [m.ground.share for m in models if m.ground.seen]
    planes = f"{np.median(counts):.0f} ({min(counts)}..{max(counts)})" if counts else ""
    return [
        f"{k.width}x{k.height}",
        str(len(f.results)),
        str(len(models)),
        f"{f.times.cpu():.2f}",
        f"{f.times.cpu(99):.2f}",
        f"{f.times.wall():.2f}",
        planes,
        f"{np.median([len(m.prisms) for m in models]):.0f}" if models else "",
        str(len(seen)),
        f"{100 * np.median(seen):.0f} %" if seen else "",
    ]


def _shares(found: Sequence[Found]) -> list[str]:
    cells = []
    for shares in ([f.by_area for f in found if f.area_m2 > 0.0], [f.by_view for f in found if f.area_m2 > 0.0]):
        cells += [f"{100 * np.mean(shares):.1f} %", f"{100 * np.quantile(shares, 0.1):.1f} %"] if shares else ["", ""]
    return cells


def draw(path: Path, f: Flown) -> None:
    """Time, planes and the share found again over the frames."""
    with figure(path, 1, 3, 11.0, 3.2) as axes:
        time, planes, again = axes[0]
        frames = len(f.results)
        time.plot(f.times.cpu_ms[-frames:], linewidth=1)
        time.set_ylim(bottom=0.0)
        label(time, "Time of a frame", "frame", "ms of the processor")
        planes.plot([len(r.model.planes) if r.model is not None else 0 for r in f.results], linewidth=1)
        planes.set_ylim(bottom=0.0)
        label(planes, "Planes", "frame", "planes")
        for reach in REACHES_M:
            again.plot([100 * x.by_area for x in f.again[reach]], linewidth=1, label=f"within {reach:g} m")
        again.set_ylim(0.0, 102.0)
        label(again, "Found again in the next frame", "frame", "% of the area")
