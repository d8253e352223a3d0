"""The depth panel: the depth image with strips and plane outlines projected into it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel, StripTable

from .colors import FIRST, LAST, depth_rgb, index_range_m, palette
from .frame import ViewFrame
from .geometry import nearest_m, outline_px, plane_corners_m
from .panel import (
    FAR_COLOR,
    RING_M,
    UNKNOWN_COLOR,
    draw_legend,
    far_to_near,
    inferred,
    line_width,
    model_missing,
    nothing_to_draw,
    plane_rgb,
    wrapped,
)

LABELS = 8
"""Number of planes labelled with their distance, the largest in the image first."""


def draw_depth(ax: Any, scale_ax: Any, frame: ViewFrame) -> None:
    """Draws the panel and its colour scale."""
    ax.set_title("Depth image with the detected planes", fontsize=12, loc="left")
    if frame.depth_mm is None:
        nothing_to_draw(ax, "no depth image in this log")
        scale_ax.set_axis_off()
        return
    k = frame.info.intrinsics
    ax.imshow(depth_rgb(frame.depth_mm, frame.info, frame.ke_per_m), interpolation="nearest", aspect="equal")
    ax.set_xlim(-0.5, k.width - 0.5)
    ax.set_ylim(k.height - 0.5, -0.5)
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_anchor("W")
    drawn, model = ["unknown", "far"], frame.model
    if model is not None and model.valid:
        if model.strips is not None and len(model.strips.u):
            _strips(ax, frame, model.strips)
            drawn.append("strips")
        drawn.append("planes")
        drawn.extend(["inferred"] if inferred(model.flags).any() else [])
        _planes(ax, frame, model)
    else:
        _stamp(ax, model_missing(frame).splitlines()[0])
    _legend(ax, drawn)
    _scale(scale_ax, frame)


def _stamp(ax: Any, text: str) -> None:
    """Draws a text across the image when it contains no plane, to distinguish it from an image without results."""
    box = {"facecolor": "#c62828" if text.startswith("BLIND") else "#b26a00", "edgecolor": "none", "pad": 8}
    ax.text(
        0.5,
        0.5,
        wrapped(text, 38),
        transform=ax.transAxes,
        ha="center",
        va="center",
        fontsize=15,
        weight="bold",
        color="white",
        bbox=box,
        parse_math=False,  # causes in logs may contain $
    )


def strip_segments_px(strips: StripTable, frame: ViewFrame) -> list[NDArray[np.float64]]:
    """Line of each strip in source pixels, (M, 2) each; strips behind the camera are left out."""
    R = frame.R_level_cam_optical
    if R is None:
        return []
    ends = [
        np.array([[x, y, top], [x, y, bottom]], np.float64)
        for x, y, top, bottom in zip(strips.x_m, strips.y_m, strips.top_m, strips.bottom_m, strict=True)
    ]
    segments = [outline_px(e, R, frame.info.intrinsics) for e in ends]
    return [s for s in segments if len(s) >= 2]


def _strips(ax: Any, frame: ViewFrame, strips: StripTable) -> None:
    from matplotlib.collections import LineCollection

    alpha = min(0.35, 0.12 + 150 / len(strips.u))
    ax.add_collection(LineCollection(strip_segments_px(strips, frame), colors=[(1, 1, 1, alpha)], linewidths=0.7))


def plane_outlines_px(frame: ViewFrame) -> list[NDArray[np.float64]]:
    """Outline of each plane in source pixels, (M, 2) each; M = 0 behind the camera."""
    R = frame.R_level_cam_optical
    if frame.model is None or R is None:
        return []
    return [outline_px(c, R, frame.info.intrinsics) for c in plane_corners_m(frame.model.planes)]


def _planes(ax: Any, frame: ViewFrame, model: FrameModel) -> None:
    """Draws outlines, far ones first, each with a dark casing for contrast."""
    from matplotlib.patches import Polygon

    planes, outlines = model.planes, plane_outlines_px(frame)
    line = line_width(len(planes), 1.7)
    colors, dashed = plane_rgb(frame, planes), inferred(model.flags)
    for k in far_to_near(planes):
        if len(outlines[k]) < 3:
            continue
        style = (0, (4, 2.5)) if dashed[k] else "-"
        for color, width in (("black", 2.1 * line), (0.35 + 0.65 * colors[k], line)):
            patch = Polygon(outlines[k], closed=True, fill=False, edgecolor=color, linewidth=width, linestyle=style)
            ax.add_patch(patch)
    _labels(ax, frame, model, outlines)


def _labels(ax: Any, frame: ViewFrame, model: FrameModel, outlines: list[NDArray[np.float64]]) -> None:
    """Draws the distances of the largest planes without overlaps."""
    k, distance = frame.info.intrinsics, nearest_m(model.planes)
    limits = np.array([[0, 0], [k.width, k.height]])
    boxes = [np.clip([o.min(axis=0), o.max(axis=0)], *limits) if len(o) >= 3 else np.zeros((2, 2)) for o in outlines]
    sizes = [float(np.prod(b[1] - b[0])) for b in boxes]
    placed: list[NDArray[np.float64]] = []
    gap = np.array([0.085 * k.width, 0.045 * k.height])
    for i in np.argsort(sizes)[::-1]:
        center = boxes[i].mean(axis=0)
        if len(placed) >= LABELS or sizes[i] < 4e-4 * k.width * k.height:
            break
        if any(bool(np.all(np.abs(center - p) < gap)) for p in placed):
            continue
        if not bool(np.all((center > gap / 2) & (center < limits[1] - gap / 2))):
            continue
        placed.append(center)
        box = {"facecolor": (0, 0, 0, 0.62), "edgecolor": "none", "pad": 1.5}
        ax.text(*center, f"{distance[i]:.1f} m", fontsize=9, color="white", ha="center", va="center", bbox=box)


def _legend(ax: Any, drawn: list[str]) -> None:
    """Draws the legend below the image."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marks = {
        "unknown": (Patch(facecolor=UNKNOWN_COLOR, hatch="////", edgecolor="#606060"), "no measurement: unknown"),
        "far": (Patch(facecolor=FAR_COLOR, edgecolor="#909090"), "free to the maximum range"),
        "strips": (Line2D([], [], color="#9e9e9e", linewidth=1), "strip"),
        "planes": (Line2D([], [], color="#404040", linewidth=2.5), "plane, coloured by distance"),
        "inferred": (Line2D([], [], color="#404040", linewidth=2, linestyle=(0, (3, 2))), "partly inferred"),
    }
    draw_legend(ax, [marks[name] for name in drawn], (0.0, -0.01), len(drawn))


def _scale(ax: Any, frame: ViewFrame) -> None:
    """Draws the colour scale in metres, near at the bottom."""
    ax.imshow(palette()[FIRST : LAST + 1][:, None], aspect="auto", origin="lower", extent=(0, 1, FIRST, LAST))
    nearest, farthest = index_range_m(FIRST, frame.info), index_range_m(LAST, frame.info)
    ticks = [m for m in (0.5, *RING_M) if 1.15 * nearest < m < farthest / 1.15]
    span = np.log(farthest / nearest)
    marks = [(FIRST + (LAST - FIRST) * np.log(m / nearest) / span, f"{m:g} m") for m in (nearest, *ticks, farthest)]
    ax.set_yticks([y for y, _ in marks], [text for _, text in marks], fontsize=9)
    ax.set_xticks([])
    ax.yaxis.tick_right()
