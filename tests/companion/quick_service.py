"""`companion` with shorter intervals, for which a test would only wait. Run as `python -m tests.companion.quick_service`.

Tests with a clock of their own check the product's values."""

from __future__ import annotations

import sys

import companion.autopilot.feedback_check as feedback_check
import companion.autopilot.parameters as parameters
import companion.autopilot.status_text as status_text
import drivers.mavlink.conflicts as conflicts
import drivers.mavlink.signing as signing
from companion.entry import main

NS = 1_000_000_000


def shorten() -> None:
    """Parameters are read again after 2 s in place of 10, conflicts and faults of signing are over 3 s after their last
    message in place of 10 and 5, obstacles without an echo are reported after 3 s in place of 5, and texts for the ground
    station are 0.2 s apart in place of 2."""
    parameters.RENEW_NS = 2 * NS
    conflicts.RECENT_NS = signing.RECENT_NS = 3 * NS
    feedback_check.PATIENCE_NS = 3 * NS
    status_text.LEAST_APART_NS = NS // 5


if __name__ == "__main__":
    shorten()
    sys.exit(main())
