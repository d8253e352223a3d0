"""The pictures of the speed page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.paper.plots import figure, label
from benchmarks.speed.tables import Timed
from companion.bench.frames import Measured
from companion.bench.stage_trace import in_order

_WIDTH_IN, _HEIGHT_IN = 9.0, 3.8
_LIMITS = (("structured: must", 4.0, "#1f77b4"), ("foliage: must", 8.0, "#2ca02c"))


def draw_curves(
    path: Path,
    sizes: dict[str, list[tuple[tuple[int, int], Measured]]],
    crowds: dict[str, list[Measured]],
) -> None:
    """Time over the number of pixels and over the number of strips, one line a series."""
    with figure(path, 1, 2, _WIDTH_IN, _HEIGHT_IN) as axes:
        left, right = axes[0]
        for name, points in sizes.items():
            pixels = [1e-3 * width * height for (width, height), _ in points]
            left.plot(pixels, [m.times.cpu() for _, m in points], "o-", markersize=3, label=name)
        left.set_xlim(left=0.0)
        left.set_ylim(bottom=0.0)
        label(left, "Over the size of the image", "thousand pixels", "ms a frame, median")
        for name, measured in crowds.items():
            right.plot([m.strips for m in measured], [m.times.cpu() for m in measured], "o-", markersize=3, label=name)
        right.set_ylim(bottom=0.0)
        label(right, "Over the number of strips, 640x480", "strips in the frame", "ms a frame, median")


def draw_stages(path: Path, columns: Sequence[Measured]) -> None:
    """Draws a bar per kind of frame, divided by stage."""
    with figure(path, 1, 1, _WIDTH_IN, _HEIGHT_IN + 0.6) as axes:
        ax = axes[0][0]
        begin = [0.0] * len(columns)
        rows = range(len(columns))
        for i, stage in enumerate([*in_order(s for m in columns for s in m.stages_ms), "between the stages"]):
            ms = [m.rest_ms() if stage == "between the stages" else m.stages_ms.get(stage, 0.0) for m in columns]
            ax.barh(rows, ms, left=begin, label=stage, color=_color(i))
            begin = [b + x for b, x in zip(begin, ms, strict=True)]
        ax.set_yticks(rows, [m.name for m in columns])
        ax.invert_yaxis()
        label(ax, "Where the time goes, 640x480", "ms of the processor, medians of the stages", "", legend=False)
        ax.legend(fontsize=6.5, ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _color(index: int) -> Any:
    from matplotlib import colormaps

    return colormaps["tab20"](index % 20)


def draw_kinds(path: Path, timed: Sequence[Timed]) -> None:
    """Median and 99th percentile of every kind, a row a kind, a colour a noise; what must be reached as lines."""
    kinds = list(dict.fromkeys(t.kind for t in timed))
    noises = sorted({t.ke_per_m for t in timed})
    with figure(path, 1, 1, _WIDTH_IN, _HEIGHT_IN) as axes:
        ax = axes[0][0]
        for i, ke in enumerate(noises):
            mine = {t.kind: t for t in timed if t.ke_per_m == ke}
            rows = [kinds.index(kind) + 0.2 * (2 * i - len(noises) + 1) for kind in mine]
            ax.hlines(
                rows, [t.p50() for t in mine.values()], [t.p99() for t in mine.values()], color=f"C{i}", linewidth=2
            )
            ax.plot(
                [t.p50() for t in mine.values()], rows, "o", color=f"C{i}", markersize=5, label=f"median, ke {ke:g}"
            )
            ax.plot(
                [t.p99() for t in mine.values()],
                rows,
                "|",
                color=f"C{i}",
                markersize=8,
                label=f"99th percentile, ke {ke:g}",
            )
        for words, ms, color in _LIMITS:
            ax.axvline(ms, color=color, linestyle="--", linewidth=1, label=f"{words}, {ms:g} ms")
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
        ax.set_yticks(range(len(kinds)), [kind.name for kind in kinds])
        ax.invert_yaxis()
        label(ax, "Every kind of frame, 640x480", "ms of the processor", "")
