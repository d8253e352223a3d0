"""A start of the service is quick: what it does not need it does not load."""

from __future__ import annotations

import subprocess
import sys

NOT_NEEDED = ("asyncio", "cv2", "depthai", "linuxpy", "matplotlib", "rich", "scipy.interpolate", "scipy.spatial")
LOADED = f"""
import sys
import companion.run, companion.service, companion.warmup
print([m for m in {NOT_NEEDED!r} if m in sys.modules])
"""


def test_the_service_loads_no_camera_library_and_nothing_that_draws() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
