"""The range up to which obstacles are found, as the commands print it."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.cli import main
from companion.config.obstacle_range import obstacle_range_m
from companion.live.status import status_lines
from companion.replay.replay_report import Replay, print_report
from companion.replay.summary import ReplayCounts
from core.types import CameraInfo, Intrinsics
from drivers.logs.codec import camera_message
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.flights import FLIGHTS
from osape_client.proto import osape_v1_pb2 as pb

INFO = CameraInfo("front", Intrinsics(640, 480, 400.0, 400.0, 319.5, 239.5), max_range_m=20.0, ke_per_m=0.005)


def test_it_is_shorter_than_the_maximum_by_three_sigma_of_noise() -> None:
    assert obstacle_range_m(INFO) == pytest.approx(20.0 / 1.3)
    assert obstacle_range_m(INFO, 0.0015) == pytest.approx(20.0 / 1.09)


def test_check_config_prints_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "c.toml"
    file.write_text('[[camera]]\nname = "front"\nkind = "mcap"\nmax_range_m = 20.0\nke_per_m = 0.005\n')
    assert main(["check-config", str(file)]) == 0
    assert (
        "front: obstacles are found up to 15.4 m of max_range_m = 20, with ke_per_m = 0.005" in capsys.readouterr().out
    )


@pytest.mark.parametrize("flight", FLIGHTS)
def test_check_config_prints_that_of_the_simulated_camera(
    flight: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`companion status` prints the same for it."""
    file = tmp_path / "c.toml"
    file.write_text(f'[[camera]]\nname = "front"\nkind = "simulated"\nflight = "{flight}"\nmax_range_m = 20.0\n')
    assert main(["check-config", str(file)]) == 0
    (info,) = SimulatedFlight(flight, width=160, height=120).cameras
    expected = f"obstacles are found up to {obstacle_range_m(info):.1f} m of max_range_m = 20, with ke_per_m = {info.ke_per_m:g}"
    assert expected in capsys.readouterr().out


def test_check_config_states_that_the_noise_of_a_recording_is_not_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "c.toml"
    file.write_text('[[camera]]\nname = "front"\nkind = "mcap"\nmax_range_m = 20.0\n')
    assert main(["check-config", str(file)]) == 0
    assert "with ke_per_m = 0.005 (assumed; the value in the recording counts)" in capsys.readouterr().out


def test_a_replay_prints_it_with_the_noise_of_the_last_frame(capsys: pytest.CaptureFixture[str]) -> None:
    result = Replay(ReplayCounts(ke_per_m={"front": 0.0015}), {}, ("front",))
    result.obstacle_range_m = {"front": obstacle_range_m(INFO, 0.0015)}
    print_report(result, None)
    assert (
        "front: obstacles are detected up to 18.3 m at the estimated depth noise of 0.0015/m" in capsys.readouterr().out
    )


def test_status_prints_it() -> None:
    camera = pb.CameraHealth(camera="front", condition="running", info=camera_message(INFO))
    lines = status_lines(pb.Health(cameras=[camera]))
    assert "  obstacles are detected up to 15.4 m (depth noise ke_per_m = 0.005)" in lines
