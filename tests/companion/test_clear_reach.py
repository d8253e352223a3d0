"""A clear sector must be seen free to [avoid] max_distance_m: no camera with a shorter range ever reports one."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.autopilot.manager import Avoidance
from companion.autopilot.polar_histogram import SectorState, scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.clear_reach import clear_reach_m, clear_reach_text, must_reach_m
from companion.diagnostic import DiagnosticCode
from companion.pipeline.transform import LevelTransform
from companion.setup.configuration import Answers, configuration_text
from core.params import Params
from core.types import FAR_MM, CameraInfo, Intrinsics
from drivers.cameras.oak import DISPARITY_SIGMA_PX as OAK_SIGMA_PX
from drivers.cameras.stereo_errors import bias_coefficient, noise_coefficient
from drivers.cameras.v4l2_depth import V4l2Settings, V4l2Source
from drivers.cameras.zed_uvc import DISPARITY_SIGMA_PX as ZED_SIGMA_PX
from tests.core.views import extract, level

CONFIGS = Path(__file__).parents[2] / "configs"
D435 = Intrinsics(640, 480, 384.0, 384.0, 320.0, 240.0)


def described(kind: str, max_range_m: float) -> CameraInfo:
    """A camera of a kind, as its driver describes it with typical optics."""
    if kind == "v4l2":
        return V4l2Source(V4l2Settings(camera="front", device="", intrinsics=D435, max_range_m=max_range_m)).info
    size, f_px, baseline_m, sigma_px = {
        "oak": ((640, 400), 441.0, 0.075, OAK_SIGMA_PX),
        "zed": ((672, 376), 350.0, 0.12, ZED_SIGMA_PX),
    }[kind]
    return CameraInfo(
        "front",
        Intrinsics(*size, f_px, f_px, 0.5 * size[0], 0.5 * size[1]),
        max_range_m=max_range_m,
        ke_per_m=noise_coefficient(sigma_px, f_px, baseline_m),
        bias_per_m=bias_coefficient(f_px, baseline_m),
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
        bias_per_m=info.bias_per_m,
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


def test_the_service_reports_a_camera_whose_range_is_too_short() -> None:
    part = Avoidance(AvoidParams(send=True), ("front",), 0.3, lambda: None, lambda message: None)
    part.announce(described("v4l2", 6.0))
    assert [(d.code, d.camera) for d in part.diagnostics(0)] == [(DiagnosticCode.CLEAR_OUT_OF_RANGE, "front")]
    assert "set [avoid] max_distance_m to at most 5.25" in part.diagnostics(0)[0].text
    part.announce(replace(described("v4l2", 6.0), max_range_m=20.0))
    assert part.diagnostics(0) == []


def test_a_range_shorter_than_where_sectors_begin_names_another_remedy() -> None:
    text = clear_reach_text(described("v4l2", 2.0), AvoidParams(), Params())
    assert "raise max_range_m of the camera, or lower [avoid] near_m" in text


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
        assert ("no direction is ever reported as clear" in capsys.readouterr().err) is expected
