"""The pictures of the README and of docs/explanation/algorithm.md, drawn from our own simulator.

Run `python -m benchmarks.draw_docs`, or with the names of some pictures. Writes docs/pictures/*.png, or to --out."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

from benchmarks import draw_pixels as px
from benchmarks import draw_planes as pl
from benchmarks.trace import Calls, traced
from companion.viewer.frame import ViewFrame
from companion.viewer.png import save_frame
from core.extractor import Extractor
from core.frames import rotation_from_euler
from core.types import ExtractorState, FrameModel
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import Rendered, camera_info, render

FOLDER = Path("docs/pictures")
DPI = 100
COLORS = 240
"""Pictures are stored with a palette: a noisy depth image in full colour would be four times as large."""

VIEWS: dict[str, tuple[str, float, float, float, tuple[float, float, float]]] = {
    "street": ("demo", 12.0, -8.0, 4.0, (3.0, 0.4, -2.2)),
    "facade": ("window", 0.0, 0.0, 0.0, (0.0, 0.0, -2.0)),
    "trees": ("trees", 0.0, 0.0, 0.0, (0.0, -0.4, -2.0)),
    "slits": ("slits", 0.0, 0.0, 0.0, (0.0, 0.0, -2.0)),
    "arrival": ("demo", 8.0, -1.0, 5.0, (11.0, 0.5, -2.4)),
}
"""name -> scene, roll, pitch, yaw (degrees), position in ned (metres)."""

Draw = Callable[..., None]
PICTURES: dict[str, tuple[str, Draw, tuple[float, float]]] = {
    "01_level": ("street", px.draw_level, (9.0, 3.9)),
    "02_pixels": ("facade", px.draw_classes, (9.0, 3.6)),
    "03_noise": ("street", px.draw_noise, (6.4, 4.9)),
    "04_ground": ("street", px.draw_ground, (9.0, 3.6)),
    "05_density": ("street", px.draw_density, (9.0, 3.6)),
    "06_strips": ("street", px.draw_strips, (9.0, 3.6)),
    "07_irregular": ("trees", px.draw_irregular, (7.0, 3.9)),
    "08_support": ("street", px.draw_support, (6.0, 4.6)),
    "09_clusters": ("trees", pl.draw_clusters, (9.0, 4.0)),
    "10_gaps": ("slits", pl.draw_gaps, (9.0, 3.7)),
    "11_pieces": ("facade", pl.draw_pieces, (7.0, 3.9)),
    "12_merge": ("facade", pl.draw_merge, (9.0, 3.7)),
    "13_openings": ("facade", pl.draw_openings, (9.0, 3.7)),
    "14_near_side": ("trees", pl.draw_near, (6.4, 5.4)),
    "15_pockets": ("street", pl.draw_pockets, (9.0, 4.6)),
    "16_prisms": ("facade", pl.draw_prisms, (6.4, 4.6)),
    "17_free": ("arrival", pl.draw_free, (7.0, 5.9)),
}
"""name -> view, what draws it, size in inches."""
OVERVIEW = "overview"


def slits() -> Scene:
    """A facade under open sky: a window to fly through, a wide low slit and a tall narrow one."""
    s = SceneBuilder("slits")
    s.ground()
    s.wall("facade", (6.5, -6.0), (6.5, 6.0), 5.5, ((2.2, 1.0, 2.9, 2.1), (6.6, 1.8, 1.8, 0.6), (9.4, 0.8, 0.6, 2.4)))
    return s.build()


def look(name: str) -> tuple[Rendered, Calls, FrameModel, Extractor]:
    """A view, modelled, with all that its stages were given. The frame before it seeds ground and noise."""
    scene, roll, pitch, yaw, position = VIEWS[name]
    extractor, state = Extractor(), ExtractorState()
    angles = {"roll_rad": math.radians(roll), "pitch_rad": math.radians(pitch), "yaw_rad": math.radians(yaw)}
    made = slits() if scene == "slits" else make_scene(scene, 1)
    sensor = replace(TYPICAL, sky_is_far=scene == "slits")
    for number in range(2):
        calls = Calls()
        frame = render(made, camera_info(), position_ned_m=position, sensor=sensor, seed=1, frame=number, **angles)
        with traced(calls):
            model, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state, keep_strips=True)
    return frame, calls, model, extractor


def save(figure: Any, path: Path) -> None:
    """Writes a figure as a PNG with a palette."""
    held = BytesIO()
    figure.savefig(held, dpi=DPI, format="png")
    shrink(held, path)


def shrink(image: Any, path: Path, width: int | None = None) -> None:
    """Writes an image with a palette, optionally reduced. image: a path or an open file."""
    from PIL import Image

    picture = Image.open(image).convert("RGB")
    if width is not None:
        picture = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
    picture.quantize(COLORS, method=Image.Quantize.FASTOCTREE).save(path, optimize=True)


def draw(name: str, seen: tuple[Rendered, Calls, FrameModel, Extractor], path: Path) -> None:
    """One picture of a stage."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    _, what, size = PICTURES[name]
    frame, calls, model, extractor = seen
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    what(figure, frame, calls, extractor if what.__module__ == px.__name__ else model)
    for ax in figure.axes:
        ax.tick_params(labelsize=7)
    save(figure, path)


def draw_overview(seen: tuple[Rendered, Calls, FrameModel, Extractor], path: Path) -> None:
    """The viewer's own picture of a frame, smaller."""
    frame, _, model, _ = seen
    _, roll, pitch, yaw, position = VIEWS["arrival"]
    R = rotation_from_euler(math.radians(roll), math.radians(pitch), math.radians(yaw))
    shown = ViewFrame(
        info=frame.info, sequence=0, t_ns=0, depth_mm=frame.depth_mm, R_ned_frd=R, model=model, position_ned_m=position
    )
    save_frame(shown, path)
    shrink(path, path, 1100)


def main(arguments: list[str] | None = None) -> int:
    """Draws the requested pictures, by default all."""
    names = [OVERVIEW, *PICTURES]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.draw_docs", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)} (default: all)")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of the pictures (%(default)s)")
    args = parser.parse_args(arguments)
    unknown = [n for n in args.names if n not in names]
    if unknown:
        parser.error(f"no picture {unknown[0]}; there are: {', '.join(names)}")
    args.out.mkdir(parents=True, exist_ok=True)
    seen: dict[str, tuple[Rendered, Calls, FrameModel, Extractor]] = {}
    for name in args.names or names:
        view = "arrival" if name == OVERVIEW else PICTURES[name][0]
        if view not in seen:
            seen[view] = look(view)
        path = args.out / f"{name}.png"
        if name == OVERVIEW:
            draw_overview(seen[view], path)
        else:
            draw(name, seen[view], path)
        print(path, path.stat().st_size // 1000, "kB", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
