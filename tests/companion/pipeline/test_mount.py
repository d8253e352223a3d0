"""The mount's check in the pipeline, the messages, the health report, and in replay."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest

from companion.cameras.status import CameraCondition, CameraStatus
from companion.diagnostic import DiagnosticCode
from companion.live.health import CameraView, camera_message
from companion.live.status import status_lines
from companion.pipeline.encode import prisms_from_message, prisms_message
from companion.pipeline.mount_messages import (
    mount_diagnostic,
    mount_health,
    mount_state_from_message,
    mount_state_message,
    mount_text,
)
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import Output, PrismsResult
from companion.pipeline.state import CameraState, PipelineState
from companion.pipeline.state_messages import state_from_message, state_message
from companion.self_check.mount_watch import MountWatch
from core.extractor import Extractor
from core.frames import quaternion_from_euler, rotation_from_euler
from core.self_check.mount_check import MountState, MountVerdict, checked
from core.self_check.mount_cues import MountCues
from core.self_check.mount_filter import FilterState
from core.self_check.mount_params import MountCheckParams
from core.types import AttitudeSample, CameraInfo, CameraMount, DepthFrame, Ground, InvalidCause
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info as simulated_info
from drivers.simulation.source import render
from osape_client.proto import osape_v1_pb2 as pb

NS = 1_000_000_000
LEVEL = (1.0, 0.0, 0.0, 0.0)
INFO = dataclasses.replace(simulated_info(160, 120), mount=CameraMount(pitch_rad=math.radians(-6.0)))
"""The images are of a camera that looks ahead."""


def images(count: int) -> list[np.ndarray]:
    return [
        render("trees", simulated_info(160, 120), sensor=TYPICAL.scaled_to(160), seed=i).depth_mm for i in range(count)
    ]


def feed(pipeline: Pipeline, depths: list[np.ndarray], first: int = 0) -> list[Output]:
    outputs: list[Output] = []
    for i, depth in enumerate(depths, start=first):
        t_ns = (10 + i) * NS
        for dt_ns in (-NS // 100, NS // 100):
            pipeline.handle(AttitudeSample(t_ns + dt_ns, t_ns + dt_ns, LEVEL, (0.0, 0.0, 0.0)))
        outputs += pipeline.handle(
            DepthFrame(camera="front", sequence=i, t_exposure_ns=t_ns, t_arrival_ns=t_ns + NS // 50, depth_mm=depth)
        )
    return outputs


def results(outputs: list[Output]) -> list[PrismsResult]:
    return [o for o in outputs if isinstance(o, PrismsResult)]


def pipeline_of(
    info: CameraInfo, state: PipelineState | None = None, check: MountCheckParams | None = None
) -> Pipeline:
    return Pipeline((info,), lambda info: Extractor(), state=state, mount_check=check)


@pytest.fixture(scope="module")
def depths() -> list[np.ndarray]:
    return images(8)


def test_frames_with_a_wrong_mount_report_nothing(depths: list[np.ndarray]) -> None:
    last = results(feed(pipeline_of(INFO), depths))[-1]
    assert last.model is not None
    assert last.model.cause in (InvalidCause.MOUNT_ERROR, InvalidCause.MOUNT_UNVERIFIED)
    assert not last.valid
    assert not len(last.model.planes)
    assert not len(last.model.prisms)
    assert not (last.model.free.free_to_m > last.model.free.free_from_m).any()
    message = prisms_message(last)
    assert message.cause in (pb.CAUSE_MOUNT_ERROR, pb.CAUSE_MOUNT_UNVERIFIED)
    again = prisms_from_message(message)
    assert again.model is not None
    assert again.model.cause is last.model.cause


def test_the_frame_whose_measurement_shows_the_error_is_invalid_itself(depths: list[np.ndarray]) -> None:
    found = results(feed(pipeline_of(INFO), depths))
    assert [r.valid for r in found] == [r.mount is not None and not r.mount.verdict.invalid for r in found]
    assert {r.valid for r in found} == {False, True}


def test_the_check_gets_the_jumps_of_the_heading(depths: list[np.ndarray]) -> None:
    """Between two of these frames there is a gap of the attitude, in which the heading may have jumped."""
    found = results(feed(pipeline_of(INFO), depths))
    stamps = [(r.mount.heading_jump_ns, r.attitude.jump_ns) for r in found if r.mount and r.attitude]
    assert len(stamps) == len(depths)
    assert all(mount_ns == jump_ns for mount_ns, jump_ns in stamps)
    assert len({mount_ns for mount_ns, _ in stamps}) == len(depths)


def tilted_flight(lag_s: float) -> list[Output]:
    """A vehicle before walls brakes and accelerates: its pitch swings to 14 degrees and back within a second, three times. The
    attitude of each frame is that of lag_s before it, as with a delay of the line that is not known."""
    pipeline, outputs = pipeline_of(simulated_info(160, 120)), []

    def pitch_rad(t_s: float) -> float:
        return math.radians(7.0) * (1.0 - math.cos(math.tau * t_s / 2.0)) if 0.0 < t_s < 6.0 else 0.0

    for i in range(-10, 110):  # attitudes at 100 Hz from 2 s before the first frame on
        t_s = i / 10
        image = render(
            "alley", simulated_info(160, 120), pitch_rad=pitch_rad(t_s), sensor=TYPICAL.scaled_to(160), seed=i + 10
        )
        t_ns = 10 * NS + i * NS // 10
        for k in range(10):
            at_s = t_s + (k - 9) / 100
            rate_rad_s = (pitch_rad(at_s - lag_s + 1e-3) - pitch_rad(at_s - lag_s - 1e-3)) / 2e-3
            q = quaternion_from_euler(0.0, pitch_rad(at_s - lag_s), 0.0)
            at_ns = t_ns + (k - 9) * NS // 100
            pipeline.handle(AttitudeSample(at_ns, at_ns, q, (0.0, rate_rad_s, 0.0)))
        outputs += pipeline.handle(
            DepthFrame(
                camera="front",
                sequence=i + 10,
                t_exposure_ns=t_ns,
                t_arrival_ns=t_ns + NS // 50,
                depth_mm=image.depth_mm,
            )
        )
    return outputs


def test_late_attitudes_of_a_tilting_vehicle_are_no_mount_error() -> None:
    """The attitude is wrong while the vehicle tilts: ground and walls lean by the same angle, as with a wrong mount."""
    found = [r.mount.verdict for r in results(tilted_flight(0.2)) if r.mount is not None]
    assert len(found) == 120
    assert not any(verdict.invalid for verdict in found)


def test_the_check_can_be_switched_off(depths: list[np.ndarray]) -> None:
    off = MountCheckParams(enabled=False)
    assert all(r.valid for r in results(feed(pipeline_of(INFO, check=off), depths)))


def test_a_pipeline_goes_on_from_a_snapshot_bit_for_bit(depths: list[np.ndarray]) -> None:
    """Halfway, while the verdict is pending, the state travels through its message."""
    whole = pipeline_of(INFO)
    first = pipeline_of(INFO)
    feed(first, depths[:2])
    state = first.state()
    assert state.cameras[0][1].mount.streak > 0
    second = pipeline_of(
        INFO, state_from_message(pb.StateSnapshot.FromString(state_message(state).SerializeToString()))
    )
    expected, got = results(feed(whole, depths))[2:], results(feed(second, depths[2:], first=2))
    assert [prisms_message(r).SerializeToString() for r in got] == [
        prisms_message(r).SerializeToString() for r in expected
    ]
    assert second.state().cameras[0][1].mount == whole.state().cameras[0][1].mount
    assert not got[-1].valid


def test_the_message_of_the_check_holds_all_of_its_state() -> None:
    mean, covariance = tuple(0.1 * k for k in range(5)), tuple(0.01 * k for k in range(15))
    state = MountState(
        t_ns=5,
        measurements=6,
        verdict=MountVerdict.DEGRADED,
        pending=MountVerdict.ERROR,
        streak=2,
        slope_rad=0.25,
        ground=True,
        confirmations=34,
        residual_rad=(0.5, -0.125),
        filter=FilterState(mean, covariance),
        heading_jump_ns=7,
    )
    assert all(getattr(state, f.name) != getattr(MountState(), f.name) for f in dataclasses.fields(MountState))
    assert mount_state_from_message(mount_state_message(state)) == state


def test_a_snapshot_of_before_the_check_starts_it_again() -> None:
    old = pb.StateSnapshot(cameras=[pb.CameraState(camera="front", ground_height_m=2.0, ke_per_m=0.003)])
    assert state_from_message(old).cameras[0][1].mount == MountState()
    old.cameras[0].mount.mean.append(1.0)
    with pytest.raises(ValueError, match="mount state"):
        state_from_message(old)


def test_a_camera_described_otherwise_starts_again(depths: list[np.ndarray]) -> None:
    pipeline = pipeline_of(INFO)
    feed(pipeline, depths)
    pipeline.announce(simulated_info(160, 120))
    assert pipeline.state().cameras[0][1].mount == MountState()


def test_another_camera_on_the_same_wrong_mount_reports_nothing(depths: list[np.ndarray]) -> None:
    """A camera was exchanged for one of the same kind, or calibrated again: its frames were valid until the check had measured
    enough. It is on the same mount."""
    pipeline = pipeline_of(INFO)
    feed(pipeline, depths)
    exchanged = dataclasses.replace(INFO, intrinsics=dataclasses.replace(INFO.intrinsics, fx=INFO.intrinsics.fx + 0.5))
    pipeline.announce(exchanged)
    again = results(feed(pipeline, depths, first=20))
    assert not any(r.valid for r in again)


@pytest.mark.parametrize("verdict", list(MountVerdict))
def test_a_camera_described_otherwise_on_the_same_mount_is_verified_again(verdict: MountVerdict) -> None:
    """The verdict rests on images of the former camera. One against the mount is kept."""
    before = known(0.0, 5.0, verdict)
    pipeline = pipeline_of(INFO, PipelineState(cameras=(("front", CameraState(mount=before)),)))
    pipeline.announce(dataclasses.replace(INFO, ke_per_m=2.0 * INFO.ke_per_m))
    assert pipeline.state().cameras[0][1].mount == before.restarted()


def test_a_restarted_camera_with_a_wrong_mount_reports_nothing(depths: list[np.ndarray]) -> None:
    """Its stamps step back. Its frames were valid again until the check had measured enough."""
    pipeline = pipeline_of(INFO)
    feed(pipeline, depths)
    again = results(feed(pipeline, depths, first=-5))
    assert pipeline.counts["camera_restarts"] == 1
    assert [r.valid for r in again] == [False] * 7  # the first frame that steps back is left out
    assert pipeline.state().cameras[0][1].mount.t_ns == 12 * NS


@pytest.mark.parametrize("verdict", list(MountVerdict))
def test_only_a_verdict_against_the_mount_outlives_a_restart(verdict: MountVerdict) -> None:
    before = known(0.0, 5.0, verdict)
    kept = verdict in (MountVerdict.DEGRADED, MountVerdict.UNVERIFIED_SLOPE, MountVerdict.ERROR)
    assert before.restarted() == (dataclasses.replace(before, t_ns=None) if kept else MountState())


# ---- in words --------------------------------------------------------------------------------------------------------


def known(roll_deg: float, pitch_deg: float, verdict: MountVerdict) -> MountState:
    mean = (math.radians(roll_deg), math.radians(pitch_deg), 0.0, 0.0, 0.0)
    return MountState(
        t_ns=NS, measurements=50, verdict=verdict, filter=FilterState(mean=mean), slope_rad=0.1, ground=True
    )


def test_the_health_names_the_error_and_the_value_to_set() -> None:
    mount = CameraMount(roll_rad=math.radians(2.0), pitch_rad=math.radians(-10.0))
    health = mount_health(known(0.0, 5.0, MountVerdict.ERROR), mount)
    found = mount_diagnostic("front", health)
    assert found is not None
    assert found.code is DiagnosticCode.MOUNT_ERROR
    assert "pitch +5.0 deg" in found.text
    assert "roll_deg = 2.0, pitch_deg = -5.0" in found.text
    # what is to be set is the configured mount turned by the error about the vehicle's axes
    R = rotation_from_euler(0.0, math.radians(5.0), 0.0) @ rotation_from_euler(mount.roll_rad, mount.pitch_rad, 0.0)
    roll, pitch, yaw = (math.radians(v) for v in (health.roll_deg, health.pitch_deg, health.yaw_deg))
    assert rotation_from_euler(roll, pitch, yaw) == pytest.approx(R, abs=1e-9)


@pytest.mark.parametrize(
    ("verdict", "code"),
    [
        (MountVerdict.UNKNOWN, ""),
        (MountVerdict.VERIFIED, ""),
        (MountVerdict.DEGRADED, "mount_degraded"),
        (MountVerdict.UNVERIFIED_SLOPE, "mount_unverified"),
        (MountVerdict.ERROR, "mount_error"),
    ],
)
def test_each_verdict_has_its_code(verdict: MountVerdict, code: str) -> None:
    health = mount_health(known(0.0, 2.0, verdict), CameraMount())
    found = mount_diagnostic("front", health)
    assert (found.code, found.camera) == (code, "front") if found is not None else not code
    assert mount_text(health)


@functools.cache
def first_result() -> PrismsResult:
    return results(feed(pipeline_of(simulated_info(160, 120)), images(1)))[0]


def watched(
    state: MountState,
    ground: Ground,
    measured: float,
    at_ms: tuple[int, ...] = (0, 500, 1000),
    seen_ms: tuple[int, ...] = (),
) -> tuple[MountWatch, CameraInfo]:
    """After frames that all show the same. at_ms: when; seen_ms: of those, the ones that show the ground."""
    result = first_result()
    assert result.model is not None
    model = dataclasses.replace(
        result.model, ground=ground, stats=dataclasses.replace(result.model.stats, measured_share=measured)
    )
    watch = MountWatch(0.06)
    for t_ms in at_ms:
        t_ns = result.t_exposure_ns + t_ms * 1_000_000
        shown = dataclasses.replace(model, ground=Ground(seen=True, height_m=2.0)) if t_ms in seen_ms else model
        watch.result(dataclasses.replace(result, model=shown, mount=state, t_exposure_ns=t_ns))
    return watch, simulated_info(160, 120)


def test_a_ground_at_its_limit_or_lost_is_reported() -> None:
    state = known(0.0, 0.0, MountVerdict.UNKNOWN)
    cases = (
        (Ground(seen=True, height_m=2.0, slope_x=0.06), 0.9, "ground_slope_limit"),
        (Ground(seen=False), 0.9, "ground_lost"),
        (Ground(seen=True, height_m=2.0, slope_x=0.03), 0.9, ""),
        (Ground(seen=False), 0.2, ""),
    )
    for ground, measured, code in cases:
        watch, info = watched(state, ground, measured)
        found = watch.diagnostics([("front", info), ("rear", None)])
        assert [d.code for d in found] == ([code] if code else []), ground
    watch, info = watched(dataclasses.replace(state, ground=False), Ground(seen=False), 0.9)
    assert not watch.diagnostics([("front", info)])  # a wall fills the view


def test_a_ground_that_single_frames_do_not_show_is_not_reported() -> None:
    """On the shipped flight it was reported 14 times in 2 min, for 0.3 s each."""
    state = known(0.0, 0.0, MountVerdict.UNKNOWN)
    watch, info = watched(state, Ground(seen=False), 0.9, (0, 500, 900))
    assert not watch.diagnostics([("front", info)])


@pytest.mark.parametrize(("seen_ms", "lost"), [((0, 100), True), ((0, 600), False), ((600,), False), ((1200,), False)])
def test_the_time_without_ground_begins_with_the_newest_frame_that_shows_it(
    seen_ms: tuple[int, ...], lost: bool
) -> None:
    state = known(0.0, 0.0, MountVerdict.UNKNOWN)
    watch, info = watched(state, Ground(seen=False), 0.9, (0, 100, 200, 600, 700, 1200), seen_ms)
    assert [d.code for d in watch.diagnostics([("front", info)])] == (["ground_lost"] if lost else [])


def test_status_shows_the_mount() -> None:
    health = mount_health(known(0.0, 2.0, MountVerdict.DEGRADED), CameraMount())
    view = CameraView(
        status=CameraStatus(camera="front", condition=CameraCondition.RUNNING, cause="", since_ns=0),
        required=True,
        blind="",
        age_ns=None,
        hz=30.0,
        mount=health,
    )
    lines = status_lines(pb.Health(cameras=[camera_message(view)]))
    assert any(line.startswith("  mount: wrong; error roll +0.0") for line in lines)


def test_no_cues_change_no_verdict() -> None:
    state = known(0.0, 5.0, MountVerdict.ERROR)
    after = checked(state, 2 * NS, MountCues(False), np.eye(3), 0.0, MountCheckParams())
    assert after.verdict is MountVerdict.ERROR
    assert not after.ground
