"""A vehicle that its autopilot stops before a wall, and after a loss of its camera: the sent sectors drawn over the
scene.

Run: .venv/bin/python examples/avoid_flight.py [avoid.png]

Everything is simulated: the camera, and models of the PX4 and ArduPilot firmware; the pipeline and the messages are
those of the service."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Patch, Polygon, Wedge
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import UNKNOWN, clear_cm, obstacle_distance_message
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4 import Px4Reader
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import camera_info, render

MS, NS = 1_000_000, 1_000_000_000
MARGIN_M, FASTEST_M_S, BRAKE_M_S2, HEIGHT_M = 2.5, 3.0, 2.0, 1.6
CAMERA = camera_info(160, 120)
SENSOR = SensorModel(ke_per_m=0.0015, sky_is_far=True)
AVOID = AvoidParams(send=True, radius_m=0.3, max_distance_m=12.0, avoid_margin_m=MARGIN_M)
COLORS = {"obstacle": "#d0342c", "wall": "#8e44ad", "clear": "#7cc47f", "unknown": "#c9ccd1"}


def scene() -> Scene:
    """Poles and a hut beside the path, a wall across it at 20 m."""
    b = SceneBuilder("yard")
    b.ground()
    for x, y in ((8.5, -4.2), (11.5, 4.4), (15.0, -4.6)):
        b.pole("pole", x, y, 0.14, 4.5)
    b.box("hut", 14.5, 7.4, 4.0, 2.5, 3.0, 0.4)
    b.box("wall", 20.15, 1.0, 0.3, 22.0, 5.0)
    return b.build()


@dataclass
class Flight:
    """Flies northwards as fast as the autopilot model allows; the camera's last frame is taken at fails_at_m.

    values: the last sent sectors, (72,) cm, None: nothing is sent; blind: whether by a blind camera."""

    autopilot: str
    scene: Scene
    fails_at_m: float = math.inf
    x_m: float = 0.0
    speed_m_s: float = 0.0
    now_ns: int = 100 * NS
    values: NDArray[np.uint16] | None = None
    blind: bool = True
    track_m: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        px4 = self.autopilot == "PX4"
        self.reader = Px4Reader(cp_dist_m=MARGIN_M) if px4 else ArduPilotReader(margin_m=MARGIN_M, filter_hz=1.0)
        self.pipeline = Pipeline((CAMERA,), lambda info: Extractor())
        self.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=(CAMERA.camera,), timeout_s=0.3))
        self.builder.announce(CAMERA)

    def fly(self, seconds: float) -> None:
        """Steps of 20 ms; a frame and a message in every fifth."""
        for step in range(round(50 * seconds)):
            self.now_ns += 20 * MS
            position = (self.x_m, 0.0, -HEIGHT_M)
            samples: list[AttitudeSample | PoseSample] = [
                AttitudeSample(self.now_ns, self.now_ns, quaternion_from_euler(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
                PoseSample(self.now_ns, self.now_ns, position, (self.speed_m_s, 0.0, 0.0)),
            ]
            for sample in samples:
                self.pipeline.handle(sample)
            self.builder.samples(samples)
            if step % 5 == 0:
                if self.x_m < self.fails_at_m:
                    self.see(position)
                self.send()
            self.move(0.02)

    def see(self, position_ned_m: tuple[float, float, float]) -> None:
        """Passes a frame through the pipeline to the obstacle sender."""
        number = self.now_ns // (20 * MS)
        seen = render(self.scene, CAMERA, position_ned_m=position_ned_m, sensor=SENSOR, seed=7, frame=number)
        frame = DepthFrame(
            camera=CAMERA.camera,
            sequence=number,
            t_exposure_ns=self.now_ns,
            t_arrival_ns=self.now_ns,
            depth_mm=seen.depth_mm,
        )
        for output in self.pipeline.handle(frame):
            if isinstance(output, PrismsResult):
                self.builder.result(output)

    def send(self) -> None:
        """What the service sends at this instant, and what the autopilot makes of it."""
        report = self.builder.decide(
            AutopilotNow(kind=self.autopilot, margin_m=MARGIN_M, cp_dist_m=MARGIN_M), self.now_ns
        )
        self.values, self.blind = report.values, bool(report.blind)
        if report.values is not None:
            self.reader.read(obstacle_distance_message(report.values, self.now_ns // 1000, AVOID), self.now_ns)

    def move(self, dt_s: float) -> None:
        """PX4: as fast as it can stop within the room that it believes in; ArduPilot: as one was measured."""
        if isinstance(self.reader, ArduPilotReader):
            wanted = self.reader.velocity_m_s((FASTEST_M_S, 0.0), self.now_ns)[0]
        else:
            room_m = self.reader.room_m(0.0, self.now_ns)
            wanted = min(FASTEST_M_S, math.sqrt(2.0 * BRAKE_M_S2 * max(0.0, room_m - 0.3 * self.speed_m_s)))
        self.speed_m_s += max(-1.5 * BRAKE_M_S2 * dt_s, min(BRAKE_M_S2 * dt_s, wanted - self.speed_m_s))
        self.x_m += self.speed_m_s * dt_s
        self.track_m.append(self.x_m)


def meaning(cm: int, blind: bool) -> str:
    """The meaning of a sector's value."""
    if cm == UNKNOWN:
        return "unknown"
    if cm >= clear_cm(AVOID):
        return "clear"
    return "wall" if blind else "obstacle"


def draw(axes: Any, flight: Flight, title: str) -> None:
    """The scene from above, north up, and the 72 sent sectors around the vehicle."""
    values = flight.values if flight.values is not None else np.full(72, UNKNOWN, np.uint16)
    for i, cm in enumerate(values.tolist()):
        what = meaning(cm, flight.blind)
        # drawn from the hull: distances count from there
        far_m = AVOID.radius_m + min(cm / 100.0, AVOID.max_distance_m)
        middle = 90.0 - 5.0 * i  # matplotlib counts from the right, counter-clockwise
        thing = what in ("obstacle", "wall")
        near_m = max(0.0, far_m - 0.45) if thing else 0.0
        if what == "obstacle":
            axes.add_patch(_wedge(flight.x_m, near_m, middle, 0.0, COLORS["clear"], 0.18))
        axes.add_patch(_wedge(flight.x_m, far_m, middle, near_m, COLORS[what], 0.75 if thing else 0.35))
    for corners, label in zip(flight.scene.corners, flight.scene.label, strict=True):
        if label >= 0:
            outline = _outline(corners)
            axes.add_patch(Polygon(outline, closed=True, facecolor="#3c4048", zorder=5))
            if np.ptp(outline, axis=0).max() < 0.5:  # drawn larger than it is, to be visible
                axes.plot(*outline.mean(axis=0), marker="o", markersize=4, color="#3c4048", zorder=5)
    axes.plot([0.0] * len(flight.track_m), flight.track_m, color="#1f5fbf", linewidth=1.6, zorder=6)
    axes.plot([0.0], [flight.x_m], marker="^", markersize=10, color="black", zorder=7)
    axes.set_xlim(-9.0, 9.0)
    axes.set_ylim(-2.0, 23.0)
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=9, loc="left")
    axes.tick_params(labelsize=7)


def _wedge(x_m: float, far_m: float, middle_deg: float, near_m: float, color: str, alpha: float) -> Any:
    width = far_m - near_m
    return Wedge((0.0, x_m), far_m, middle_deg - 2.4, middle_deg + 2.4, width=width, color=color, alpha=alpha, lw=0)


def _outline(corners_ned_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 2) of a solid's box from above, east and north."""
    from_above = corners_ned_m[:, [1, 0]]
    outline: NDArray[np.float64] = from_above[ConvexHull(from_above).vertices]
    return outline


def flights() -> list[tuple[str, Flight]]:
    """The moments that are drawn."""
    yard = scene()
    under_way, stands = Flight("PX4", yard), Flight("PX4", yard)
    under_way.fly(2.6)
    stands.fly(15.0)
    moments = [
        (f"On the way,\n{under_way.speed_m_s:.1f} m/s", under_way),
        (f"PX4 with CP_DIST = {MARGIN_M:g} m\nstands {20.0 - stands.x_m:.1f} m before the wall", stands),
    ]
    for autopilot, sent in (("PX4", "unknown"), ("ArduPilot", "artificial wall")):
        blind = Flight(autopilot, yard, fails_at_m=5.0)
        blind.fly(6.0)
        text = "no message" if blind.values is None else sent
        title = f"{autopilot}, camera lost at {blind.fails_at_m:g} m:\nsent: {text}; {abs(blind.speed_m_s):.1f} m/s"
        moments.append((title, blind))
    return moments


def main(arguments: list[str] | None = None) -> int:
    """Flies, draws and prints where the vehicle stopped."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", nargs="?", type=Path, default=Path("avoid.png"))
    picture: Path = parser.parse_args(arguments).picture
    moments = flights()
    figure, panels = plt.subplots(1, len(moments), figsize=(12.5, 5.6), sharey=True, layout="constrained")
    for axes, (title, flight) in zip(panels, moments, strict=True):
        draw(axes, flight, title)
        print(f"{title.replace(chr(10), ' ')}; at {flight.x_m:.2f} m")
    panels[0].set_ylabel("north, m", fontsize=8)
    names = {"obstacle": "obstacle", "wall": "artificial wall", "clear": "seen clear", "unknown": "unknown"}
    handles = [Patch(color=COLORS[key], alpha=0.7, label=name) for key, name in names.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(picture, dpi=100)
    plt.close(figure)
    print(f"written: {picture}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
