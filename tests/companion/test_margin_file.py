"""After a restart the blind policy's wall stands where the autopilot's margin had it before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.autopilot.manager import Avoidance
from companion.autopilot.margin_file import NAME, MarginFile
from companion.config.avoidance import AvoidParams
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session import Vehicle

NS = 1_000_000_000


def avoidance(folder: Path, system_id: int = 1) -> Avoidance:
    def ignore(message: Any) -> None:
        pass

    vehicle = Vehicle(system_id, "ArduPilot", 2, True, 5, 0)
    return Avoidance(
        AvoidParams(send=True, avoid_margin_m=2.0), ("front",), 0.3, lambda: vehicle, ignore, margins=MarginFile(folder)
    )


def told_margin(part: Avoidance, value: float) -> None:
    """The autopilot says AVOID_MARGIN for two seconds."""
    part.tick(NS)
    for k in range(20):
        part.parameters.take(dialect.MAVLink_param_value_message(b"AVOID_MARGIN", value, 9, 1, 0), NS + k * NS // 10)
    part.tick(3 * NS)


def nearest_wall_m(part: Avoidance) -> float:
    """Of the very first decision."""
    told = part._teller.decide(part._autopilot(), 10 * NS)
    assert told.values is not None
    return float(told.values.min()) / 100.0


def test_the_first_wall_after_a_restart_is_not_nearer_than_the_margin(tmp_path: Path) -> None:
    first = avoidance(tmp_path)
    told_margin(first, 3.0)
    before_m = nearest_wall_m(first)
    assert before_m > 3.0
    first._margins.close()
    assert nearest_wall_m(avoidance(tmp_path)) == before_m
    assert nearest_wall_m(avoidance(tmp_path, system_id=2)) < 3.0, "another vehicle has a margin of its own"


def test_what_is_read_now_outranks_what_was_kept(tmp_path: Path) -> None:
    first = avoidance(tmp_path)
    told_margin(first, 5.0)
    first._margins.close()
    second = avoidance(tmp_path)
    told_margin(second, 3.0)
    assert 3.0 < nearest_wall_m(second) < 5.0
    second._margins.close()
    assert MarginFile(tmp_path).margin_m("ArduPilot", 1) == 3.0


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[" * 900, b"3", b'{"autopilot": "ArduPilot", "system_id": 1, "avoid_margin_m": NaN}',
     b'{"autopilot": "ArduPilot", "system_id": 1, "avoid_margin_m": -3}', b'{"autopilot": "ArduPilot", "system_id": 1e999, "avoid_margin_m": 3}', b"\xff\xfe"],
)  # fmt: skip
def test_a_file_that_is_none_of_ours_is_passed_over(tmp_path: Path, content: bytes) -> None:
    (tmp_path / NAME).write_bytes(content)
    assert MarginFile(tmp_path).margin_m("ArduPilot", 1) is None


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    margins = MarginFile(tmp_path / "gone")
    margins.keep("ArduPilot", 1, 3.0)
    margins.close()
    assert "AVOID_MARGIN cannot be kept" in caplog.text
    assert margins.margin_m("ArduPilot", 1) == 3.0
