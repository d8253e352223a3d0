"""Which source a configured camera gets: rendered stereo, the sky, recordings."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from companion.cameras.factory import make_source
from companion.cameras.worker import info_from_json
from companion.config.camera import CameraConfig
from companion.config.service import SupervisorParams
from core.types import (
    FAR_MM,
    CameraInfo,
    CameraMount,
    Intrinsics,
)

pytestmark = pytest.mark.process


def test_a_description_survives_the_way_between_processes() -> None:
    info = CameraInfo(
        "a", Intrinsics(64, 48, 60.0, 61.0, 32.0, 24.0), CameraMount(0.1, 0.2, 0.3, 1, 2, 3), 0.2, 9.0, 0.004
    )
    assert info_from_json(asdict(info)) == info


def test_a_simulated_camera_takes_rendered_stereo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    section = CameraConfig(
        name="front", kind="simulated", render="stereo", width_px=96, disparities=32, fps=1.0, flight="street"
    )
    assert section.unmatched_px == 32
    assert CameraConfig(name="front", kind="simulated", width_px=96).unmatched_px == 0
    with make_source(section) as source:
        frame = source.read(2.0)
        assert frame is not None
        assert frame.depth_mm.shape == (72, 96)
        assert not (frame.depth_mm[:, :20] > 0).any()
        assert (frame.depth_mm[:, 32:] > 0).mean() > 0.1
        assert source.info.ke_per_m == pytest.approx(0.3 / (67.5 * 0.12))


def test_the_sky_of_a_simulated_camera_is_unmeasured_unless_it_is_configured_as_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both cameras keep their frames in one folder: the setting is part of the frames' name."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    far_px = []
    for sky_is_far in (False, True):
        section = CameraConfig(
            name="front", kind="simulated", width_px=96, fps=1.0, flight="trees", sky_is_far=sky_is_far
        )
        with make_source(section) as source:
            frame = source.read(2.0)
            assert frame is not None
            far_px.append(int((frame.depth_mm == FAR_MM).sum()))
    assert far_px[0] == 0
    assert far_px[1] > 500


@pytest.mark.parametrize("given", [{"kind": "simulated", "render": "stereo"}, {"kind": "oak"}])
def test_a_far_sky_is_refused_where_it_has_no_effect(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="sky_is_far = true is for kind"):
        CameraConfig(name="front", sky_is_far=True, **given)


def test_a_camera_that_follows_an_autopilot_renders_no_stereo() -> None:
    """It would deliver depth of the noise model under the description of a stereo camera."""
    with pytest.raises(ValueError, match='render = "stereo" is not available with follow'):
        CameraConfig(name="front", kind="simulated", follow="udpin:127.0.0.1:14551", render="stereo")


def test_a_recording_is_no_live_camera() -> None:
    with pytest.raises(ValueError, match="is not a live camera"):
        make_source(CameraConfig(name="a", kind="mcap"))


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match=r"supervision: silent_s = 0.0: expected 0.05..10.0 s"):
        SupervisorParams(silent_s=0.0)
