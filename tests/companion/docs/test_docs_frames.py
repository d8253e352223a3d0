"""docs/reference/frames.md states mounts and colours as the code has them, docs/research the limits of jumps."""

from __future__ import annotations

import math
import re

import numpy as np

from companion.log.foxglove_scene import FAR_M, LIFETIME_S, NEAR_M
from companion.pipeline import heading_jumps, position_sections
from core.frames import rotation_frd_optical
from core.types import CameraMount

from ...conftest import CHECKOUT

PAGE = (CHECKOUT / "docs" / "reference" / "frames.md").read_text(encoding="utf-8")
JUMPS = (CHECKOUT / "docs" / "research" / "autopilot-measurements.md").read_text(encoding="utf-8")
LOOKS = {
    "looks 30 degrees down": (math.cos(math.radians(30.0)), 0.0, 0.5),
    "looks to the right": (0.0, 1.0, 0.0),
    "looks backwards": (-1.0, 0.0, 0.0),
    "is mounted upside down": (1.0, 0.0, 0.0),
}
"""Text of the table of mounts -> optical axis in frd."""


def test_the_limits_of_jumps_are_those_of_the_code() -> None:
    p, h = position_sections, heading_jumps
    assert f"{p.JUMP_M:g} m and {p.JUMP_SPEED_M_S:g} m/s times the time between two positions" in JUMPS
    assert f"Without a velocity: {p.JUMP_M:g} m and {p.UNKNOWN_SPEED_M_S:g} m/s times the time" in JUMPS
    degrees = math.degrees(h.JUMP_RAD)
    assert f"{degrees:.2g} degrees, half of the change of the rates" in JUMPS
    assert f"and {0.25 * h.RATE_CHANGE_RAD_S2:g} rad/s² times the square of this time" in JUMPS
    assert f"Without rates: {degrees:.2g} degrees and {h.UNKNOWN_RATE_RAD_S:g} rad/s times the time" in JUMPS
    gaps = f"after {h.LONGEST_NS / 1e9:g} s without an attitude, after {p.LONGEST_NS / 1e9:g} s without a position"
    assert gaps in PAGE
    drift = f"added up to {math.degrees(h.DRIFT_RAD):.3g} degrees within {h.WINDOW_NS / 1e9:g} s"
    assert drift in JUMPS
    assert f"also as a sum over {p.WINDOW_NS / 1e9:g} s" in JUMPS


def test_the_mounts_look_where_the_page_says() -> None:
    rows = re.findall(r"^\| `(\w+)_deg = (\S+)` \| (.*) \|$", PAGE, re.MULTILINE)
    assert [text for *_, text in rows] == list(LOOKS)
    for angle, degrees, text in rows:
        angles = {"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": 0.0} | {f"{angle}_rad": math.radians(float(degrees))}
        R_frd_optical = rotation_frd_optical(CameraMount(**angles))
        np.testing.assert_allclose(R_frd_optical[:, 2], LOOKS[text], atol=1e-12)
        assert (R_frd_optical[2, 1] < 0.0) == ("upside down" in text)  # z of the image's down


def test_the_colours_are_those_of_the_code() -> None:
    assert f"red at {NEAR_M:g} m to blue at {FAR_M:g} m, and vanish after a second" in PAGE
    assert LIFETIME_S == 1
