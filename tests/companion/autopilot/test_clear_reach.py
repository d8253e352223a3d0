"""A clear sector must be seen free to [avoid] max_distance_m: no camera with a shorter range ever reports one."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.autopilot import clear_sectors as clear_sectors_module
from companion.autopilot.camera_coverage import covered, looked_into
from companion.autopilot.clear_sectors import OpenedCamera, clear_sectors, far_view, never_clear_texts
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.polar_histogram import SectorState, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.clear_reach import clear_reach_m, clear_reach_text, clear_reach_texts, must_reach_m
from companion.diagnostic import DiagnosticCode
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.pipeline.transform import LevelTransform
from companion.setup.configuration import Answers, configuration_text
from core.extractor import Extractor
from core.params import Params
from core.types import FAR_MM, CameraInfo, CameraMount, DepthFrame, Intrinsics
from drivers.cameras.oak import DISPARITY_SIGMA_PX as OAK_SIGMA_PX
from drivers.cameras.stereo_errors import bias_coefficient, noise_coefficient
from drivers.cameras.v4l2_depth import V4l2Settings, V4l2Source
from drivers.cameras.zed_uvc import DISPARITY_SIGMA_PX as ZED_SIGMA_PX
from tests.core.views import extract, level

NS = 1_000_000_000
CONFIGS = Path(__file__).parents[3] / "configs"
D435 = Intrinsics(640, 480, 384.0, 384.0, 320.0, 240.0)


def described(kind: str, max_range_m: float) -> CameraInfo:
    """A camera of a kind, as its driver describes it with typical optics."""
    if kind == "v4l2":
        return V4l2Source(V4l2Settings(camera="front", device="", intrinsics=D435, max_range_m=max_range_m)).info
    size, f_px, baseline_m, sigma_px = {
        "oak": ((640, 400), 441.0, 0.075, OAK_SIGMA_PX),
        "zed": ((672, 376), 350.0, 0.12, ZED_SIGMA_PX),
    }[kind]
    intrinsics = Intrinsics(*size, f_px, f_px, 0.5 * size[0], 0.5 * size[1])
    return CameraInfo(
        "front",
        intrinsics,
        max_range_m=max_range_m,
        ke_per_m=noise_coefficient(sigma_px, f_px, baseline_m),
        bias_per_m=bias_coefficient(intrinsics, baseline_m),
    )


def ahead(info: CameraInfo, avoid: AvoidParams, far: int = FAR_MM) -> SectorState:
    """The sector ahead where every pixel measures farther than the range."""
    k = info.intrinsics
    model = extract(np.full((k.height, k.width), far, np.uint16), info, level())
    view = View(
        model=model,
        transform=LevelTransform(0.0, (0.0, 0.0, 0.0)),
        intrinsics=k,
        R_optical_level=level().T,
    )
    return SectorState(int(scan([view], avoid).state[0]))


@pytest.mark.parametrize("kind", ["oak", "zed", "v4l2"])
def test_with_each_shipped_configuration_the_open_way_ahead_is_clear(kind: str) -> None:
    content = tomllib.loads((CONFIGS / f"{kind}.toml").read_text())
    info = described(kind, content["camera"][0]["max_range_m"])
    avoid = AvoidParams(**content["avoid"])
    assert ahead(info, avoid) is SectorState.CLEAR
    assert clear_reach_text(info, avoid, Params()) == ""
    assert ahead(replace(info, ke_per_m=1.3 * info.ke_per_m), avoid) is SectorState.CLEAR


@pytest.mark.parametrize("kind", ["oak", "zed", "v4l2"])
def test_what_setup_writes_reports_the_open_way_ahead_as_clear(kind: str) -> None:
    content = tomllib.loads(configuration_text(Answers(kind=kind, send=True)))
    info = described(kind, content["camera"][0]["max_range_m"])
    assert ahead(info, AvoidParams(**content["avoid"])) is SectorState.CLEAR


@pytest.mark.parametrize("kind", ["oak", "zed", "v4l2"])
@pytest.mark.parametrize("max_range_m", [6.0, 10.0, 14.0, 20.0])
def test_the_stated_reach_is_that_of_the_sectors(kind: str, max_range_m: float) -> None:
    info = described(kind, max_range_m)
    reach_m = clear_reach_m(info, Params())
    step_m = AvoidParams().step_m
    within = AvoidParams(max_distance_m=np.floor(reach_m / step_m) * step_m)
    beyond = replace(within, max_distance_m=within.max_distance_m + 2.0 * step_m)
    assert must_reach_m(within) <= reach_m
    assert not clear_reach_text(info, within, Params())
    assert ahead(info, within) is SectorState.CLEAR
    assert ahead(info, beyond) is SectorState.UNSEEN
    assert f"at most {within.max_distance_m:g}" in clear_reach_text(info, beyond, Params())


@pytest.mark.parametrize(
    ("max_range_m", "ring_m", "reach_m"),
    [(2.8, 0.5, 2.75), (3.8, 0.5, 3.75), (4.4, 0.5, 4.0), (20.0, 5.0, 17.5), (60.0, 0.1, 24.2)],
)
def test_the_stated_reach_is_the_last_ring_of_the_free_ranges(
    max_range_m: float, ring_m: float, reach_m: float
) -> None:
    """The nearest rings are half a step apart, and there are no more than 250."""
    info = replace(described("zed", max_range_m), ke_per_m=1e-5, bias_per_m=0.0)
    params = Params(profile_ring_m=ring_m)
    k = info.intrinsics
    far = np.full((k.height, k.width), FAR_MM, np.uint16)
    model, _ = Extractor(params).extract(far, info, level())
    free = model.free
    towards = free.azimuth_edges_rad.searchsorted(0.0) - 1
    assert free.free_to_m[towards].max() == pytest.approx(reach_m, abs=1e-3)
    assert clear_reach_m(info, params) == pytest.approx(reach_m)


def first_result(info: CameraInfo) -> PrismsResult:
    """The result of a frame without an attitude."""
    k = info.intrinsics
    frame = DepthFrame(
        camera=info.camera,
        sequence=0,
        t_exposure_ns=NS,
        t_arrival_ns=NS + 1,
        depth_mm=np.full((k.height, k.width), FAR_MM, np.uint16),
    )
    outputs = list(Pipeline((info,), lambda _: Extractor()).handle(frame))
    return next(output for output in outputs if isinstance(output, PrismsResult))


def test_the_service_reports_a_camera_whose_range_is_too_short() -> None:
    part = ObstacleOutput(
        AvoidParams(send=True),
        CameraUse(cameras=("front",), timeout_s=0.3),
        AutopilotLine(lambda: None, lambda message: None),
    )
    info = described("v4l2", 6.0)
    part.announce(info)
    part.result(first_result(info))
    assert [(d.code, d.camera) for d in part.diagnostics(0)] == [(DiagnosticCode.NEVER_CLEAR, "front")]
    assert "set [avoid] max_distance_m to at most 5" in part.diagnostics(0)[0].text
    info = replace(info, max_range_m=20.0)
    part.announce(info)
    part.result(first_result(info))
    assert part.diagnostics(0) == []


def alone(info: CameraInfo, avoid: AvoidParams, hidden: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """The sectors that can be clear by one camera."""
    view = far_view(info, Params(), hidden)
    return clear_sectors([] if view is None else [view], avoid)


def text_alone(info: CameraInfo, avoid: AvoidParams, hidden: NDArray[np.bool_] | None = None) -> str:
    return never_clear_texts([OpenedCamera(info, hidden)], avoid, Params())[info.camera]


def tilted(kind: str, pitch_deg: float, yaw_deg: float = 0.0) -> CameraInfo:
    mount = CameraMount(pitch_rad=math.radians(pitch_deg), yaw_rad=math.radians(yaw_deg), x_m=0.1)
    return replace(described(kind, 15.0), mount=mount)


@pytest.mark.parametrize("pitch_deg", [0.0, -10.0, 10.0])
def test_a_camera_that_looks_about_level_finds_the_sectors_of_its_view_clear(pitch_deg: float) -> None:
    for yaw_deg, middle in ((0.0, 0), (90.0, 18)):
        found = alone(tilted("zed", pitch_deg, yaw_deg), AvoidParams(max_distance_m=8.0))
        offsets = (np.flatnonzero(found) - middle + 36) % 72 - 36
        assert len(offsets) >= 9
        assert np.abs(offsets).max() <= 9


def test_a_mount_by_which_no_sector_can_be_clear_is_reported() -> None:
    """The documentation's example of a camera that looks 20 degrees down: its image ends below the height band."""
    avoid = AvoidParams(max_distance_m=8.0)
    text = text_alone(tilted("zed", -20.0), avoid)
    assert "mounted with a pitch of -20 degrees, does not cover 80 % of the height band" in text
    level = tilted("zed", 0.0)
    mast = text_alone(replace(level, mount=replace(level.mount, z_m=-1.5)), avoid)
    assert "mounted with a pitch of 0 degrees and z_m = -1.5 m, does not cover 80 % of the height band" in mast
    assert "closer to the height of the autopilot" in mast
    narrow = replace(avoid, band_above_m=0.4)
    assert text_alone(tilted("zed", -20.0), narrow) == ""
    assert text_alone(tilted("zed", 0.0), avoid) == ""


@pytest.mark.parametrize(("kind", "max_distance_m"), [("zed", 8.0), ("v4l2", 12.0)])
def test_a_camera_that_looks_down_is_not_expected_to_find_directions_clear(kind: str, max_distance_m: float) -> None:
    info, avoid = replace(tilted(kind, -89.0), max_range_m=6.0), AvoidParams(max_distance_m=max_distance_m)
    assert not alone(info, avoid).any()
    assert text_alone(info, avoid) == ""


def test_two_cameras_that_cover_the_height_band_together_find_the_way_ahead_clear() -> None:
    avoid = AvoidParams(max_distance_m=8.0)
    pair = [replace(tilted("zed", pitch_deg), camera=f"pitch{pitch_deg:.0f}") for pitch_deg in (-20.0, 20.0)]
    assert all(text_alone(info, avoid) for info in pair)
    assert not any(never_clear_texts([OpenedCamera(info, None) for info in pair], avoid, Params()).values())
    apart = [pair[0], replace(pair[1], mount=replace(pair[1].mount, yaw_rad=math.pi))]
    assert all(never_clear_texts([OpenedCamera(info, None) for info in apart], avoid, Params()).values())


def test_the_service_reports_no_camera_that_another_one_completes() -> None:
    part = ObstacleOutput(
        AvoidParams(send=True, max_distance_m=8.0),
        CameraUse(cameras=("down", "up"), timeout_s=0.3),
        AutopilotLine(lambda: None, lambda message: None),
    )
    down, up = (replace(tilted("zed", p), camera=name) for p, name in ((-20.0, "down"), (20.0, "up")))
    part.announce(down)
    part.result(first_result(down))
    assert [d.camera for d in part.diagnostics(0)] == ["down"]
    part.announce(up)
    part.result(first_result(up))
    assert part.diagnostics(0) == []


def test_what_counts_is_the_sector_straight_ahead_of_the_camera() -> None:
    """Sectors at the side reach farther than those ahead, and the middle of the image may be masked."""
    avoid = AvoidParams(max_distance_m=10.0)
    info = replace(tilted("zed", 0.0), max_range_m=12.0)
    found = alone(info, avoid)
    assert found.any()
    assert not found[0]
    assert "straight ahead of it no sector is ever clear" in text_alone(info, avoid)
    hidden = np.zeros((376, 672), np.bool_)
    hidden[:, 200:460] = True
    text = text_alone(info, AvoidParams(max_distance_m=8.0), hidden)
    assert "straight ahead of camera front no sector is ever clear" in text


def test_the_place_of_the_camera_counts() -> None:
    """Distances begin at the middle of the vehicle."""
    avoid = AvoidParams(max_distance_m=9.0)
    for x_m, clear in ((0.3, True), (-0.5, False)):
        info = replace(tilted("zed", 0.0), max_range_m=12.0, mount=CameraMount(x_m=x_m))
        assert bool(alone(info, avoid)[0]) is clear
        assert (text_alone(info, avoid) == "") is clear


def test_an_error_of_the_advice_does_not_end_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> str:
        raise ValueError("made up")

    monkeypatch.setattr(clear_sectors_module, "no_clear_text", fails)
    part = ObstacleOutput(
        AvoidParams(send=True),
        CameraUse(cameras=("front",), timeout_s=0.3),
        AutopilotLine(lambda: None, lambda message: None),
    )
    part.announce(described("zed", 12.0))
    part.result(first_result(described("zed", 12.0)))
    assert "is not known: made up" in part.diagnostics(0)[0].text


def test_masked_sectors_are_not_clear() -> None:
    info, avoid = tilted("zed", 0.0), AvoidParams(max_distance_m=8.0)
    hidden = np.zeros((376, 672), np.bool_)
    hidden[:, :336] = True
    right = alone(info, avoid, hidden)
    assert right[1:6].all()
    assert not right[36:].any()
    assert "check the masks" in text_alone(info, avoid, np.ones((376, 672), np.bool_))


def test_a_range_shorter_than_where_sectors_begin_names_another_remedy() -> None:
    text = clear_reach_text(described("v4l2", 2.0), AvoidParams(), Params())
    assert "raise max_range_m of the camera, or lower [avoid] near_m" in text


@pytest.mark.parametrize("view_deg", [90.0, 95.0])
def test_what_two_cameras_before_the_middle_cover_can_be_clear(view_deg: float) -> None:
    """ArduPilot was sent the artificial wall in the sectors between them, for ever."""
    f_px = 320.0 / math.tan(math.radians(0.5 * view_deg))
    intrinsics = Intrinsics(640, 480, f_px, f_px, 319.5, 239.5)
    avoid, views, looks = AvoidParams(max_distance_m=8.0), [], []
    for x_m, y_m, yaw_deg in ((0.2, 0.0, 0.0), (0.0, 0.2, 90.0)):
        mount = CameraMount(x_m=x_m, y_m=y_m, yaw_rad=math.radians(yaw_deg))
        info = CameraInfo(f"yaw{yaw_deg:.0f}", intrinsics, mount, max_range_m=20.0, ke_per_m=0.002)
        view = far_view(info, Params())
        assert view is not None
        views.append(view)
        looks.append(looked_into(info, avoid))
    _, whole = covered(looks)
    assert whole.sum() >= 30
    assert clear_sectors(views, avoid)[whole].all()


def test_check_config_warns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from companion.cli import main

    path = tmp_path / "c.toml"
    for line, expected in (
        ("send = true", True),
        ("send = false", False),
        ("send = true\nmax_distance_m = 4.5", False),
    ):
        path.write_text(
            f'[[camera]]\nname = "front"\nkind = "oak"\nmax_range_m = 6.0\n\n[autopilot]\naddress = "udpin:127.0.0.1:14540"\n\n[avoid]\n{line}\n'
        )
        assert main(["check-config", str(path)]) == 0
        assert ("straight ahead of it no sector is ever clear" in capsys.readouterr().err) is expected


@pytest.mark.parametrize(
    ("pitch_deg", "yaw_deg", "warned"),
    [(0.0, 0.0, []), (-20.0, 15.0, []), (-40.0, 0.0, ["front"]), (0.0, 180.0, ["front"])],
)
def test_check_config_does_not_warn_of_a_camera_that_another_one_completes(
    pitch_deg: float, yaw_deg: float, warned: list[str]
) -> None:
    avoid = AvoidParams(max_distance_m=8.0)
    near, far = described("zed", 6.0), replace(tilted("zed", pitch_deg, yaw_deg), camera="far")
    texts = clear_reach_texts([near, far], avoid, Params())
    assert [text.split()[1] for text in texts] == warned
    assert len(clear_reach_texts([near], avoid, Params())) == 1
    if (pitch_deg, yaw_deg) == (0.0, 0.0):
        assert not any(never_clear_texts([OpenedCamera(i, None) for i in (near, far)], avoid, Params()).values())


def test_check_config_examines_the_cameras_of_a_file_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from companion.cli import main

    path = tmp_path / "c.toml"
    cameras = "".join(
        f'[[camera]]\nname = "{name}"\nkind = "oak"\nmax_range_m = {max_range_m}\ndevice = "{name}"\n'
        for name, max_range_m in (("near", 6.0), ("far", 15.0))
    )
    path.write_text(
        cameras + '[autopilot]\naddress = "udpin:127.0.0.1:14540"\n[avoid]\nsend = true\nmax_distance_m = 9\n'
    )
    assert main(["check-config", str(path)]) == 0
    assert "no sector is ever clear" not in capsys.readouterr().err
