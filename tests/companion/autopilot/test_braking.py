"""The whole chain in a closed loop: rendered depth, the extractor, sectors, the message, an autopilot's reader, and a
vehicle that flies as the reader lets it. Time is made by the test; nothing but camera and vehicle is simulated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import pytest

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import obstacle_distance_message
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import quaternion_from_euler
from core.params import Params
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4 import Px4Reader
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import camera_info, render
from tests.nightly import nightly

MS = 1_000_000
NS = 1_000_000_000
MARGIN_M = 2.0
CAMERA = camera_info(160, 120)
SENSOR = SensorModel(ke_per_m=0.0015, sky_is_far=True)
AVOID = AvoidParams(radius_m=0.3, max_distance_m=10.0, avoid_margin_m=MARGIN_M)
PARAMS = Params(passable_width_m=1.0)
BRAKE_M_S2, FASTEST_M_S = 2.0, 3.0


def facade(gap_m: float = 0.0) -> Scene:
    """A wall across the way at 20 m, 6 m high, with a gap in the middle."""
    b = SceneBuilder("facade")
    b.ground()
    for side in (-1.0, 1.0):
        b.box("wall", 20.15, side * (gap_m / 2 + 15.0), 0.3, 30.0, 6.0)
    b.box("horizon", 60.0, 0.0, 0.3, 120.0, 12.0)
    return b.build()


def tree() -> Scene:
    """A trunk of 12 cm on the way, and a wall far behind."""
    b = SceneBuilder("trunk")
    b.ground()
    b.pole("trunk", 20.0, 0.1, 0.12, 5.0)
    b.box("horizon", 60.0, 0.0, 0.3, 120.0, 12.0)
    return b.build()


@dataclass
class Flight:
    """A vehicle that wants north at 3 m/s, 1.5 m up. dies_at_m: the camera's last frame is taken there;
    lean_rad: roll, pitch, in flight; avoid: how the companion is set; textureless: the name of the
    things in the scene that give no depth."""

    scene: Scene
    reader: Px4Reader | ArduPilotReader
    dies_at_m: float = math.inf
    silent_at_m: float = math.inf
    x_m: float = 5.0
    speed_m_s: float = 0.0
    now_ns: int = 100 * NS
    lean_rad: tuple[float, float] = (0.0, 0.0)
    avoid: AvoidParams = AVOID
    params: Params = PARAMS
    textureless: str = ""
    track: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        extractor = Extractor(self.params)
        self.pipeline = Pipeline((CAMERA,), lambda info: extractor)
        self.builder = ObstacleReportBuilder(self.avoid, CameraUse(cameras=("front",), timeout_s=0.3))
        self.builder.announce(CAMERA)
        px4 = isinstance(self.reader, Px4Reader)
        self.autopilot = (
            AutopilotNow(kind="PX4", cp_dist_m=MARGIN_M) if px4 else AutopilotNow(kind="ArduPilot", margin_m=MARGIN_M)
        )

    def fly(self, seconds: float, until_m: float = math.inf) -> None:
        """Steps of 20 ms: attitude and position in each, a frame and a message in every fifth. until_m: ends there."""
        for step in range(round(50 * seconds)):
            if self.x_m > until_m:
                return
            self.now_ns += 20 * MS
            position = (self.x_m, 0.0, -1.5)
            samples: list[AttitudeSample | PoseSample] = [
                AttitudeSample(self.now_ns, self.now_ns, quaternion_from_euler(*self.lean_rad, 0.0), (0.0, 0.0, 0.0)),
                PoseSample(self.now_ns, self.now_ns, position, (self.speed_m_s, 0.0, 0.0)),
            ]
            if self.x_m < self.silent_at_m:
                for sample in samples:
                    self.pipeline.handle(sample)
                self.builder.samples(samples)
            if step % 5 == 0:
                if self.x_m < self.dies_at_m:
                    self._see(step // 5, position)
                report = self.builder.decide(self.autopilot, self.now_ns)
                if report.values is not None:
                    self.reader.read(obstacle_distance_message(report.values, 0, self.avoid), self.now_ns)
            self._move(0.02)
            self.track.append((self.x_m, self.speed_m_s))

    def _see(self, n: int, position: tuple[float, float, float]) -> None:
        roll_rad, pitch_rad = self.lean_rad
        seen = render(
            self.scene,
            CAMERA,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            position_ned_m=position,
            sensor=SENSOR,
            seed=7,
            frame=n,
        )
        depth_mm = seen.depth_mm.copy()
        if self.textureless in self.scene.names:
            depth_mm[seen.truth.label(self.scene) == self.scene.names.index(self.textureless)] = 0
        frame = DepthFrame(
            camera="front", sequence=n, t_exposure_ns=self.now_ns, t_arrival_ns=self.now_ns, depth_mm=depth_mm
        )
        for output in self.pipeline.handle(frame):
            if isinstance(output, PrismsResult):
                self.builder.result(output)

    def _move(self, dt_s: float) -> None:
        self.speed_m_s = speed_after(self.reader, self.speed_m_s, self.now_ns, dt_s)
        self.x_m += self.speed_m_s * dt_s


def speed_after(reader: Px4Reader | ArduPilotReader, speed_m_s: float, now_ns: int, dt_s: float) -> float:
    """Forward speed a moment later of a vehicle that wants to fly ahead. PX4: as fast as it can still stop within the room
    that it believes in; ArduPilot: as it was measured."""
    if isinstance(reader, ArduPilotReader):
        wanted = reader.velocity_m_s((FASTEST_M_S, 0.0), now_ns)[0]
    else:
        room_m = reader.room_m(0.0, now_ns)
        wanted = min(FASTEST_M_S, math.sqrt(2.0 * BRAKE_M_S2 * max(0.0, room_m - 0.3 * speed_m_s)))
    return speed_m_s + max(-BRAKE_M_S2 * 1.5 * dt_s, min(BRAKE_M_S2 * dt_s, wanted - speed_m_s))


def px4() -> Px4Reader:
    return Px4Reader(cp_dist_m=MARGIN_M)


def coarse_px4() -> Px4Reader:
    return Px4Reader(bin_deg=10, cp_dist_m=MARGIN_M)


def ardupilot() -> ArduPilotReader:
    return ArduPilotReader(margin_m=MARGIN_M)


@pytest.mark.parametrize(
    ("reader", "scene"), [(px4, facade), (ardupilot, tree), *nightly((coarse_px4, tree), (ardupilot, facade))]
)
def test_it_stops_before_what_stands_in_its_way(reader: type, scene: type) -> None:
    flight = Flight(scene(), reader(), x_m=11.0)
    flight.fly(7.5)
    assert max(speed for _, speed in flight.track) > 2.0  # it flew
    assert max(x for x, _ in flight.track) <= 20.0 - MARGIN_M + 0.1
    assert 20.0 - flight.x_m < MARGIN_M + 1.5  # and came near
    assert abs(flight.speed_m_s) < 0.1


@pytest.mark.parametrize("reader", [coarse_px4, ardupilot, *nightly(px4)])
def test_it_passes_a_gap_of_twice_the_margin_and_a_metre(reader: type) -> None:
    flight = Flight(facade(gap_m=2 * MARGIN_M + 1.0), reader(), x_m=12.0)
    flight.fly(20.0, until_m=22.0)
    assert flight.x_m > 22.0


@pytest.mark.parametrize("reader", [px4, ardupilot, *nightly(coarse_px4)])
def test_it_does_not_fly_into_a_column_without_texture_before_a_wall(reader: type) -> None:
    """The planes close the gap that the column leaves in the wall 5 m behind it."""
    b = SceneBuilder("column")
    b.ground()
    b.box("column", 8.3, 0.0, 0.6, 0.6, 6.0)
    b.box("wall", 13.15, 0.0, 0.3, 40.0, 6.0)
    flight = Flight(b.build(), reader(), textureless="column")
    flight.fly(5.0)
    assert max(x for x, _ in flight.track) < 8.0 - AVOID.radius_m


def test_ardupilots_low_pass_as_delivered_brakes_in_time() -> None:
    """PRX_FILT of 0.25 Hz sees a wall that comes nearer where it was 0.6 s ago."""
    flight = Flight(facade(), ArduPilotReader(margin_m=MARGIN_M, filter_hz=0.25), x_m=11.0)
    flight.fly(8.0)
    assert 19.0 - MARGIN_M < max(x for x, _ in flight.track) <= 20.0 - MARGIN_M + 0.1


@pytest.mark.parametrize(
    ("reader", "fault"),
    [(px4, "autopilot's motion"), (ardupilot, "camera"), *nightly((px4, "camera"), (ardupilot, "autopilot's motion"))],
)
def test_it_stops_when_the_chain_breaks(reader: type, fault: str) -> None:
    """Towards a wall that is no longer observed."""
    flight = Flight(facade(), reader())
    if fault == "camera":
        flight.dies_at_m = 9.0
    else:
        flight.silent_at_m = 9.0
    flight.fly(8.0)
    assert max(speed for _, speed in flight.track) > 2.0
    assert flight.x_m < 15.0
    assert (
        abs(flight.speed_m_s) < 0.35
    )  # ArduPilot may settle at its margin from the wall of the policy, no farther back
    assert flight.x_m > 7.0


@pytest.mark.parametrize(
    ("reader", "pitch_deg", "roll_deg"),
    # at 10 degrees both ways the lower part of the outermost sector is not in the image: ArduPilot, whose faces are 45
    # degrees wide, stops for it unless it was seen before
    [(px4, -10.0, 10.0), (px4, 8.0, 10.0), (ardupilot, -10.0, 0.0), (ardupilot, -6.0, 10.0), (ardupilot, 8.0, 10.0)],
)
def test_a_clear_field_stops_no_vehicle_that_leans(reader: type, pitch_deg: float, roll_deg: float) -> None:
    """A vehicle leans forward to fly forward, and backward to brake: the camera then sees the whole height of the band
    only from some metres on."""
    b = SceneBuilder("field")
    b.ground()
    b.box("horizon", 60.0, 0.0, 0.3, 200.0, 12.0)
    vehicle = reader()
    flight = Flight(b.build(), vehicle)
    flight.lean_rad = (math.radians(roll_deg), math.radians(pitch_deg))
    flight.fly(1.0)
    aside_deg = 10.0 if reader is px4 else 20.0  # nearer to the edge of the view the hull would pass beside it
    assert all(vehicle.room_m(d, flight.now_ns) == math.inf for d in (-aside_deg, 0.0, aside_deg))


def open_field() -> Scene:
    """Bare ground, a wall at the end."""
    b = SceneBuilder("field")
    b.ground()
    b.box("horizon", 90.0, 0.0, 0.3, 200.0, 12.0)
    return b.build()


THIN_LAYERS = replace(PARAMS, profile_layer_m=0.5, profile_layers=13)


@pytest.mark.parametrize(
    ("reader", "pitch_deg", "params"),
    [
        (px4, -21.0, PARAMS),
        (px4, -25.0, THIN_LAYERS),
        *nightly((px4, -15.0, PARAMS), (coarse_px4, -21.0, PARAMS)),
    ],
)
def test_a_vehicle_that_leans_into_its_flight_flies_on(reader: type, pitch_deg: float, params: Params) -> None:
    """Leaning by 21 degrees a camera 56 degrees high looks 7 degrees above the horizon: the upper part of the near band was
    seen free from farther away, and that counts. Without it PX4 stops in mid-flight."""
    reached = {}
    for remember_s in (0.0, 3.0):
        flight = Flight(open_field(), reader(), avoid=replace(AVOID, remember_free_s=remember_s), params=params)
        flight.fly(1.0)
        assert flight.speed_m_s > 0.5
        flight.lean_rad = (0.0, math.radians(pitch_deg))
        flight.fly(4.0)
        reached[remember_s] = (flight.speed_m_s, flight.x_m)
    assert reached[3.0][0] > 2.5
    assert reached[3.0][1] > 15.0
    assert (reached[0.0][0] < 0.1) == (pitch_deg < -18.0)


@pytest.mark.parametrize("remember_s", [3.0, *nightly(0.0)])
def test_a_vehicle_that_hovers_leaning_has_never_seen_the_upper_half_and_stands(remember_s: float) -> None:
    flight = Flight(open_field(), px4(), avoid=replace(AVOID, remember_free_s=remember_s))
    flight.lean_rad = (0.0, math.radians(-25.0))
    flight.fly(2.0)
    begun_m = flight.x_m
    assert begun_m < 5.05  # before the camera counts as seeing, the artificial wall stands 2 cm outside CP_DIST
    flight.fly(3.0)
    assert flight.x_m == begun_m


def test_what_is_remembered_free_ends_with_the_camera_and_with_time() -> None:
    flight = Flight(open_field(), px4(), dies_at_m=9.0)
    flight.fly(1.0)
    flight.lean_rad = (0.0, math.radians(-18.0))
    flight.fly(4.0)
    assert flight.reader.room_m(0.0, flight.now_ns) < 0.1
    assert flight.x_m < 13.0
