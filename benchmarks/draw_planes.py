"""Pictures of the later stages for docs/explanation/algorithm.md: from strips to planes, prisms and what is free."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.draw_pixels import PALE, bare, painted, view_mm
from benchmarks.trace import Call, Calls
from companion.viewer.colors import depth_rgb
from core.stages.line_fit import fit_line
from core.stages.openings import layer_of
from core.types import FrameModel, FreeEnd
from drivers.simulation.source import Rendered

COLORS = np.array(
    [(31, 119, 180), (230, 126, 34), (44, 150, 60), (200, 50, 60), (130, 90, 180), (140, 86, 75), (220, 110, 190),
     (90, 90, 90), (170, 170, 40), (30, 170, 180)], np.uint8,
)  # fmt: skip


def _hex(k: int) -> str:
    return "#{:02x}{:02x}{:02x}".format(*COLORS[k % len(COLORS)])


def _above(ax: Any, title: str) -> None:
    """Axes of a top view: y to the right, x up."""
    ax.set_aspect("equal")
    ax.set_xlabel("right, m", fontsize=8)
    ax.set_ylabel("forward, m", fontsize=8)
    ax.set_title(title, fontsize=9, loc="left")


def _ends(p: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """((y, x), (y, x)) of a plane's ends."""
    x0, x1 = 1.0 / max(p.a + p.b * p.t0, 1e-3), 1.0 / max(p.a + p.b * p.t1, 1e-3)
    return (p.t0 * x0, x0), (p.t1 * x1, x1)


def draw_clusters(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """Strips from above by cluster, largest first."""
    after = calls.of("join_near").after
    strips = after[0][: after[1]]
    number = strips["cluster"]
    order = {int(c): k for k, c in enumerate(np.argsort(-np.bincount(number)))}
    colors = COLORS[[order[int(c)] % len(COLORS) for c in number]]
    a, b = figure.subplots(1, 2)
    a.imshow(painted(calls, strips, colors))
    bare(a, f"{len(order)} clusters")
    b.scatter(strips["y_m"], strips["x_m"], s=1.5, c=colors / 255.0)
    _above(b, "from above")
    b.set_xlim(-9, 9)
    b.set_ylim(0, 21)


def draw_gaps(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """What was filled: low gaps, then slits."""
    before, after = calls.of("fill_columns").before, calls.of("fill_columns").after
    n = int(before[2][-1])
    blue = np.tile(np.array((120, 150, 185), np.uint8), (n, 1))
    seen = painted(calls, before[0][:n], blue, ground=False)
    alive = after[0][:n][after[0]["support"][:n] > 0]
    filled = painted(calls, alive, blue[: len(alive)], ground=False)
    fresh = np.any(filled != seen, axis=2) & np.all(filled == blue[0], axis=2)
    filled[fresh] = (230, 126, 34)
    a, b = figure.subplots(1, 2)
    a.imshow(seen)
    bare(a, "strips as found: a window to pass, two slits, holes")
    b.imshow(filled)
    bare(b, f"orange: filled ({int(alive['filled_rows'].sum())} rows in all)")


def _grown(call: Call) -> NDArray[Any]:
    """The strips of a call of `grow` that are in a track."""
    strips = call.after[0][: int(call.before[2][call.before[1].cols])]
    return strips[strips["support"] > 0]


def draw_pieces(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """Strips as points (t, s), in which a vertical plane is a straight line, and the pieces that they form."""
    call, view, tracks = calls.of("grow"), calls.of("view_geometry").result, calls.of("planes_from_tracks").before[1]
    on, count = _grown(call), call.result
    size = np.bincount(on["track"], minlength=count)
    rank = {int(k): i for i, k in enumerate(np.argsort(-size, kind="stable"))}
    t, s = (on["column"] - view.cu) / view.f_px, on["disparity_px"] / view.f_px
    color = COLORS[[rank[int(k)] % len(COLORS) for k in on["track"]]] / 255.0
    small = np.array([size[k] < 4 for k in on["track"]])
    color[small] = 0.75
    ax = figure.subplots()
    ax.scatter(t, s, s=2.5, c=color)
    for k in np.flatnonzero(size >= 12):
        a, b, _, _ = fit_line(tracks[k], 1.0 / 1.2**2)
        ends = np.array([t[on["track"] == k].min(), t[on["track"] == k].max()])
        ax.plot(ends, a + b * ends, color="black", lw=0.7)
    ax.set_xlabel("t = y/x, tangent of azimuth", fontsize=8)
    ax.set_ylabel("s = 1/x, 1/m", fontsize=8)
    ax.set_title(
        f"{len(on)} strips in {count} pieces; a vertical plane is a straight line here", fontsize=9, loc="left"
    )


def _rectangles(ax: Any, calls: Calls, frame: Rendered, planes: NDArray[Any], title: str) -> None:
    """Planes drawn as the levelled view sees them."""
    from matplotlib.patches import Polygon

    view, codes = calls.of("view_geometry").result, calls.of("extract_strips").before[0]
    rgb = depth_rgb(view_mm(codes, view.f_px, view.lsb_per_px), frame.info)
    ax.imshow((0.35 * rgb + 0.65 * PALE).astype(np.uint8))
    for k, p in enumerate(planes):
        s0, s1 = p.a + p.b * p.t0, p.a + p.b * p.t1
        corner = [(p.t0, p.top_m * s0), (p.t1, p.top_m * s1), (p.t1, p.bottom_m * s1), (p.t0, p.bottom_m * s0)]
        xy = [(view.cu + view.f_px * t, view.cv + view.f_px * m) for t, m in corner]
        ax.add_patch(Polygon(xy, closed=True, fill=False, ec=_hex(k), lw=0.8))
    ax.set_xlim(0, view.cols)
    ax.set_ylim(view.rows, 0)
    bare(ax, title)


def draw_merge(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """Planes before and after the merge."""
    call = calls.of("join_planes")
    count = call.before[0]
    after = call.after[1].planes[:count]
    after = after[after["support"] >= 0]
    a, b = figure.subplots(1, 2)
    _rectangles(a, calls, frame, call.before[1].planes[:count], f"{count} pieces")
    _rectangles(b, calls, frame, after, f"merged: {len(after)} planes")


def draw_openings(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """The mask of openings at the distance of the nearest large object."""
    view, openings = calls.of("view_geometry").result, calls.of("find_openings").result
    codes = calls.of("extract_strips").before[0]
    rgb = depth_rgb(view_mm(codes, view.f_px, view.lsb_per_px), frame.info).astype(np.float64)
    axes = figure.subplots(1, 2)
    for ax, x in zip(axes, (6.5, 11.0), strict=True):
        cell = round(view.f_px / openings.down)
        mask = np.kron(openings.masks[layer_of(x, openings.steps_m)].T, np.ones((cell, cell)))
        mask = mask[: view.rows, : view.cols] > 0
        shown = 0.4 * rgb + 0.6 * PALE
        shown[mask] = 0.5 * shown[mask] + 0.5 * np.array((60, 180, 75))
        ax.imshow(shown.astype(np.uint8))
        bare(ax, f"green: a box of Ws x Hs fits through at {x:g} m")


def draw_near(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """A tree from above: strips, near edges, planes before and after the shift."""
    call, shift, view = calls.of("grow"), calls.of("shift_to_near_side"), calls.of("view_geometry").result
    f, on = view.f_px, _grown(call)
    t = (on["column"] - view.cu) / f
    x, near = f / on["disparity_px"], f / on["near_px"]
    ax = figure.subplots()
    ax.plot(t * x, x, ".", ms=2.5, color="#8aa4bd", label="strip")
    ax.plot(t * near, near, ".", ms=1.5, color="#d0506a", label="its near edge")
    for p, q in zip(shift.before[1][: shift.before[0]], shift.after[1], strict=False):
        (y0, x0), (y1, x1) = _ends(p)
        moved = p.front_m > 0.0
        ax.plot([y0, y1], [x0, x1], color="#707070", lw=0.8, ls="--" if moved else "-")
        if moved:
            (y0, x0), (y1, x1) = _ends(q)
            ax.plot([y0, y1], [x0, x1], color="#1f4e79", lw=1.8)
    ax.plot([], [], color="#707070", lw=0.8, ls="--", label="plane as fitted")
    ax.plot([], [], color="#1f4e79", lw=1.8, label="shifted to the near side")
    ax.legend(fontsize=7, loc="lower right")
    middle = float(np.median(t * x)), float(np.median(x))
    ax.set_xlim(middle[0] - 3.2, middle[0] + 3.2)
    ax.set_ylim(middle[1] - 2.6, middle[1] + 2.6)
    _above(ax, "a tree from above (the camera is below the picture)")


def draw_pockets(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """Planes from above before neighbours meet, and after pockets closed and the covered went."""
    before, drop = calls.of("extend_to_corners"), calls.of("drop_covered")
    a, b = figure.subplots(1, 2, sharex=True, sharey=True)
    for p in before.before[1][: before.before[0]]:
        (y0, x0), (y1, x1) = _ends(p)
        a.plot([y0, y1], [x0, x1], color="#1f4e79", lw=1.4)
    _above(a, f"{before.before[0]} planes after the merge")
    for p in drop.after[1][: drop.after[0]]:
        (y0, x0), (y1, x1) = _ends(p)
        if p.support < 0:
            b.plot([y0, y1], [x0, x1], color="#b0b0b0", lw=0.8)
        else:
            b.plot([y0, y1], [x0, x1], color="#e67e22" if p.inferred else "#1f4e79", lw=1.4)
    _above(b, "orange: closed pockets; grey: hidden, dropped")


def draw_prisms(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """The layered prisms."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    ax = figure.add_subplot(projection="3d")
    for prism in model.prisms:
        v = prism.vertices_m
        faces = [
            [(y0, x0, -prism.top_m), (y1, x1, -prism.top_m), (y1, x1, -prism.bottom_m), (y0, x0, -prism.bottom_m)]
            for (x0, y0), (x1, y1) in pairwise(v)
        ]
        ax.add_collection3d(
            Poly3DCollection(faces, facecolors=_hex(prism.cluster), edgecolors="black", linewidths=0.3, alpha=0.55)
        )
    ax.set_xlim(-8, 8)
    ax.set_ylim(0, 16)
    ax.set_zlim(-2.5, 4)
    ax.set_box_aspect((16, 16, 6.5))
    ax.view_init(elev=32, azim=-112)
    ax.tick_params(labelsize=7)
    ax.set_xlabel("right, m", fontsize=8)
    ax.set_ylabel("forward, m", fontsize=8)
    ax.set_title(f"{len(model.planes)} planes cut into {len(model.prisms)} prisms", fontsize=9, loc="left")


END_COLOR = {
    FreeEnd.OBSTACLE: "#c03030",
    FreeEnd.UNKNOWN: "#606060",
    FreeEnd.FIELD_OF_VIEW: "#3060c0",
    FreeEnd.MAX_RANGE: "#30a050",
}
END_NAME = {
    FreeEnd.OBSTACLE: "an obstacle",
    FreeEnd.UNKNOWN: "unknown",
    FreeEnd.FIELD_OF_VIEW: "edge of view",
    FreeEnd.MAX_RANGE: "maximum range",
}


def draw_free(figure: Any, frame: Rendered, calls: Calls, model: FrameModel) -> None:
    """The free-range profile of the camera's own layer."""
    from matplotlib.patches import Polygon

    free, ax = model.free, figure.subplots()
    ax.set_facecolor("#dcdcdc")
    edges, layer = free.azimuth_edges_rad, int(np.searchsorted(free.layer_edges_m, 0.0) - 1)
    for d in range(len(edges) - 1):
        near, far = float(free.free_from_m[d, layer]), float(free.free_to_m[d, layer])
        if far <= near:
            continue
        ring = [(far * np.sin(a), far * np.cos(a)) for a in (edges[d], edges[d + 1])]
        inner = [(near * np.sin(a), near * np.cos(a)) for a in (edges[d + 1], edges[d])]
        ax.add_patch(Polygon(ring + inner, fc="#bfe6bf", ec="none"))
        ax.plot(*zip(*ring, strict=True), lw=2, color=END_COLOR.get(FreeEnd(int(free.end[d, layer])), "#606060"))
    for end, name in END_NAME.items():
        ax.plot([], [], lw=2, color=END_COLOR[end], label=f"free range ends at {name}")
    for ax_, ay, bx, by, top, bottom in model.planes:
        inside = top < free.layer_edges_m[layer + 1] and bottom > free.layer_edges_m[layer]
        ax.plot([ay, by], [ax_, bx], color="black", lw=1.3 if inside else 0.4)
    for width, where in ((1.3, "in this layer"), (0.4, "above or below it")):
        ax.plot([], [], color="black", lw=width, label=f"plane {where}")
    ax.legend(fontsize=7, loc="lower left")
    low, high = free.layer_edges_m[layer], free.layer_edges_m[layer + 1]
    _above(ax, f"green: free in the layer {-high:+.2f} to {-low:+.2f} m about the camera; grey: unknown")
    ax.set_xlim(-13, 13)
    ax.set_ylim(0, 21)
