"""The side panel: forward distance and height above the camera; all planes in one vertical section."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel

from .frame import ViewFrame
from .geometry import elevation_ahead_rad, lowest_free_m
from .panel import (
    FREE_COLOR,
    GROUND_COLOR,
    OPEN_COLOR,
    begin_panel,
    draw_legend,
    extent_m,
    far_to_near,
    inferred,
    name_axes,
    plane_rgb,
)

CORRIDOR_M = 1.5
"""Planes within this lateral distance are straight ahead and drawn solid, the others faint."""


def draw_side(ax: Any, frame: ViewFrame) -> None:
    """Draws the panel."""
    model = begin_panel(ax, frame, "Side view (planes straight ahead are solid)")
    if model is None:
        return
    forward = extent_m(frame)
    low, high = _heights(model)
    ax.set_xlim(-0.03 * forward, forward)
    ax.set_ylim(low, high)
    name_axes(ax, "forward", "above")
    _free_ahead(ax, model)
    _ground(ax, model, forward, low)
    _planes(ax, frame, model)
    _view_edges(ax, frame, forward)
    ax.plot([0], [0], marker=">", markersize=10, color="black", zorder=8, clip_on=False)
    _legend(ax, model)


def _heights(model: FrameModel) -> tuple[float, float]:
    """(lowest, highest) height above the camera to draw, m."""
    low, high = [-1.0], [1.5]
    if len(model.planes):
        low.append(-float(np.percentile(model.planes[:, 5], 98)))
        high.append(-float(np.percentile(model.planes[:, 4], 2)))
    if model.ground.seen:
        low.append(-model.ground.height_m)
    bottom, top = min(low), max(high)
    air = 0.06 * (top - bottom)
    return bottom - air, top + air


def _free_ahead(ax: Any, model: FrameModel) -> None:
    """Fills the open and the free space straight ahead, layer by layer, above the ground."""
    edges = model.free.azimuth_edges_rad
    ahead = int(np.searchsorted(edges, 0.0, side="right")) - 1
    if not 0 <= ahead < len(edges) - 1:
        return
    f = model.free
    if f.has_open:
        _layers_ahead(ax, model, (f.open_from_m[ahead], f.open_to_m[ahead]), (OPEN_COLOR, "#fdd835"))
    _layers_ahead(ax, model, (f.free_from_m[ahead], f.free_to_m[ahead]), (FREE_COLOR, "#a5d6a7"))


def _layers_ahead(
    ax: Any, model: FrameModel, ranges_m: tuple[NDArray[np.float32], NDArray[np.float32]], colors: tuple[str, str]
) -> None:
    """Fills each layer from ranges_m[0] to ranges_m[1], each (L,). colors: of the face and of the edge."""
    layers = model.free.layer_edges_m
    for k in range(len(layers) - 1):
        near, far = float(ranges_m[0][k]), float(ranges_m[1][k])
        if far > near:
            x, top = np.linspace(near, far, 50), float(layers[k])
            bottom = np.minimum(float(layers[k + 1]), lowest_free_m(model.ground, x))
            above = bottom > top  # bounded by the ground
            ax.fill_between(x, -top, -bottom, where=above, facecolor=colors[0], edgecolor=colors[1], linewidth=0.5)


def _ground(ax: Any, model: FrameModel, forward: float, low: float) -> None:
    """Draws the ground with its slope, and the range beyond which low obstacles are not detected."""
    if not model.ground.seen:
        ax.text(
            0.985, 0.06, "no ground found", transform=ax.transAxes, ha="right", fontsize=9, color=GROUND_COLOR, zorder=9
        )
        return
    g = model.ground
    x = np.array([0.0, forward])
    height = -(g.height_m + g.slope_x * x)
    ax.plot(x, height, color=GROUND_COLOR, linewidth=2.2, zorder=3)
    ax.fill_between(x, height, low, color=GROUND_COLOR, alpha=0.18, zorder=2)
    if g.blind_beyond_m < forward:
        ax.axvline(g.blind_beyond_m, color=GROUND_COLOR, linewidth=1, linestyle=":", zorder=3)


def _planes(ax: Any, frame: ViewFrame, model: FrameModel) -> None:
    """Draws each plane as a rectangle in the side view; a plane across the view is a line."""
    from matplotlib.patches import Rectangle

    p, colors = model.planes.astype(np.float64), plane_rgb(frame, model.planes) * 0.85
    dashed = inferred(model.flags)
    for k in far_to_near(model.planes):
        ahead = min(p[k, 1], p[k, 3]) < CORRIDOR_M and max(p[k, 1], p[k, 3]) > -CORRIDOR_M
        x0, x1 = sorted((p[k, 0], p[k, 2]))
        ax.add_patch(
            Rectangle(
                (x0, -p[k, 5]),
                max(x1 - x0, 1e-3),
                p[k, 5] - p[k, 4],
                facecolor=(*colors[k], 0.3 if ahead else 0.12),
                edgecolor=(*colors[k], 1.0 if ahead else 0.75),
                linewidth=2.4 if ahead else 1.0,
                linestyle=(0, (3, 1.8)) if dashed[k] else "-",
                zorder=5 if ahead else 4,
            )
        )


def _view_edges(ax: Any, frame: ViewFrame, forward: float) -> None:
    """Draws the lowest and highest line of sight of the image's middle column."""
    R = frame.R_level_cam_optical
    if R is None:
        return
    for angle in elevation_ahead_rad(frame.info.intrinsics, R):
        if abs(angle) < math.radians(89):
            ax.plot(
                [0, forward], [0, forward * math.tan(angle)], color="#1565c0", linewidth=1.0, linestyle="-.", zorder=3
            )


def _legend(ax: Any, model: FrameModel) -> None:
    """Draws the legend below the panel."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marks = [
        (Patch(facecolor="#bdbdbd", edgecolor="#404040", linewidth=2), f"plane within {CORRIDOR_M:g} m left or right"),
        (Patch(facecolor="#eeeeee", edgecolor="#9e9e9e"), "plane farther to the side"),
        (Patch(facecolor=FREE_COLOR, edgecolor="#a5d6a7"), "free straight ahead"),
        (Line2D([], [], color="#1565c0", linewidth=1, linestyle="-."), "field of view"),
    ]
    if model.free.has_open:
        marks.append((Patch(facecolor=OPEN_COLOR, edgecolor="#fdd835"), "open: presumed free"))
    if model.ground.seen:
        marks.append((Line2D([], [], color=GROUND_COLOR, linewidth=2.2), "ground"))
        if model.ground.blind_beyond_m < ax.get_xlim()[1]:
            marks.append((Line2D([], [], color=GROUND_COLOR, linestyle=":"), "beyond: low obstacles unknown"))
    draw_legend(ax, marks, (-0.06, -0.17), 3)
