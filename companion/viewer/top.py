"""The top panel: the scene from above in level_cam, forward up, the camera at the origin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel

from ..config.obstacle_range import obstacle_range_m
from .frame import ViewFrame
from .geometry import field_of_view_rad, free_normals, layer_at, level_range_m
from .panel import (
    FREE_COLOR,
    OPEN_COLOR,
    RING_M,
    UNKNOWN_AREA_COLOR,
    begin_panel,
    draw_legend,
    extent_m,
    far_to_near,
    inferred,
    line_width,
    name_axes,
    plane_rgb,
)

CAMERA_LAYER_M = 0.0
"""Height (z, down) at which the free profile is drawn: that of the camera."""


def draw_top(ax: Any, frame: ViewFrame) -> None:
    """Draws the panel."""
    model = begin_panel(ax, frame, "Top view (forward is up)")
    if model is None:
        return
    half_width, forward, behind = _limits(ax, frame, model)
    ax.set_aspect("equal")
    ax.set_xlim(-half_width, half_width)
    ax.set_ylim(-behind, forward)
    name_axes(ax, "right", "forward of")
    layer = _free(ax, model)
    _rings_and_view(ax, frame, model, forward)
    _planes(ax, frame, model, 0.015 * (forward + behind))
    ax.plot([0], [0], marker="^", markersize=11, color="black", zorder=8)
    _legend(ax, model, layer)


def _limits(ax: Any, frame: ViewFrame, model: FrameModel) -> tuple[float, float, float]:
    """(half width, forward, behind) in metres that fit the planes into the panel's proportions."""
    box = ax.get_position()
    figure_w, figure_h = ax.figure.get_size_inches()
    proportion = (box.width * figure_w) / (box.height * figure_h)
    forward = extent_m(frame)
    lateral = 2.0
    if len(model.planes):
        lateral = float(np.percentile(np.abs(model.planes[:, (1, 3)]).max(axis=1), 98))
    height = max(forward * 1.08, 2.15 * min(lateral, 1.2 * frame.info.max_range_m) / proportion)
    return height * proportion / 2, height * 0.94, height * 0.06


def _free(ax: Any, model: FrameModel) -> str:
    """Fills the open and the free space at the camera's height; returns its layer as text, "" if there is none."""
    layer = layer_at(model.free, CAMERA_LAYER_M)
    if layer is None:
        return ""
    f = model.free
    if f.has_open:
        _sectors(ax, model, (f.open_from_m[:, layer], f.open_to_m[:, layer]), OPEN_COLOR, zorder=0.9)
    _sectors(ax, model, (f.free_from_m[:, layer], f.free_to_m[:, layer]), FREE_COLOR, zorder=1.0)
    top, bottom = f.layer_edges_m[layer : layer + 2]
    return f"{-bottom:+.2f} .. {-top:+.2f} m"


def _sectors(
    ax: Any, model: FrameModel, ranges_m: tuple[NDArray[np.float32], NDArray[np.float32]], color: str, zorder: float
) -> None:
    """Fills each direction of the profile from ranges_m[0] to ranges_m[1], each (D,), above the ground."""
    from matplotlib.collections import PolyCollection

    edges, near = model.free.azimuth_edges_rad.astype(np.float64), ranges_m[0].astype(np.float64)
    clear = level_range_m(model.ground, edges)
    far = np.minimum(ranges_m[1], np.minimum(clear[:-1], clear[1:]))
    left = np.stack([np.sin(edges[:-1]), np.cos(edges[:-1])], axis=1)
    right = np.stack([np.sin(edges[1:]), np.cos(edges[1:])], axis=1)
    known = far > near
    quads = np.stack([left * near[:, None], left * far[:, None], right * far[:, None], right * near[:, None]], axis=1)[
        known
    ]
    ax.add_collection(PolyCollection(list(quads), facecolors=color, edgecolors=color, linewidths=0.3, zorder=zorder))


def _rings_and_view(ax: Any, frame: ViewFrame, model: FrameModel, forward: float) -> None:
    """Draws range rings and the edges of the field of view."""
    from matplotlib.patches import Arc

    R = frame.R_level_cam_optical
    left, right = (-math.pi, math.pi) if R is None else field_of_view_rad(frame.info.intrinsics, R)
    for radius in (r for r in RING_M if r <= 1.5 * forward):
        ax.add_patch(Arc((0, 0), 2 * radius, 2 * radius, color="#757575", linewidth=0.7, linestyle=":", zorder=2))
        if 0.06 * forward < radius < 0.98 * forward:
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
            at = min(right + 0.09, 1.2)
            ax.text(
                radius * math.sin(at),
                radius * math.cos(at),
                f"{radius:g} m",
                fontsize=8,
                color="#424242",
                ha="center",
                va="center",
                bbox=box,
                zorder=7,
                clip_on=True,
            )
    found = 2 * obstacle_range_m(frame.info, model.ke_per_m)
    line: dict[str, Any] = {"color": "#1565c0", "linewidth": 1.1, "zorder": 3}
    ax.add_patch(Arc((0, 0), found, found, theta1=90 - math.degrees(right), theta2=90 - math.degrees(left), **line))
    if right - left < 2 * math.pi:
        reach = frame.info.max_range_m
        for azimuth in (left, right):
            ax.plot([0, reach * math.sin(azimuth)], [0, reach * math.cos(azimuth)], linestyle="-.", **line)


def _planes(ax: Any, frame: ViewFrame, model: FrameModel, tick_m: float) -> None:
    """Draws planes with free side and margin; those at the camera's height are thick."""
    from matplotlib.collections import LineCollection, PolyCollection

    if not len(model.planes):
        return
    order = far_to_near(model.planes)
    p = model.planes[order].astype(np.float64)
    colors, dashed = plane_rgb(frame, model.planes)[order] * 0.85, inferred(model.flags)[order]
    a, b, normal = p[:, (1, 0)], p[:, (3, 2)], free_normals(model.planes)[order][:, ::-1]
    offset = normal * model.margin_m[order].astype(np.float64)[:, None]
    bands = list(np.stack([a, b, b + offset, a + offset], axis=1))
    ax.add_collection(PolyCollection(bands, facecolors="#ef6c00", alpha=0.28, edgecolors="none", zorder=4))
    level = (p[:, 4] <= CAMERA_LAYER_M) & (p[:, 5] >= CAMERA_LAYER_M)
    styles = [(0, (3, 1.8)) if d else "-" for d in dashed]
    lines = list(np.stack([a, b], axis=1))
    width = line_width(len(p), 3.2)
    widths = np.where(level, width, 0.4 * width)
    casing = widths + 1.2
    ax.add_collection(LineCollection(lines, colors="black", linewidths=casing, alpha=0.55, capstyle="butt", zorder=5))
    ax.add_collection(
        LineCollection(lines, colors=colors, linewidths=widths, linestyles=styles, capstyle="butt", zorder=6)
    )
    middle = (a + b) / 2
    ticks = list(np.stack([middle, middle + normal * tick_m], axis=1))
    ax.add_collection(LineCollection(ticks, colors="black", linewidths=0.9, zorder=6))


def _legend(ax: Any, model: FrameModel, layer: str) -> None:
    """Draws the legend below the panel."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marks = [
        (Line2D([], [], color="#404040", linewidth=3.2), "plane at camera height"),
        (Line2D([], [], color="#404040", linewidth=1.3), "plane above or below camera height"),
        (Line2D([], [], color="black", marker="$\\vdash$", linestyle="none", markersize=8), "tick: its free side"),
        (Patch(facecolor="#ef6c00", alpha=0.4), "its margin"),
        (Patch(facecolor=FREE_COLOR), f"free at camera height ({layer})" if layer else "no free profile"),
        (Patch(facecolor=UNKNOWN_AREA_COLOR), "unknown"),
        (Line2D([], [], color="#1565c0", linewidth=1.1, linestyle="-."), "field of view"),
        (Line2D([], [], color="#1565c0", linewidth=1.1), "obstacle range"),
    ]
    if model.free.has_open:
        marks.append((Patch(facecolor=OPEN_COLOR), "open: presumed free, not measured"))
    if inferred(model.flags).any():
        marks.append((Line2D([], [], color="#404040", linewidth=2, linestyle=(0, (3, 1.8))), "partly inferred"))
    draw_legend(ax, marks, (-0.06, -0.05), 3)
