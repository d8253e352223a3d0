"""A simulated camera that renders what the vehicle of an autopilot sees."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from core.frames import quaternion_from_euler
from core.types import UNKNOWN_MM, AttitudeSample, CameraMount, PoseSample
from drivers.base import DeviceNotFound
from drivers.simulation import following_camera
from drivers.simulation.autopilot import PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState
from drivers.simulation.flights import flight_plan
from drivers.simulation.following_camera import FollowingDepthSource, FollowSettings
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import PERFECT, SensorModel
from drivers.simulation.source import camera_info
from tests.ports import free_port

NS = 1_000_000_000
INFO = camera_info(80, 60)


def walled() -> object:
    """A wall 10 m ahead of the origin, facing south."""
    b = SceneBuilder("wall")
    b.ground()
    b.box("wall", 10.15, 0.0, 0.3, 60.0, 20.0)
    return replace(flight_plan("demo"), scene=b.build(), sensor=PERFECT)


def depth_at(position_ned_m: tuple[float, float, float], yaw_deg: float = 0.0, mount: CameraMount | None = None) -> int:
    """Depth in the middle of the image, mm, for samples that are given by hand."""
    info = INFO if mount is None else replace(INFO, mount=mount)
    now_ns = [5 * NS]
    camera = FollowingDepthSource(walled(), info, FollowSettings(address="udpin:127.0.0.1:1"), lambda: now_ns[0])
    q = quaternion_from_euler(0.0, 0.0, math.radians(yaw_deg))
    camera.deliver(
        [
            PoseSample(5 * NS - NS // 10, 5 * NS, position_ned_m, (1.0, 0.0, 0.0)),
            AttitudeSample(5 * NS, 5 * NS, q, (0.0, 0.0, 0.0)),
        ]
    )
    frame = camera.read(0.0)
    assert frame is not None
    assert frame.t_exposure_ns == 5 * NS
    assert camera.read(0.0) is None  # no newer attitude
    now_ns[0] += NS
    assert camera.read(0.0) is None  # stale
    return int(np.median(frame.depth_mm[28:32, 38:42]))


@pytest.mark.parametrize(
    ("north_m", "yaw_deg", "depth_mm"),
    [(0.0, 0.0, 9900), (4.0, 0.0, 5900), (0.0, 30.0, round(9900 / math.cos(0.5236)))],
)
def test_it_renders_what_is_seen_from_there(north_m: float, yaw_deg: float, depth_mm: int) -> None:
    """The position is 0.1 s older than the attitude, and moves at 1 m/s. Depth is along the optical axis."""
    assert depth_at((north_m, 0.0, -5.0), yaw_deg) == pytest.approx(depth_mm, rel=0.01)


def test_its_faults_are_those_of_its_width() -> None:
    """As those of the camera that flies a path: lengths in pixels are stated for 640 px."""
    plan = replace(walled(), sensor=SensorModel(blind_left_px=160))
    camera = FollowingDepthSource(plan, INFO, FollowSettings(address="udpin:127.0.0.1:1"), lambda: 5 * NS)
    q = quaternion_from_euler(0.0, 0.0, 0.0)
    camera.deliver([PoseSample(5 * NS, 5 * NS, (0.0, 0.0, -5.0)), AttitudeSample(5 * NS, 5 * NS, q, (0.0, 0.0, 0.0))])
    frame = camera.read(0.0)
    assert frame is not None
    assert (frame.depth_mm[30, :20] == UNKNOWN_MM).all()
    assert (frame.depth_mm[30, 20:] > 0).all()


def test_no_frame_is_stamped_by_an_uncertain_clock_in_a_turn() -> None:
    """The stamp is that of the attitude by the camera's own estimate of the clock. Another process has another estimate: in a turn it
    finds another attitude for the image, which looks like a wrong mount."""
    camera = FollowingDepthSource(walled(), INFO, FollowSettings(address="udpin:127.0.0.1:1"), lambda: 5 * NS)
    q = quaternion_from_euler(0.0, 0.0, 0.0)
    camera.deliver([PoseSample(5 * NS, 5 * NS, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0))])
    for rate_rad_s, error_ms, used in ((1.0, 25, False), (1.0, 5, True)):
        camera.deliver([AttitudeSample(5 * NS, 5 * NS, q, (0.0, rate_rad_s, 0.0), error_ms * 1_000_000)])
        assert (camera.read(0.0) is not None) == used
    still = FollowingDepthSource(walled(), INFO, FollowSettings(address="udpin:127.0.0.1:1"), lambda: 5 * NS)
    still.deliver([PoseSample(5 * NS, 5 * NS, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0))])
    still.deliver([AttitudeSample(5 * NS, 5 * NS, q, (0.0, 0.01, 0.0), 30_000_000)])
    assert still.read(0.0) is not None


def test_the_mount_counts() -> None:
    turned = CameraMount(yaw_rad=math.radians(30.0))
    assert depth_at((0.0, 0.0, -5.0), -30.0, turned) == pytest.approx(9900, rel=0.01)


@pytest.mark.process
def test_it_follows_an_autopilot_over_udp() -> None:
    """The project's own simulated autopilot flies north at 1 m/s."""
    begun_ns, port = time.monotonic_ns(), free_port()

    def motion(now_ns: int) -> VehicleState:
        still = (0.0, 0.0, 0.0)
        north_m = max(0.0, (now_ns - begun_ns) / NS)
        return VehicleState(
            position_ned_m=(north_m % 6.0, 0.0, -5.0),
            velocity_ned_m_s=(1.0, 0.0, 0.0),
            euler_rad=still,
            rates_frd_rad_s=still,
        )

    autopilot = SimulatedAutopilot(FirmwareProfile(kind=PX4, motion=motion, boot_at_ns=begun_ns - 30 * NS))
    settings = FollowSettings(address=f"udpin:127.0.0.1:{port}", fps=20.0)
    with (
        AutopilotLink(autopilot, UdpEnd("127.0.0.1", port)),
        FollowingDepthSource(walled(), INFO, settings, time.monotonic_ns) as camera,
    ):
        frames = []
        end_ns = time.monotonic_ns() + 120 * NS
        while len(frames) < 12 and time.monotonic_ns() < end_ns:
            frame = camera.read(0.5)
            if frame is not None:
                frames.append(frame)
    assert [f.sequence for f in frames] == list(range(12))
    for frame in frames[4:]:  # the clock is synchronised by then
        expected_m = 10.0 - motion(frame.t_exposure_ns).position_ned_m[0]
        assert frame.depth_mm[30, 40] / 1000.0 == pytest.approx(expected_m, abs=0.15)


def test_without_an_autopilot_it_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following_camera, "OPEN_S", 0.2)
    settings = FollowSettings(address=f"udpin:127.0.0.1:{free_port()}")
    camera = FollowingDepthSource(walled(), INFO, settings, time.monotonic_ns)
    with pytest.raises(DeviceNotFound, match="no attitude or no position is received"):
        camera.open()
