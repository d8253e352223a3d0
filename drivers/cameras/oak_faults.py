"""Combinations of a Luxonis OAK and a version of DepthAI that are known not to work.

OV7251 (both grey cameras of an OAK-D Lite): since DepthAI 3.7.1 the firmware fails as it starts them. The device sends no image, or a
few, and restarts a second or two later, at some starts only. Reported for 3.7.1, 3.8 and 3.10, not for 3.6.1 (depthai issue 1252,
depthai-core issues 1900 and 1920, all open in November 2026, without a word of the maker on the cause). Nothing is reported for
later versions, neither the fault nor its end."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ..base import BadData
from ..optional_library import install_command

SENSOR = "OV7251"
FIRST_FAULTY, FIRST_UNKNOWN = (3, 7), (3, 11)
"""Versions from the first one on and before the second one are refused with such cameras."""
WORKING = "3.6.1"


def refuse_known_fault(sensors: Iterable[str], version: str, camera: str) -> None:
    """sensors: names of the device's cameras; version: of depthai. Raises BadData for a combination that is known to fail: it could
    do so in flight."""
    if not any(SENSOR in name.upper() for name in sensors) or not FIRST_FAULTY <= _numbers(version) < FIRST_UNKNOWN:
        return
    raise BadData(
        f"camera {camera}: devices with {SENSOR} cameras, as the OAK-D Lite, restart without an image with DepthAI 3.7 to 3.10, "
        f"installed is {version}. Install a version that works with them: {install_command(f'depthai=={WORKING}')}"
    )


def _numbers(version: str) -> tuple[int, ...]:
    """The first two numbers of a version."""
    return tuple(int(number) for number in re.findall(r"\d+", version)[:2])
