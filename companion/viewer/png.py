"""One picture per frame: header, depth image with planes, top view, side view.

matplotlib belongs to the extra `view` and is imported with the first picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.optional_library import optional_module

from ..whole_file import whole_file
from .depth import draw_depth
from .frame import FrameStatus, ViewFrame, describe
from .side import draw_side
from .top import draw_top

WIDTH_PX, HEIGHT_PX, DPI = 1600, 1000, 100
BANNER_PX = 46
"""Height of the coloured band at the top that shows the frame's status."""
BANNER_COLOR = {FrameStatus.VALID: "#2e7d32", FrameStatus.BLIND: "#c62828", FrameStatus.NO_PRISMS: "#b26a00"}


def drawing_library(otherwise: str = "") -> Any:
    """The module of matplotlib that draws without a window. Raises DeviceNotFound; otherwise: another remedy than to
    install it."""
    name = "matplotlib.backends.backend_agg"
    return optional_module(name, "pictures need matplotlib", "matplotlib>=3.8", otherwise=otherwise)


def new_figure(width_px: int = WIDTH_PX, height_px: int = HEIGHT_PX, **options: Any) -> Any:
    """An empty matplotlib figure without a window. options: of Figure. Raises DeviceNotFound without matplotlib."""
    agg = drawing_library()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_px / DPI, height_px / DPI), dpi=DPI, facecolor="white", **options)
    agg.FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Any, path: Path) -> None:
    """Writes a figure as PNG. Raises OSError."""
    with whole_file(path) as part:
        figure.savefig(part, dpi=DPI, metadata={"Software": "osape-companion"})


def save_frame(frame: ViewFrame, path: Path, *, t_start_ns: int = 0) -> None:
    """Writes the picture of one frame. Raises DeviceNotFound without matplotlib, OSError."""
    figure = new_figure()
    _header(figure, frame, t_start_ns)
    image, scale = image_place(frame)
    draw_depth(figure.add_axes(image), figure.add_axes(scale), frame)
    draw_side(figure.add_axes((0.045, 0.118, 0.455, 0.215)), frame)
    draw_top(figure.add_axes((0.555, 0.118, 0.435, 0.747)), frame)
    save_figure(figure, path)


def image_place(frame: ViewFrame) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """(left, bottom, width, height) of the image and of its scale, as shares of the figure."""
    k, left, top = frame.info.intrinsics, 0.015, 0.865
    size_px = min(0.43 * WIDTH_PX / k.width, 0.45 * HEIGHT_PX / k.height)
    width, height = k.width * size_px / WIDTH_PX, k.height * size_px / HEIGHT_PX
    return (left, top - height, width, height), (left + width + 0.008, top - height, 0.012, height)


def _header(figure: Any, frame: ViewFrame, t_start_ns: int) -> None:
    """Draws the band and two header lines."""
    from matplotlib.patches import Rectangle

    status, band = frame.status, BANNER_PX / HEIGHT_PX
    figure.patches.append(
        Rectangle((0, 1 - band), 1, band, transform=figure.transFigure, facecolor=BANNER_COLOR[status], zorder=-1)
    )
    label = {
        FrameStatus.VALID: "VALID",
        FrameStatus.BLIND: f"BLIND: {frame.cause}",
        FrameStatus.NO_PRISMS: "NO PRISMS IN THIS LOG: run `companion replay` first",
    }[status]
    who, what = describe(frame, t_start_ns)
    if status is FrameStatus.BLIND:
        what = "Do not treat any direction of this frame as free."
        if frame.model is not None:
            what += f"   measured {frame.model.stats.measured_share:.0%} of the image"
    plain: dict[str, Any] = {"weight": "bold", "va": "center", "parse_math": False}  # names in logs may contain $
    figure.text(0.015, 1 - band / 2, shorten(label, 120), color="white", fontsize=17, **plain)
    figure.text(0.015, 1 - band - 0.02, who, color="#202020", fontsize=12, **plain)
    figure.text(0.015, 1 - band - 0.043, what, fontsize=11, va="center", color="#202020")


def shorten(text: str, limit: int) -> str:
    """`text`, shortened to `limit` characters."""
    return text if len(text) <= limit else text[: limit - 1].rstrip() + "…"
