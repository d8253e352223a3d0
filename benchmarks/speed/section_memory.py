"""Whether memory grows over a hundred thousand frames; `python -m benchmarks --only memory`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.paper.plots import figure, label
from benchmarks.speed.memory import MIX, Sample, growth_words, measured, table

FRAMES, QUICK_FRAMES = 100_000, 1_000


def section(out: Path, quick: bool) -> str:
    """The Markdown of the page; its picture goes to `out`."""
    frames = QUICK_FRAMES if quick else FRAMES
    samples = measured(frames, frames // 100)
    draw(out / "memory.png", samples)
    return "\n".join(
        [
            f"{frames} frames in one process with one extractor. {growth_words(samples)}\n",
            "## Over the frames\n",
            f"The mix: {MIX}; drawn at random by a fixed seed, each frame handing on to the next. Buffers grow "
            "to the largest frame that came; frame 0 is after warm-up. Models are not kept.\n",
            "![Resident memory and what the extractor holds over the frames](memory.png)\n",
            table(samples),
        ]
    )


def draw(path: Path, samples: Sequence[Sample]) -> None:
    """Resident memory, and the arrays that the extractor holds, over the frames."""
    with figure(path, 1, 2, 9.0, 3.2) as axes:
        for ax, name, values in (
            (axes[0][0], "resident memory of the process", [s.resident / 1e6 for s in samples]),
            (axes[0][1], "arrays that the extractor holds", [s.held / 1e6 for s in samples]),
        ):
            ax.plot([s.frames for s in samples], values, linewidth=1)
            ax.set_ylim(0.0, 1.15 * max(values))
            label(ax, name[0].upper() + name[1:], "frames", "MB")
