"""Pictures of the paper's experiments: one look for all, figures that close themselves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

COLORS = {
    "safe": "#1f77b4",
    "paper": "#d62728",
    "skip": "#7f7f7f",
    "printed": "#000000",
    "grid 0.1 m": "#2ca02c",
    "grid 0.2 m": "#6abf6a",
    "grid 0.4 m": "#e6a23c",
    "grid 0.8 m": "#e67e22",
}
WORDS = {"safe": "ours (safe)", "paper": "as printed (paper)"}
SERIES = ("#1f77b4", "#e67e22", "#2ca02c", "#9467bd", "#d62728", "#7f7f7f")


def words(method: str) -> str:
    """What a method is called in a legend."""
    return WORDS.get(method, method)


@contextmanager
def figure(path: Path, rows: int, columns: int, width: float = 9.0, height: float = 3.8) -> Iterator[Any]:
    """(rows, columns) axes, saved to `path` as PNG when the block ends well."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    made, axes = pyplot.subplots(rows, columns, figsize=(width, height), squeeze=False)
    try:
        yield axes
        made.tight_layout()
        made.savefig(path, dpi=100)
    finally:
        pyplot.close(made)


def label(ax: Any, title: str, x: str, y: str, legend: bool = True) -> None:
    """Title and axes with their units, a light grid."""
    ax.set_title(title, fontsize=9, loc="left")
    ax.set_xlabel(x, fontsize=8)
    ax.set_ylabel(y, fontsize=8)
    ax.tick_params(labelsize=8)
    ax.grid(alpha=0.3, linewidth=0.6)
    if legend and ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=7)
