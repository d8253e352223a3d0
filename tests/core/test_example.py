"""The example of the documentation runs, has the documented length, and finds its wall."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "planes_from_depth.py"


def test_the_example_prints_the_wall_at_eight_metres() -> None:
    run = subprocess.run([sys.executable, str(EXAMPLE)], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    a_x, a_y, b_x, b_y, low, high, margin = (float(n) for n in re.findall(r"-?\d+\.\d+", run.stdout))
    assert abs(a_x - 8.0) < 0.05
    assert abs(b_x - 8.0) < 0.05
    # 640 by 480 px at 450 px focal length, turned by 5 degrees: half as wide and high as its corners reach
    c, s = math.cos(math.radians(5)), math.sin(math.radians(5))
    across, up = 8.0 * (320 * c + 240 * s) / 450, 8.0 * (240 * c + 320 * s) / 450
    assert (-a_y, b_y) == pytest.approx((across, across), abs=0.1)
    assert (-low, high) == pytest.approx((up, up), abs=0.1)
    assert 0.0 <= margin < 0.1


def test_the_example_takes_less_than_ten_lines_after_its_imports() -> None:
    lines = [
        line for line in EXAMPLE.read_text().splitlines() if line and not line.startswith(('"""', "import", "from"))
    ]
    assert len(lines) < 10


def test_the_documentation_shows_the_example_as_it_is() -> None:
    assert EXAMPLE.read_text() in (ROOT / "docs/how-to/use-the-algorithm-from-python.md").read_text()
