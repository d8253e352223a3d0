"""Open space is withdrawn where its evidence is missing: marks that the camera does not write, a mount that is not verified."""

from __future__ import annotations

import tomllib
from dataclasses import fields, replace

import numpy as np
import pytest

from companion.config.camera import CameraConfig
from companion.config.loader import ConfigError, config_of
from companion.diagnostic import DiagnosticCode
from companion.doctor.camera_check import frames_finding
from companion.importers.depth_summary import DepthTally
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.pipeline.state import CameraState, PipelineState
from companion.pipeline.state_messages import state_from_message, state_message
from companion.viewer.colors import UNKNOWN_INDEX, depth_index
from companion.viewer.rerun_file import measured_mm as viewer_mm
from core.extractor import Extractor
from core.frames import quaternion_from_euler
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.self_check.mount_check import MountState, MountVerdict, checked
from core.self_check.mount_cues import MountCues
from core.self_check.mount_params import MountCheckParams
from core.types import (
    CONTINUED_MM,
    NOTHING_OPEN,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    AttitudeSample,
    CameraInfo,
    DepthFrame,
    ExtractorState,
    FrameModel,
)
from drivers.cameras.kernel_capture import RawBuffer
from drivers.cameras.v4l2_depth import V4l2Settings, depth_from_buffer
from drivers.logs.codec import camera_from_message, camera_message
from osape_client.proto import osape_v1_pb2 as pb
from tests.core.test_marks import assert_equal
from tests.core.test_open_space import INFO, field

from ..small_recordings import START_NS

MS = 1_000_000
T_NS = START_NS + 50 * MS
PRESUME = OpenSkyParams(mode="presume")
LEVEL = AttitudeSample(T_NS - MS, T_NS - MS, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
OF_A_CAMERA = {
    "zed": 'kind = "zed"\ndevice = "/dev/video0"\ncalibration = "SN1.conf"\n',
    "v4l2": 'kind = "v4l2"\ndevice = "/dev/video0"\nfx_px = 400.0\nfy_px = 400.0\ncx_px = 320.0\ncy_px = 240.0\n',
    "oak": 'kind = "oak"\n',
    "oak-host": 'kind = "oak"\nmatch_on = "host"\n',
    "simulated": 'kind = "simulated"\n',
    "stereo": 'kind = "simulated"\nrender = "stereo"\n',
    "followed": 'kind = "simulated"\nfollow = "udpin:127.0.0.1:14551"\n',
    "mcap": 'kind = "mcap"\n',
}


def mount(verdict: MountVerdict) -> PipelineState:
    """Of a flight whose mount was judged a moment ago."""
    judged = MountState(t_ns=T_NS - 10 * MS, measurements=50, verdict=verdict, pending=verdict, ground=True)
    return PipelineState((("front", CameraState(mount=judged)),))


def model_of(
    state: PipelineState | None,
    depth: np.ndarray | None = None,
    info: CameraInfo = INFO,
    open_sky: OpenSkyParams = PRESUME,
    check: MountCheckParams | None = None,
) -> FrameModel:
    """The published model of one frame of a level vehicle over a field."""
    line = Pipeline((info,), lambda _: Extractor(Params(), open_sky), state=state, mount_check=check)
    line.handle(LEVEL)
    line.handle(replace(LEVEL, t_ns=T_NS + MS, t_arrival_ns=T_NS + MS))
    shot = DepthFrame(
        camera="front",
        sequence=1,
        t_exposure_ns=T_NS,
        t_arrival_ns=T_NS + 20 * MS,
        depth_mm=field() if depth is None else depth,
    )
    result = line.handle(shot)[1]
    assert isinstance(result, PrismsResult)
    assert result.valid
    assert result.model is not None
    return result.model


@pytest.mark.parametrize("verdict", [MountVerdict.UNKNOWN, MountVerdict.VERIFIED, MountVerdict.DEGRADED])
def test_open_ranges_need_a_verified_mount(verdict: MountVerdict) -> None:
    model, plain = model_of(mount(verdict)), model_of(mount(verdict), open_sky=OpenSkyParams())
    assert model.free.has_open is (verdict is MountVerdict.VERIFIED)
    if model.free.has_open:
        assert (model.free.open_to_m > model.free.free_to_m).any()
    nothing = replace(model.free, open_from_dm=NOTHING_OPEN, open_to_dm=NOTHING_OPEN)
    assert_equal(replace(model, free=nothing), plain)


def test_nothing_is_open_before_the_mount_is_verified_and_without_the_check() -> None:
    assert not model_of(None).free.has_open
    assert not model_of(None, check=MountCheckParams(enabled=False)).free.has_open


def test_the_verdict_that_withdraws_open_ranges_is_in_the_snapshot_of_a_log() -> None:
    for verdict in (MountVerdict.VERIFIED, MountVerdict.DEGRADED):
        logged = pb.StateSnapshot.FromString(state_message(mount(verdict)).SerializeToString())
        assert_equal(model_of(state_from_message(logged)), model_of(mount(verdict)))


def test_a_log_holds_whether_a_camera_marks() -> None:
    logged = camera_message(INFO)
    assert camera_from_message(pb.CameraInfo.FromString(logged.SerializeToString())) == INFO
    logged.ClearField("marks_smooth")
    old = camera_from_message(pb.CameraInfo.FromString(logged.SerializeToString()))
    assert old == replace(INFO, marks_smooth=False)
    assert not model_of(mount(MountVerdict.VERIFIED), info=old).free.has_open


@pytest.mark.parametrize("camera", ["v4l2", "another"])
def test_raw_depths_of_a_few_millimetres_are_unknown(camera: str) -> None:
    """Of a camera that writes no marks, also where its range would begin there."""
    raw = field()
    info = replace(INFO, marks_smooth=False, min_range_m=0.001)
    if camera == "v4l2":
        units = np.minimum(raw.astype(np.uint32) * 4, 65_535).astype("<u2")
        settings = V4l2Settings(camera="front", device="x", intrinsics=INFO.intrinsics, depth_unit_mm=0.25)
        raw = depth_from_buffer(RawBuffer(units.tobytes(), 2 * units.shape[1], 1, T_NS), settings)
    assert ((raw > 0) & (raw <= CONTINUED_MM)).any()
    verified = mount(MountVerdict.VERIFIED)
    smears = ExtractorState(edge_ramps=0.95, edge_steps=0.05)
    verified = PipelineState((("front", replace(verified.cameras[0][1], extractor=smears)),))
    model = model_of(verified, raw, info)
    assert not model.free.has_open
    assert_equal(model, model_of(verified, np.where(raw <= CONTINUED_MM, np.uint16(UNKNOWN_MM), raw), info))


@pytest.mark.parametrize(
    ("cameras", "usable"),
    [
        ((), True),
        (("mcap",), True),
        (("zed+",), True),
        (("stereo+",), True),
        (("oak", "zed+"), True),
        (("zed",), False),
        (("stereo",), False),
        (("oak",), False),
        (("oak+",), False),
        (("oak-host+",), True),
        (("oak-host",), False),
        (("v4l2+",), False),
        (("simulated+",), False),
        (("followed+",), False),
        (("oak", "v4l2"), False),
    ],
)
def test_open_space_without_a_camera_that_marks_is_refused(cameras: tuple[str, ...], usable: bool) -> None:
    """A camera with "+" is configured to mark."""
    text = '[open_sky]\nmode = "presume"\n'
    for i, camera in enumerate(cameras):
        kind = camera.rstrip("+")
        marks = "mark_smooth = true\n" if camera.endswith("+") else ""
        text += f'[[camera]]\nname = "{kind}{i}"\n{OF_A_CAMERA[kind]}{marks}'
    if usable:
        assert config_of(tomllib.loads(text), "test").open_sky.presumes
        return
    with pytest.raises(ConfigError, match=r"no \[\[camera\]\] writes the marks") as error:
        config_of(tomllib.loads(text), "test")
    for i, camera in enumerate(cameras):
        assert f'"{camera.rstrip("+")}{i}"' in str(error.value)


def test_open_space_without_the_mount_check_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"\[mount_check\] enabled = false"):
        config_of({"open_sky": {"mode": "presume"}, "mount_check": {"enabled": False}}, "test")


def test_marking_is_a_safety_key() -> None:
    assert next(f for f in fields(CameraConfig) if f.name == "mark_smooth").metadata["safety"]


def test_a_covered_lens_is_not_measured() -> None:
    """A covered lens gives a smooth image: marks alone."""
    depth = np.full((48, 64), TEXTURELESS_MM, np.uint16)
    section = CameraConfig(name="front", kind="oak", fps=10.0)
    frames = [
        DepthFrame(camera="front", sequence=i, t_exposure_ns=i * 100 * MS, t_arrival_ns=i * 100 * MS, depth_mm=depth)
        for i in range(1, 5)
    ]
    finding = frames_finding("camera front", section, frames)
    assert finding.code is DiagnosticCode.CAMERA_FEW_MEASURED
    tally = DepthTally()
    tally.add(depth)
    assert tally.summary().measured_share == 0.0
    assert (viewer_mm(depth) == 0).all()
    assert (depth_index(depth, replace(INFO, min_range_m=0.001)) == UNKNOWN_INDEX).all()


def straight_flight(slope_deg: float, last_ground_s: float = 0.0) -> PipelineState:
    """Of five seconds of straight, level flight over ground that looks inclined by this much; then none was in view."""
    state, dt_ns = MountState(), 100 * MS
    first = T_NS - 10 * MS - round(last_ground_s * 1e9) - 49 * dt_ns
    for i in range(50):
        cues = MountCues(True, np.radians(slope_deg), 0.0, 2.0)
        state = checked(state, first + i * dt_ns, cues, np.eye(3), 0.0, MountCheckParams())
    assert state.verdict is MountVerdict.UNKNOWN
    if last_ground_s:
        state = checked(state, T_NS - 10 * MS, MountCues(False, 0.0, 0.0, 2.0), np.eye(3), 0.0, MountCheckParams())
    return PipelineState((("front", CameraState(mount=state)),))


MEASURED = OpenSkyParams(mode="presume", mount_measured=True)


@pytest.mark.parametrize(
    ("slope_deg", "last_ground_s", "is_open"), [(0.3, 0.0, True), (0.3, 300.0, False), (1.5, 0.0, False)]
)
def test_level_ground_confirms_a_mount_that_was_measured(slope_deg: float, last_ground_s: float, is_open: bool) -> None:
    flown = straight_flight(slope_deg, last_ground_s)
    assert model_of(flown, open_sky=MEASURED).free.has_open is is_open
    assert not model_of(flown).free.has_open


def test_a_measured_mount_is_not_believed_without_ground_or_against_the_check() -> None:
    assert not model_of(None, open_sky=MEASURED).free.has_open
    state = dict(straight_flight(0.3).cameras)["front"]
    degraded = replace(state, mount=replace(state.mount, verdict=MountVerdict.DEGRADED))
    assert not model_of(PipelineState((("front", degraded),)), open_sky=MEASURED).free.has_open
    off = MountCheckParams(enabled=False)
    assert not model_of(straight_flight(0.3), open_sky=MEASURED, check=off).free.has_open


@pytest.mark.parametrize("jumps", [False, True])
def test_level_ground_of_before_a_jump_of_the_heading_confirms_no_mount(jumps: bool) -> None:
    """The check measured the ground 10 ms ago, and is not due: its state does not contain the jump."""
    before_ns = T_NS - 20 * MS
    flown, other = straight_flight(0.3), quaternion_from_euler(0.0, 0.0, 0.5)
    north = LEVEL.q_ned_frd_wxyz
    attitudes = tuple(
        replace(LEVEL, t_ns=t_ns, t_arrival_ns=t_ns, q_ned_frd_wxyz=q)
        for t_ns, q in ((before_ns, other if jumps else north), (T_NS - MS, north), (T_NS + MS, north))
    )
    line = Pipeline((INFO,), lambda _: Extractor(Params(), MEASURED), state=flown)
    for sample in attitudes:
        line.handle(sample)
    result = line.handle(
        DepthFrame(camera="front", sequence=1, t_exposure_ns=T_NS, t_arrival_ns=T_NS + 20 * MS, depth_mm=field())
    )[1]
    assert isinstance(result, PrismsResult)
    assert result.attitude is not None
    assert (result.attitude.jump_ns > 0) is jumps
    assert result.model is not None
    assert result.model.free.has_open is not jumps
