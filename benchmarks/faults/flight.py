"""One flight through random faults."""

from __future__ import annotations

from companion.config.avoidance import AvoidParams

from .field import random_field
from .judge import Judge
from .kinds import KINDS, random_faults
from .loop import FaultLoop
from .switches import NS

FIRST_FAULT_S = 6.0


def fly_faults(
    seed: int, kind: str, seconds: float, names: tuple[str, ...] = tuple(KINDS), avoid: AvoidParams | None = None
) -> Judge:
    """Returns the judge of the flight of a seed. kind: of the autopilot; names: kinds of the faults."""
    faults = random_faults(seed, FIRST_FAULT_S, seconds - 1.0, names)
    judge = Judge(faults, kind)
    loop = FaultLoop(random_field(seed, seconds + 60.0), kind, seed, faults, judge.sent, avoid)
    loop.on_published = judge.published
    while loop.flown_ns < seconds * NS:
        loop.step()
    judge.judge_recovery(seconds)
    return judge
