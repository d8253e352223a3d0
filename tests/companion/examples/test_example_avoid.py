"""The example flight stops before its wall for both autopilots when its camera fails; its picture is written."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import cv2
import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "avoid_flight.py"


@pytest.mark.slow  # test_braking.py flies the same approaches without a picture
def test_the_flight_stops_and_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "avoid.png"
    assert runpy.run_path(str(EXAMPLE))["main"]([str(picture)]) == 0
    under_way, stands, px4, ardupilot, written = capsys.readouterr().out.splitlines()
    assert float(re.findall(r"([\d.]+) m/s", under_way)[0]) > 2.0
    assert 2.5 <= float(re.findall(r"stands ([\d.]+) m", stands)[0]) < 4.0
    for line, expected in ((px4, "no message"), (ardupilot, "artificial wall")):
        assert f"sent: {expected}; 0.0 m/s" in line
        assert float(re.findall(r"at ([\d.]+) m$", line)[0]) < 10.0
    assert written == f"written: {picture}"
    height, width, _ = cv2.imread(str(picture)).shape
    assert width > 2 * height > 1000
