"""Functions shared by the three panels of a picture."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel, PlaneFlags

from .colors import FAR_RGB, UNKNOWN_RGB, palette, range_index
from .frame import FrameStatus, ViewFrame
from .geometry import nearest_m

UNKNOWN_COLOR = tuple(c / 255 for c in UNKNOWN_RGB)
UNKNOWN_AREA_COLOR = tuple(0.35 * c + 0.65 for c in UNKNOWN_COLOR)
"""Of space about which nothing is known."""
FAR_COLOR = tuple(c / 255 for c in FAR_RGB)
FREE_COLOR = "#c8e6c9"
OPEN_COLOR = "#fff59d"
"""Presumed free without a measurement."""
GROUND_COLOR = "#795548"
RING_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)


def begin_panel(ax: Any, frame: ViewFrame, title: str) -> FrameModel | None:
    """Draws the title of a panel that shows the model, and returns the model; None: the panel says why there is none."""
    ax.set_title(title, fontsize=12, loc="left")
    missing = model_missing(frame)
    if frame.model is None or missing:
        nothing_to_draw(ax, missing, blind=frame.status is FrameStatus.BLIND)
        return None
    ax.set_facecolor(UNKNOWN_AREA_COLOR)
    return frame.model


def name_axes(ax: Any, x: str, y: str) -> None:
    """Draws the names of both axes, in metres."""
    ax.set_xlabel(f"{x} of the camera, m", fontsize=9)
    ax.set_ylabel(f"{y} the camera, m", fontsize=9)
    ax.tick_params(labelsize=8)


def draw_legend(ax: Any, marks: Sequence[tuple[Any, str]], corner: tuple[float, float], columns: int) -> None:
    """Draws the legend below a panel. marks: symbol and text of each entry; corner: upper left corner of the legend, as
    shares of the panel."""
    ax.legend(
        *zip(*marks, strict=True),
        loc="upper left",
        bbox_to_anchor=corner,
        ncols=columns,
        fontsize=8.5,
        frameon=False,
        borderaxespad=0.2,
        handlelength=1.8,
        columnspacing=1.2,
    )


def nothing_to_draw(ax: Any, text: str, *, blind: bool = False) -> None:
    """Fills an empty panel with a text."""
    ax.set_facecolor("#f6d5d5" if blind else "#d9d9d9")
    ax.set_xticks([])
    ax.set_yticks([])
    ax.text(
        0.5,
        0.5,
        wrapped(text),
        transform=ax.transAxes,
        ha="center",
        va="center",
        fontsize=13,
        color="#b71c1c" if blind else "#404040",
        parse_math=False,  # causes in logs may contain $
    )


def wrapped(text: str, columns: int = 46) -> str:
    """The text in lines that fit the narrowest panel."""
    return "\n".join(line for part in text.splitlines() for line in textwrap.wrap(part, columns))


def model_missing(frame: ViewFrame) -> str:
    """Why there is no model to draw, as text; "" if there is one."""
    if frame.status is FrameStatus.BLIND:
        return f"BLIND: {frame.cause}\ndo not treat any direction as free"
    return "no prisms in this log:\nrun `companion replay` first" if frame.model is None else ""


def plane_rgb(frame: ViewFrame, planes: NDArray[np.float32]) -> NDArray[np.float64]:
    """(N, 3) colours 0..1 of planes by the horizontal distance of their nearest point, on the common scale."""
    return np.asarray(palette()[range_index(nearest_m(planes), frame.info)] / 255.0)


def inferred(flags: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(N,) bool: whether a part of the plane was not measured."""
    return np.asarray((flags & np.uint8(PlaneFlags.INFERRED)) != 0)


def far_to_near(planes: NDArray[np.float32]) -> NDArray[np.intp]:
    """(N,) indices in drawing order: far planes first."""
    return np.argsort(-nearest_m(planes), kind="stable")


def line_width(n: int, few: float) -> float:
    """Line width in points for n planes: `few` for up to a handful, half of it for many."""
    return few * min(1.0, max(0.5, 1.2 - 0.01 * n))


def extent_m(frame: ViewFrame) -> float:
    """Forward extent of the panels: the planes plus a margin, at most the camera's range plus a margin."""
    reach = [4.0]
    if frame.model is not None and frame.model.valid:
        planes = frame.model.planes
        if len(planes):
            reach.append(float(np.percentile(np.maximum(planes[:, 0], planes[:, 2]), 98)))
        reach.append(min(2.0 * reach[-1], float(np.max(frame.model.free.free_to_m, initial=0.0))))
    else:
        reach.append(0.5 * frame.info.max_range_m)
    return 1.08 * min(max(reach), frame.info.max_range_m)
