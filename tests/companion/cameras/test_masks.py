"""Masked parts of the vehicle: unknown, no obstacle, no free space behind them; and the output to autopilots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.camera_coverage import Look, looked_into
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_memory import Here
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.polar_histogram import SectorState, scan
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.vehicle_motion import VehicleMotion
from companion.autopilot.view_free import RING_M
from companion.cameras.masks import apply_mask, configured_mask, outside_text, polygons, unmeasured_mask
from companion.config.avoidance import AvoidParams
from companion.config.camera import CameraConfig
from companion.config.loader import Config, ConfigError, config_of, config_text
from companion.doctor import camera_check
from companion.doctor.finding import Finding
from companion.pipeline.configured import make_pipeline
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraInfo, DepthFrame
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import camera_info, render

MS = 1_000_000
INFO = camera_info(160, 120)
AVOID = AvoidParams(radius_m=0.3, max_distance_m=10.0, recover_frames=1)
ARM = "0,0 44,66"
"""An arm with its propeller: the upper left of the image, to below its middle."""


def section(masks: str = "", **more: object) -> CameraConfig:
    return CameraConfig(name="front", kind="simulated", masks=masks, **more)


def flown(
    masks: str = "", unmatched_left_px: int | None = None, arm: bool = True
) -> tuple[ObstacleReportBuilder, PrismsResult, int]:
    """A second of frames of an open field with an arm of the vehicle 0.5 m away in the image."""
    b = SceneBuilder("field")
    b.ground()
    b.box("horizon", 60.0, 0.0, 0.3, 200.0, 12.0)
    scene = b.build()
    camera = section(masks, unmatched_left_px=unmatched_left_px)
    pipeline = Pipeline((INFO,), lambda info: Extractor(), mask=lambda info: configured_mask(camera, info))
    builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front",), timeout_s=0.3))
    builder.announce(INFO, unmeasured_mask(camera, INFO, 0.02))
    result, now_ns = None, 0
    for n in range(1, 11):
        now_ns = n * 100 * MS
        sample = AttitudeSample(now_ns, now_ns, quaternion_from_euler(0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        pipeline.handle(sample)
        builder.samples([sample])
        sensor = SensorModel(ke_per_m=0.0015, sky_is_far=True)
        depth = render(scene, INFO, position_ned_m=(0.0, 0.0, -1.5), sensor=sensor, seed=3, frame=n).depth_mm.copy()
        if arm:
            depth[:64, :42] = 500
        if unmatched_left_px:
            depth[:, :unmatched_left_px] = 0
        frame = DepthFrame(camera="front", sequence=n, t_exposure_ns=now_ns, t_arrival_ns=now_ns, depth_mm=depth)
        for output in pipeline.handle(frame):
            if isinstance(output, PrismsResult):
                result = output
                builder.result(output)
    assert result is not None
    return builder, result, now_ns


def sectors_of(builder: ObstacleReportBuilder, kind: str, now_ns: int) -> np.ndarray:
    values = builder.decide(AutopilotNow(kind=kind, margin_m=2.0), now_ns).values
    assert values is not None
    return values


def test_an_arm_is_an_obstacle_until_it_is_masked_and_then_unknown() -> None:
    builder, _, now_ns = flown()
    left = [65, 66, 67]  # 35 to 25 degrees to the left
    assert (sectors_of(builder, "PX4", now_ns)[left] < 100).any()
    builder, result, now_ns = flown(ARM)
    values = sectors_of(builder, "PX4", now_ns)
    assert (values >= 1001).all()  # no obstacle anywhere
    assert (values[left] == UNKNOWN).all()  # but nothing is clear behind the arm
    assert (values[0:4] == 1001).all()
    view = VehicleMotion().view(result, Here(0.0), INFO, RING_M, False)
    assert scan([view], AVOID).state[66] == SectorState.UNSEEN


def test_behind_a_mask_no_wall_stands_for_ever_and_in_a_blind_view_it_does() -> None:
    """Masked sectors can never be clear: they count as unobserved. When the camera
    is blind, what is seen of them below the arm is gone too."""
    builder, _, now_ns = flown(ARM)
    values = sectors_of(builder, "ArduPilot", now_ns)
    assert (values[65:68] == UNKNOWN).all()
    assert (values[0:6] == 1001).all()
    late = sectors_of(builder, "ArduPilot", now_ns + 500 * MS)
    assert (late[65:68] == 212).all()
    assert (late[0:6] == 212).all()


def test_unmatched_columns_hide_nothing() -> None:
    builder, _, now_ns = flown(unmatched_left_px=40, arm=False)
    values = sectors_of(builder, "ArduPilot", now_ns)
    assert (values[65:68] == UNKNOWN).all()
    assert (values[0:6] == 1001).all()
    walls, _, now_ns = flown(unmatched_left_px=None, arm=True)
    assert (sectors_of(walls, "ArduPilot", now_ns)[65:68] < 1000).all()


def test_an_obstacle_beside_and_below_a_mask_is_reported() -> None:
    depth = np.full((120, 160), 4000, np.uint16)
    hidden_px = configured_mask(section(ARM), INFO)
    out = apply_mask(depth, hidden_px)
    assert (out[:60, :40] == 0).all()
    assert (out[70:, :] == 4000).all()
    assert (out[:, 50:] == 4000).all()
    assert (depth == 4000).all()


def test_polygons_and_rectangles() -> None:
    assert polygons("0,0 8,4; 1,1 5,1 1,5") == [[(0, 0), (8, 0), (8, 4), (0, 4)], [(1, 1), (5, 1), (1, 5)]]
    assert polygons("") == []
    mask = configured_mask(section("10,20 30,40; 100,100 140,100 100,119"), INFO)
    assert mask is not None
    assert mask[20:40, 10:30].all()
    assert mask.sum() == 20 * 20 + sum(math.ceil(40 * (19 - row) / 19) for row in range(19))
    assert mask[101, 102]
    assert not mask[118, 138]
    whole = configured_mask(section("-5,-5 400,400"), INFO)
    assert whole is not None
    assert whole.all()


@pytest.mark.parametrize("text", ["1,2", "1,2 3", "a,b c,d", "1,2 3,4;", "1 2 3 4"])
def test_what_is_no_polygon_is_refused_with_its_key(text: str) -> None:
    with pytest.raises(ConfigError, match="masks"):
        config_of({"camera": [{"name": "front", "masks": text}]}, "test")


def test_a_mask_outside_of_the_image_is_named() -> None:
    """As one that was drawn in a larger image. It hid nothing, without a word."""
    assert outside_text(section(), INFO) == ""
    assert outside_text(section(ARM), INFO) == ""
    assert outside_text(section("-20,-20 0.5,0.5; 150,110 700,500"), INFO) == ""  # partly in the image
    text = outside_text(section(f"{ARM}; 160,0 200,60; 0,500 80,500 40,600"), INFO)
    assert text.startswith(
        "masks: no pixel of the image of 160x120 is in 160,0 200,0 200,60 160,60; 0,500 80,500 40,600:"
    )
    mask = configured_mask(section("160,0 200,60"), INFO)
    assert mask is not None
    assert not mask.any()


@pytest.mark.parametrize(("masks", "number"), [("0,0 80,60", 1), ("900,0 990,60", 2)])
def test_the_doctor_finds_a_mask_outside_of_the_image(masks: str, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    fine = Finding("camera front", True, "640x480")
    monkeypatch.setattr(camera_check, "camera_finding", lambda *_: (fine, INFO))
    found = list(camera_check.camera_findings(Config(cameras=(section(masks),)), 1.0))
    assert len(found) == number
    assert found[-1].ok is (number == 1)
    assert ("900,0" in found[-1].text) is (number == 2)


def test_a_zed_never_matches_its_first_columns_unless_configured_otherwise() -> None:
    zed = CameraConfig(name="z", kind="zed", device="/dev/video9", calibration="SN1.conf", disparities=32)
    assert replace(zed, disparities=17).unmatched_px == 32, "the matcher searches a multiple of 16"
    mask = unmeasured_mask(zed, INFO, 0.02)
    assert mask is not None
    assert mask[:, :32].all()
    assert not mask[:, 32:].any()
    assert unmeasured_mask(replace(zed, unmatched_left_px=0), INFO, 0.02) is None
    assert unmeasured_mask(section(), INFO, 0.02) is None


@pytest.mark.parametrize(("columns", "kept"), [(155, True), (157, False)])
def test_a_mask_that_leaves_too_few_pixels_for_a_valid_frame_takes_no_direction_from_the_view(
    columns: int, kept: bool
) -> None:
    """Corners that are typed as the last column and row leave these two."""
    assert INFO.intrinsics.width == 160
    mask = unmeasured_mask(section(f"0,0 {columns},120"), INFO, 0.02)
    assert (mask is not None) is kept


def test_coverage_counts_what_is_left_of_the_heights() -> None:
    free = looked_into(INFO, AVOID).look
    assert set(np.unique(free)) == {Look.NOTHING, Look.WHOLE}
    corner = looked_into(INFO, AVOID, configured_mask(section("0,0 44,30"), INFO)).look  # above the band
    assert (corner == free).all()
    arm = looked_into(INFO, AVOID, configured_mask(section(ARM), INFO)).look
    assert (arm[66] == Look.SOME).all()
    column = looked_into(INFO, AVOID, configured_mask(section("0,0 44,120"), INFO)).look
    assert (column[66] == Look.NOTHING).all()
    assert (column[3] == Look.WHOLE).all()


def test_a_replay_masks_what_the_configuration_masks() -> None:
    """The log holds what the camera gave; the same configuration gives the same prisms."""
    config = config_of({"camera": [{"name": "front", "masks": ARM}]}, "test")
    assert "0,0 44,66" in config_text(config)
    assert models(make_pipeline(config, (INFO,)), 500) == models(make_pipeline(config, (INFO,)), 2000)
    bare = config_of({}, "test")
    assert models(make_pipeline(bare, (INFO,)), 500) != models(make_pipeline(bare, (INFO,)), 2000)


def models(pipeline: Pipeline, arm_mm: int) -> list[bytes]:
    """The planes of a frame in which the masked place shows something at a distance."""
    depth = np.full((120, 160), 6000, np.uint16)
    depth[:60, :40] = arm_mm
    pipeline.handle(AttitudeSample(MS, MS, quaternion_from_euler(0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    frame = DepthFrame(camera="front", sequence=1, t_exposure_ns=MS, t_arrival_ns=MS, depth_mm=depth)
    return [
        o.model.planes.tobytes() + o.model.free.free_to_m.tobytes()
        for o in pipeline.handle(frame)
        if isinstance(o, PrismsResult) and o.model is not None
    ]


def test_a_camera_with_a_new_description_gets_a_new_mask() -> None:
    seen: list[CameraInfo] = []

    def mask(info: CameraInfo) -> np.ndarray | None:
        seen.append(info)
        return configured_mask(section(ARM), info)

    pipeline = Pipeline((), lambda info: Extractor(), mask=mask)
    larger = camera_info(320, 240)
    pipeline.announce(INFO)
    pipeline.announce(larger)
    assert seen == [INFO, larger]
