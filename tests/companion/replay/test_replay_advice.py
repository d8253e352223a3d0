"""What a replay says about the limits of its results."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from companion.cli import main
from companion.replay.advice import AdviceCode, ViewTally, advice_of, free_share
from core.types import FrameModel

from ..view_scenes import model

WALL = model([[4.0, -1.0, 4.0, 1.0, -0.6, 0.8]])


def with_free(share: float) -> FrameModel:
    """share of the directions is free in the camera's layer, the upper one of two; the other is never free."""
    to_m = np.zeros((2, 2), np.float32)
    to_m[: round(2 * share), 1] = 5.0
    return dataclasses.replace(WALL, free=dataclasses.replace(WALL.free, free_to_m=to_m))


def tally(made: FrameModel, frames: int = 20) -> ViewTally:
    out = ViewTally()
    for _ in range(frames):
        out.add(made, 0.0)
    return out


def codes(made: FrameModel, **more: float) -> list[AdviceCode]:
    values: dict[str, float] = {"frames": 20, "attitude_dropped": 0, "attitude_hz": 50.0}
    return [a.code for a in advice_of(tally(made), **(values | more))]  # type: ignore[arg-type]


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_share_of_the_view_that_is_free(share: float) -> None:
    assert free_share(with_free(share), 0.0) == (share, 2.0)
    assert free_share(with_free(share), -2.0) == (0.0, 2.0)
    assert free_share(with_free(share), 9.0) == (0.0, 0.0)


def test_a_flight_without_limits_has_no_advice() -> None:
    assert codes(with_free(0.5)) == []


def unseen(made: FrameModel) -> FrameModel:
    return dataclasses.replace(made, ground=dataclasses.replace(made.ground, seen=False))


def dark(made: FrameModel) -> FrameModel:
    return dataclasses.replace(made, stats=dataclasses.replace(made.stats, measured_share=0.3))


@pytest.mark.parametrize(
    ("made", "more", "expected"),
    [
        (with_free(0.0), {}, [AdviceCode.NOTHING_FREE]),
        (unseen(with_free(0.5)), {}, [AdviceCode.GROUND_NEVER_SEEN]),
        (dark(unseen(with_free(0.5))), {}, []),  # too little was measured to expect a ground
        (with_free(0.5), {"attitude_dropped": 15, "attitude_hz": 2.0}, [AdviceCode.ATTITUDE_TOO_SLOW]),
        (with_free(0.5), {"attitude_dropped": 1, "attitude_hz": 50.0}, []),
    ],
)
def test_each_limit_is_named(made: FrameModel, more: dict[str, float], expected: list[AdviceCode]) -> None:
    assert codes(made, **more) == expected


def test_a_replay_reports_it(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A camera close to the furniture of a living room."""
    log = tmp_path / "in.mcap"
    assert main(["import", str(shared_data / "o3d_livingroom_sim"), "-o", str(log)]) == 0
    capsys.readouterr()
    assert main(["replay", str(log)]) == 0
    output = capsys.readouterr().out
    assert "87% of the pixels measured; at the camera's height 0% of the directions free" in output
    assert "warning: at the camera's height no direction is free for a metre in 5 of 5 valid frames" in output
    assert "`companion configs indoor`" in output
    assert main(["replay", str(log), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [a["code"] for a in report["advice"]] == ["nothing_free"]
