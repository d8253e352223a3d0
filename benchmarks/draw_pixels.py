"""Pictures of the first stages for docs/explanation/algorithm.md: from the depth image to strips that are kept."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.trace import Calls
from companion.viewer.colors import depth_rgb
from core.extractor import Extractor
from core.stages.density import MAX_PEAKS, Peaks, find_peaks
from core.stages.row_mask import mask_open_rows
from core.stages.spatial_noise import noise_tiles
from core.stages.strips import IRREGULAR, MERGED, ROUGH, SMOOTH
from core.types import FAR_MM, UNKNOWN_MM
from drivers.simulation.source import Rendered

KIND_RGB = {
    SMOOTH: (38, 110, 190),
    ROUGH: (230, 140, 30),
    IRREGULAR: (200, 60, 110),
    MERGED: (90, 90, 90),
}
KIND_NAME = {SMOOTH: "smooth", ROUGH: "rough", IRREGULAR: "irregular rest", MERGED: "merged"}
PALE = 235


def view_mm(codes: NDArray[np.uint16], f_px: float, quantum: float) -> NDArray[np.uint16]:
    """The levelled view (rows, cols) as millimetres along level_cam x, with unknown and far as in depth images."""
    code = codes.T.astype(np.float64)
    mm = np.clip(1000.0 * f_px * quantum / np.maximum(code, 1), 1, 65000).astype(np.uint16)
    return np.where(code == 0, UNKNOWN_MM, np.where(code == 1, FAR_MM, mm)).astype(np.uint16)


def bare(ax: Any, title: str) -> None:
    """An image's axes: no ticks, a title."""
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_title(title, fontsize=9, loc="left")


def levelled(calls: Calls) -> NDArray[np.uint16]:
    """(cols, rows) codes from which the strips are extracted."""
    codes: NDArray[np.uint16] = calls.of("extract_strips").before[0]
    return codes


def is_ground(calls: Calls) -> NDArray[np.bool_]:
    """(cols, rows), where a measurement is ground or below it."""
    codes, threshold, view = calls.of("extract_strips").before[:3]
    cols, rows = codes.shape
    is_open = np.zeros((cols, -(-rows // 8) * 8), np.uint8)
    for u in range(cols):
        mask_open_rows(codes[u], threshold, threshold.shift[u], view.tan_mid, is_open[u])
    ground: NDArray[np.bool_] = (codes > 1) & (is_open[:, :rows] == 0)
    return ground


def draw_level(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """The image as delivered and the levelled view."""
    view = calls.of("view_geometry").result
    a, b = figure.subplots(1, 2, width_ratios=(frame.info.intrinsics.width, view.cols))
    a.imshow(depth_rgb(frame.depth_mm, frame.info))
    bare(a, "as the camera delivers it")
    b.imshow(depth_rgb(view_mm(levelled(calls), view.f_px, view.lsb_per_px), frame.info))
    b.axhline(view.cv, color="black", lw=0.7, ls=":")
    bare(b, "levelled: columns are vertical, the horizon (dotted) is a row")


def draw_classes(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """A part of the image and what became of each pixel."""
    depth_mm, limits, marks = calls.of("classify").after
    flying = (depth_mm >= limits.least_mm) & (depth_mm <= limits.greatest_mm) & (marks == UNKNOWN_MM)
    part = _most(flying, 90, 120)
    rgb = np.full((*marks.shape, 3), PALE, np.uint8)
    rgb[(marks != UNKNOWN_MM) & (marks != FAR_MM)] = (150, 185, 215)
    rgb[marks == UNKNOWN_MM] = (110, 110, 110)
    rgb[flying] = (215, 40, 40)
    a, b = figure.subplots(1, 2)
    a.imshow(depth_rgb(frame.depth_mm, frame.info)[part])
    bare(a, "depth, a part of the image")
    b.imshow(rgb[part])
    bare(b, "blue: measured, grey: unknown, red: flying, made unknown")


def _most(mask: NDArray[np.bool_], rows: int, cols: int) -> tuple[slice, slice]:
    """The part of the image of rows x cols pixels that holds most of a mask."""
    total = np.pad(mask.astype(np.int64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    inside = total[rows:, cols:] - total[:-rows, cols:] - total[rows:, :-cols] + total[:-rows, :-cols]
    v, u = np.unravel_index(int(inside.argmax()), inside.shape)
    return slice(int(v), int(v) + rows), slice(int(u), int(u) + cols)


def draw_noise(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """Noise of each tile, those that count in bold."""
    _, _, marks, info, _, _ = calls.of("estimate_noise").before
    focal = info.intrinsics.fx
    tiles, *_ = noise_tiles(marks, focal, extractor.params)
    down, across = tiles.shape
    sigma = np.where(tiles >= 0, tiles, np.nan)
    limit = np.nanquantile(sigma, extractor.params.noise_quantile)
    ax = figure.subplots()
    ax.imshow(depth_rgb(frame.depth_mm, frame.info), alpha=0.45)
    high, wide = marks.shape[0] / down, marks.shape[1] / across
    for v in range(down):
        for u in range(across):
            text = "-" if np.isnan(sigma[v, u]) else f"{sigma[v, u]:.2f}"
            weight = "bold" if sigma[v, u] <= limit else "normal"
            ax.text((u + 0.5) * wide, (v + 0.5) * high, text, ha="center", va="center", fontsize=8, weight=weight)
    ke = limit / focal
    bare(ax, f"disparity noise of each tile, px; lower quartile {limit:.2f} px: ke = {ke:.4f} (true 0.0015)")


def draw_ground(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """The ground in the levelled view, and from the side with its tolerance."""
    view, found = calls.of("view_geometry").result, calls.of("find_ground")
    ground = found.result
    rgb = depth_rgb(view_mm(levelled(calls), view.f_px, view.lsb_per_px), frame.info)
    rgb[is_ground(calls).T] = (196, 164, 110)
    rgb[(levelled(calls) == 0).T] = (150, 150, 150)
    a, b = figure.subplots(1, 2)
    a.imshow(rgb)
    bare(a, "brown: ground, removed before strips are searched")
    points = found.after[-1]
    points = points[(points["per_height"] > 0) & (np.abs(points["y"]) < 3.0)][::2]
    b.plot(points["x"], -points["z"], ".", ms=1.2, color="#4a6f96")
    x = np.linspace(0.5, 20.0, 100)
    p, ke = extractor.params, calls.of("find_ground").before[3]
    cap = p.ground_tolerance_cap * p.min_obstacle_height_m
    half = np.clip(p.ground_sigmas * ke * x * ground.height_m, min(p.ground_tolerance_m, cap), cap)
    level = -(ground.height_m + ground.slope_x * x)
    b.plot(x, level, color="#7a5520", lw=1.2)
    b.fill_between(x, level - half, level + half, color="#c4a46e", alpha=0.5, lw=0)
    b.set_xlim(0, 20)
    b.set_ylim(-ground.height_m - 1.2, 3.5)
    b.set_xlabel("forward, m", fontsize=8)
    b.set_ylabel("above the camera, m", fontsize=8)
    b.set_title("from the side: the fitted ground and its tolerance", fontsize=9, loc="left")


def column_with_most(calls: Calls, kind: int) -> int:
    """The column with most different strips, some of them of this kind."""
    _, strips = strips_of(calls)
    score = []
    for u in range(int(strips["column"].max()) + 1):
        own = strips[strips["column"] == u]
        score.append(len(set(np.round(own["disparity_px"], 0))) * int((own["kind"] == kind).any()))
    return int(np.argmax(score))


def strips_of(calls: Calls) -> tuple[NDArray[np.uint16], NDArray[Any]]:
    """(quantised disparity, STRIP) as the strips were found."""
    call = calls.of("extract_strips")
    return call.before[0], call.after[5][: int(call.result[0])]


def draw_density(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """One column: its pixels with its strips, and its density with threshold and peaks."""
    view, call = calls.of("view_geometry").result, calls.of("extract_strips")
    codes, strips = strips_of(calls)
    u = column_with_most(calls, SMOOTH)
    bins = call.before[3]
    bin_px, threshold = bins.disparity_px, bins.threshold
    ground = is_ground(calls)[u]
    open_ = (codes[u] > 1) & ~ground
    per_bin = np.bincount(bins.bin_of_code[codes[u][open_]], minlength=len(bin_px))
    counts = np.convolve(per_bin, bins.weights, "same").astype(np.int32)
    low, high, top = (np.zeros(MAX_PEAKS, np.int32) for _ in range(3))
    peaks = find_peaks(counts, threshold, 0, len(counts) - 1, call.before[4][0], Peaks(low, high, top))
    a, b = figure.subplots(1, 2, sharex=True)
    rows, d = np.arange(codes.shape[1]), codes[u] / view.lsb_per_px
    for on, color, label in ((ground, "#c4a46e", "ground"), (open_, "#4a6f96", "pixel")):
        a.plot(d[on & (codes[u] > 1)], rows[on & (codes[u] > 1)], ".", ms=2, color=color, label=label)
    for s in strips[strips["column"] == u]:
        a.plot([s.disparity_px] * 2, [s.top_row, s.bottom_row], lw=2, color=_hex(KIND_RGB[int(s.kind)]))
    a.invert_yaxis()
    a.set_ylabel("row", fontsize=8)
    a.set_title(f"column {u}: its pixels and its strips", fontsize=9, loc="left")
    b.step(bin_px, counts / 64.0, color="#202020", lw=0.9, where="mid", label="soft count")
    b.plot(bin_px, threshold / 64.0, color="#c03030", lw=1, label="least, 0.7 Hm x")
    for k in range(peaks):
        b.axvspan(bin_px[low[k]], bin_px[high[k]], color="#7fb07f", alpha=0.4, lw=0)
    b.set_ylabel("pixels", fontsize=8)
    b.set_title("density: peaks over the threshold (green)", fontsize=9, loc="left")
    b.legend(fontsize=7)
    a.legend(fontsize=7, loc="upper right")
    widest = 1.3 * float(np.quantile(d[open_], 0.97))
    a.set_xlim(0, widest)
    b.set_ylim(0, 1.15 * max(float(counts.max()) / 64.0, float(np.interp(widest, bin_px, threshold)) / 64.0))
    for ax in (a, b):
        ax.set_xlabel("disparity f/X, px", fontsize=8)


def _hex(rgb: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def painted(calls: Calls, strips: NDArray[Any], colors: NDArray[np.uint8], ground: bool = True) -> NDArray[np.uint8]:
    """(rows, cols, 3): the levelled view, pale, with strips (N,) painted in colors (N, 3)."""
    codes = levelled(calls)
    rgb = np.full((*codes.T.shape, 3), PALE, np.uint8)
    rgb[(codes == 0).T] = (190, 190, 190)
    if ground:
        rgb[is_ground(calls).T] = (222, 208, 180)
    for s, color in zip(strips, colors, strict=True):
        rgb[s.top_row : s.bottom_row + 1, s.column] = color
    return rgb


def draw_strips(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """All strips by distance, and by the way they were found."""
    view = calls.of("view_geometry").result
    _, strips = strips_of(calls)
    by_range = depth_rgb((1000.0 * view.f_px / strips["disparity_px"]).astype(np.uint16)[:, None], frame.info)[:, 0]
    by_kind = np.array([KIND_RGB[int(k)] for k in strips["kind"]], np.uint8)
    a, b = figure.subplots(1, 2)
    a.imshow(painted(calls, strips, by_range))
    bare(a, f"{len(strips)} strips, coloured by distance")
    b.imshow(painted(calls, strips, by_kind))
    bare(b, "by kind")
    for k, name in KIND_NAME.items():
        b.plot([], [], "s", ms=5, color=_hex(KIND_RGB[k]), label=name)
    b.legend(fontsize=7, loc="lower right")


def draw_irregular(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """A column through foliage from the side: pixels, strips and their near edges."""
    view = calls.of("view_geometry").result
    codes, strips = strips_of(calls)
    u = column_with_most(calls, IRREGULAR)
    on = (codes[u] > 1) & ~is_ground(calls)[u]
    rows = np.arange(codes.shape[1])
    ax = figure.subplots()
    x = view.f_px * view.lsb_per_px / np.maximum(codes[u], 1)
    ax.plot(x[on], (view.cv - rows[on]) / view.f_px * x[on], ".", ms=3, color="#8aa4bd", label="pixel")
    for s in strips[strips["column"] == u]:
        at, near = view.f_px / s.disparity_px, view.f_px / s.near_px
        z = (view.cv - np.array([s.top_row, s.bottom_row])) / view.f_px * at
        ax.plot([at, at], z, lw=2.5, color=_hex(KIND_RGB[int(s.kind)]))
        ax.plot([near, near], z, lw=1, ls=":", color=_hex(KIND_RGB[int(s.kind)]))
    for k, name in KIND_NAME.items():
        ax.plot([], [], lw=2.5, color=_hex(KIND_RGB[k]), label=f"strip, {name}")
    ax.plot([], [], lw=1, ls=":", color="black", label="near edge of a strip")
    ax.legend(fontsize=7)
    ax.set_xlim(float(np.quantile(x[on], 0.01)) - 0.3, float(np.quantile(x[on], 0.9)) + 2.0)
    ax.set_xlabel("forward, m", fontsize=8)
    ax.set_ylabel("above the camera, m", fontsize=8)
    ax.set_title(f"column {u} from the side, camera on the left", fontsize=9, loc="left")


def draw_support(figure: Any, frame: Rendered, calls: Calls, extractor: Extractor) -> None:
    """Draws the strips with too little support."""
    call = calls.of("drop_unsupported")
    before, kept = call.before[0][: call.before[1]], call.after[0][: int(call.result)]
    here = {(int(s.column), int(s.top_row), int(s.bottom_row)) for s in kept}
    gone = np.array([(int(s.column), int(s.top_row), int(s.bottom_row)) not in here for s in before])
    colors = np.where(gone[:, None], (215, 30, 30), (120, 150, 185)).astype(np.uint8)
    order = np.argsort(gone, kind="stable")
    rgb = painted(calls, before[order], colors[order])
    for s in before[gone]:
        rgb[max(0, s.top_row - 1) : s.bottom_row + 2, max(0, s.column - 1) : s.column + 2] = (215, 30, 30)
    ax = figure.subplots()
    ax.imshow(rgb)
    bare(ax, f"{len(kept)} strips are kept; {int(gone.sum())} (red, enlarged) are dropped")
