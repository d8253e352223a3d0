"""A path through one frame: of a simulated scene, or of a log that `companion replay` or the service wrote.

Run: .venv/bin/python examples/plan_path.py --scene window --unknown allow --goal 11 3.5 0 -o path.png
     .venv/bin/python examples/plan_path.py demo-out/prisms.mcap --frame 40 --goal 8 0 0 -o path.png
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np

from companion.bench.frames import render_sequence
from companion.viewer.frame import ViewFrame
from companion.viewer.log import read_frames
from companion.viewer.png import drawing_library, new_figure
from companion.viewer.side import draw_side
from companion.viewer.top import draw_top
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL
from drivers.base import DriverError
from drivers.logs.reader import McapRecording
from osape_client.model import CameraModel
from osape_client.query.space import PlacedModel, Space

try:
    from path_planner import PLANNERS, NoPath, Room, Unknown, plan
except ImportError as error:
    sys.exit(str(error))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("log", nargs="?", type=Path, help="a log with prisms; without one a scene is rendered")
    parser.add_argument("--frame", type=int, default=0, help="which frame of the log")
    parser.add_argument("--scene", default="window", help="of drivers/simulation/scene_library.py")
    parser.add_argument(
        "--goal", type=float, nargs=3, default=(9.0, 0.0, 0.0), help="ahead, right, down of the camera, m"
    )
    add_planner_options(parser, radius_m=0.5, been_m=3.0, picture="path.png")
    return parser.parse_args()


def add_planner_options(parser: argparse.ArgumentParser, radius_m: float, been_m: float, picture: str) -> None:
    parser.add_argument("--planner", choices=list(PLANNERS), default="rrt-connect", help="default: %(default)s")
    parser.add_argument(
        "--seed",
        type=int,
        default=1,
        help="of the random numbers, 1 or more; another one gives another path (default: %(default)s)",
    )
    parser.add_argument(
        "--unknown",
        choices=[u.value for u in Unknown],
        default="avoid",
        help="whether the path may use unknown space; default: %(default)s",
    )
    parser.add_argument("--radius", type=float, default=radius_m, help="of the vehicle, m (default: %(default)s)")
    parser.add_argument(
        "--been",
        type=float,
        default=been_m,
        help="within this distance of the start unknown space counts as free, m (default: %(default)s)",
    )
    parser.add_argument("-o", type=Path, default=Path(picture), help="the picture (default: %(default)s)")


def simulated(scene: str) -> ViewFrame:
    """One frame of a scene from the library, 2 m above the ground."""
    frames = render_sequence(scene, scene, (640, 480), images=2)
    extractor, model, state = Extractor(), None, None
    for depth_mm in frames.depth_mm:
        model, state = extractor.extract(depth_mm, frames.info, frames.R_level_optical, state)
    R_ned_frd = frames.R_level_optical @ R_CAMFRD_OPTICAL.T
    return ViewFrame(
        info=frames.info, sequence=0, t_ns=0, depth_mm=frames.depth_mm[-1], R_ned_frd=R_ned_frd, model=model
    )


def logged(log: Path, number: int) -> ViewFrame:
    """A frame of a log. Raises IndexError."""
    for i, frame in enumerate(read_frames(McapRecording(log))):
        if i == number:
            return frame.frame()
    raise IndexError(f"{log} has no frame {number}")


def draw(frame: ViewFrame, path: np.ndarray, radius_m: float, out: Path) -> None:
    """The frame from above and from the side, with the path as wide as the vehicle."""
    figure = new_figure()
    top, side = figure.add_axes((0.05, 0.13, 0.44, 0.8)), figure.add_axes((0.55, 0.35, 0.43, 0.4))
    draw_top(top, frame)
    draw_side(side, frame)
    line(top, path[:, 1], path[:, 0], radius_m)
    line(side, path[:, 0], -path[:, 2], radius_m)
    figure.savefig(out)


def line(ax: Any, x: np.ndarray, y: np.ndarray, radius_m: float) -> None:
    from matplotlib.patches import Circle

    for at in zip(x, y, strict=True):
        ax.add_patch(Circle(at, radius_m, color="#8e24aa", alpha=0.15, linewidth=0, zorder=9))
    ax.plot(x, y, color="#8e24aa", linewidth=2.5, marker="o", markersize=3, zorder=10)


def main() -> int:
    args = arguments()
    try:
        drawing_library()
    except DriverError as error:
        print(error, file=sys.stderr)
        return 1
    try:
        frame = logged(args.log, args.frame) if args.log else simulated(args.scene)
    except (DriverError, IndexError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    if frame.model is None or not frame.model.valid:
        print(f"the frame is blind: {frame.cause}", file=sys.stderr)
        return 1
    reach = frame.info.max_range_m
    model = cast(CameraModel, frame.model)  # both classes have the same fields
    room = Room(
        space=Space([PlacedModel(model, (0.0, 0.0, 0.0))]),
        radius_m=args.radius,
        start=np.zeros(3),
        been_m=args.been,
        unknown=Unknown(args.unknown),
    )
    try:
        path = plan(room, args.goal, [[-1.0, -reach, -4.0], [reach, reach, 2.0]], planner=args.planner, seed=args.seed)
    except NoPath as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{args.planner}: {len(path)} corners, {np.linalg.norm(np.diff(path, axis=0), axis=1).sum():.1f} m")
    draw(frame, path, args.radius, args.o)
    print(args.o)
    return 0


if __name__ == "__main__":
    sys.exit(main())
