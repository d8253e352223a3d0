"""After how long without a sign of a thread the service ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from companion.live.parts import Parts

NS = 1_000_000_000
NOW_NS, TIMEOUT_NS = 100 * NS, 5 * NS
PARTS = {
    "the pipeline": TIMEOUT_NS,
    "the link to the autopilot": TIMEOUT_NS + 2 * NS,  # opening it may take longer
    "the obstacle sender": TIMEOUT_NS,
    "the guard": TIMEOUT_NS,
    "the supervision of camera front": TIMEOUT_NS + 2 * NS,
}


def parts(silent: str = "", age_ns: int = 0, started: bool = True) -> Parts:
    """All required parts respond but one, which was last heard of age_ns ago."""

    def alive_ns(part: str) -> int:
        return NOW_NS - age_ns if part == silent else NOW_NS

    of: dict[str, Any] = {
        "pipeline_thread": SimpleNamespace(
            started=SimpleNamespace(is_set=lambda: started), alive_ns=alive_ns("the pipeline")
        ),
        "link": SimpleNamespace(state=SimpleNamespace(alive_ns=alive_ns("the link to the autopilot"))),
        "obstacle_output": SimpleNamespace(sender=SimpleNamespace(alive_ns=alive_ns("the obstacle sender"))),
        "guard": SimpleNamespace(alive_ns=alive_ns("the guard")),
        "cameras": {
            "front": SimpleNamespace(status=SimpleNamespace(alive_ns=alive_ns("the supervision of camera front"))),
            "unopened": SimpleNamespace(status=SimpleNamespace(alive_ns=0)),
        },
    }
    unused: Any = None
    return Parts(event_queue=unused, previews=unused, signing=unused, **of)


@pytest.mark.parametrize(("part", "limit_ns"), PARTS.items())
def test_a_required_part_that_is_silent_longer_than_its_limit_is_named(part: str, limit_ns: int) -> None:
    assert parts().stalled(NOW_NS, TIMEOUT_NS) == ""
    assert parts(part, limit_ns).stalled(NOW_NS, TIMEOUT_NS) == ""
    assert parts(part, limit_ns + 1).stalled(NOW_NS, TIMEOUT_NS) == f"{part} does not respond"


def test_a_pipeline_that_still_compiles_is_not_stalled() -> None:
    assert parts("the pipeline", 60 * NS, started=False).stalled(NOW_NS, TIMEOUT_NS) == ""
