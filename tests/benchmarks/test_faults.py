"""Random faults on the whole path to the autopilot, in simulated time. The large runs: `python -m benchmarks.faults`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

from benchmarks.faults.field import random_field
from benchmarks.faults.flight import fly_faults
from benchmarks.faults.judge import Judge
from benchmarks.faults.kinds import KINDS, random_faults
from benchmarks.faults.loop import FaultLoop
from benchmarks.faults.service import Service
from benchmarks.faults.switches import MS, NS, Fault, switches_at
from companion.config.avoidance import AvoidParams
from drivers.mavlink.session_types import ARDUPILOT, PX4

AVOID = AvoidParams(send=True, rays=2, slices=6, step_m=0.5)
CLEAR_CM, UNKNOWN = 1201, 65535


def flown(
    kind: str, faults: list[Fault], seconds: float, seed: int = 4, service: Callable[..., Service] = Service
) -> Judge:
    judge = Judge(faults, kind)
    loop = FaultLoop(random_field(seed, 20.0), kind, seed, faults, judge.sent, AVOID, service)
    loop.on_published = judge.published
    loop.fly(seconds)
    judge.judge_recovery(seconds)
    return judge


def fault(name: str, begin_s: float, end_s: float, recovery_s: float = 1.5, **changes: float) -> Fault:
    return Fault(name, round(begin_s * NS), round(end_s * NS), changes, recovery_s=recovery_s)


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_without_a_fault_sectors_are_clear_and_nothing_contradicts_the_truth(kind: str) -> None:
    judge = flown(kind, [], 4.0)
    assert judge.violations == []
    assert judge.clear > 40
    assert judge.paths > 5
    assert judge.planner > 30
    assert judge.seen_s[0] < 2.0


@pytest.mark.parametrize("seed", [73, pytest.param(42, marks=pytest.mark.slow)])
def test_random_faults_are_never_sent_as_clear(seed: int) -> None:
    """In the second flight there are two cameras, and something moves."""
    judge = fly_faults(seed, (PX4, ARDUPILOT)[seed % 2], 16.0, avoid=AVOID)
    assert len(judge.faults) >= 3
    assert judge.violations == []
    assert judge.clear > 100


@pytest.mark.parametrize("delay_s", [0.3, 0.7, 2.5, pytest.param(9.0, marks=pytest.mark.slow)])
def test_a_line_that_is_late_from_the_start_is_never_sent_as_clear(delay_s: float) -> None:
    """Answers to TIMESYNC after more than 0.5 s were not used, and attitudes of 0.7 s before counted as 30 ms old; also those of
    2.5 s before, until the first answer came."""
    seconds = 4.0 + 2.5 * delay_s
    judge = flown(PX4, [fault("late", 0.0, 100.0, delay_ns=round(delay_s * NS))], seconds, seed=5)
    assert judge.violations == []
    assert judge.clear == 0


@pytest.mark.parametrize("noticed", [True, False])
def test_a_repeated_attitude_is_never_sent_as_clear(noticed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second case shows that the judge notices a service that uses it."""
    if not noticed:
        monkeypatch.setattr("drivers.mavlink.repeated_attitude.RepeatedAttitude.take", lambda *_: False)
    judge = flown(PX4, [fault("attitude repeated", 3.0, 5.0, 1.5, repeats_attitude=True)], 7.5)
    assert (judge.violations == []) is noticed


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 112))
def test_many_random_faults_are_never_sent_as_clear(seed: int) -> None:
    assert fly_faults(seed, (PX4, ARDUPILOT)[seed % 2], 50.0).violations == []


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_each_fault_is_never_sent_as_clear(kind: str, name: str) -> None:
    assert fly_faults(sorted(KINDS).index(name), kind, 30.0, (name,)).violations == []


def test_the_judge_notices_a_service_that_uses_old_frames() -> None:
    late = partial(Service, timeout_s=2.0)
    judge = flown(PX4, [fault("camera", 3.0, 5.0, delivers=False)], 4.5, service=late)
    assert any("s after the newest image" in v.what for v in judge.violations)


def test_the_judge_notices_frames_of_before_a_jump_of_the_heading(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such a frame is used for one decision: only some of the jumps move a solid out of a sector that is then clear."""
    monkeypatch.setattr("companion.autopilot.vehicle_motion.VehicleMotion._jumped_rad", lambda *_: 0.0)
    jumps = [Fault("jump", at_ns, at_ns, event="reset_heading") for at_ns in range(2200 * MS, 4 * NS, 330 * MS)]
    judge = flown(PX4, jumps, 4.2, seed=603)
    assert any("is clear, a solid is" in v.what for v in judge.violations)


def test_the_judge_notices_a_service_that_does_not_recover() -> None:
    judge = flown(PX4, [fault("camera", 3.0, 3.5, delivers=False), fault("after it", 3.4, 3.5, 0.1)], 7.0)
    assert judge.violations == []
    judge.seen_s = [t_s for t_s in judge.seen_s if t_s < 3.5]
    judge.faults.pop()
    judge.judge_recovery(7.0)
    assert [v.what for v in judge.violations] == ["not seen again 2.5 s after its end"]


@pytest.mark.parametrize("value", [CLEAR_CM, 1150])
def test_the_judge_notices_a_solid_in_a_clear_sector_and_one_nearer_than_sent(value: int) -> None:
    loop = FaultLoop(random_field(10, 20.0), PX4, 10, [], lambda loop, values: None, AVOID)
    loop.flown_ns = NS
    nearest_m = loop.field.nearest_m(loop.truth(), 1.5, 1.0)
    wrong = [s for s in range(-5, 6) if nearest_m[s] < 10.0]
    assert wrong
    judge = Judge([], PX4)
    values = [UNKNOWN] * 72
    for sector in wrong:
        values[sector] = value
    judge.sent(loop, values)
    assert sum("solid" in v.what for v in judge.violations) == len(wrong)


def test_the_judge_notices_unknown_for_an_autopilot_that_treats_it_as_clear() -> None:
    loop = FaultLoop(random_field(4, 20.0), ARDUPILOT, 4, [], lambda loop, values: None, AVOID)
    judge = Judge([], ARDUPILOT)
    judge.sent(loop, [UNKNOWN] * 72)
    assert {v.what.partition(" is ")[2] for v in judge.violations} == {
        "unknown, which it treats as clear, where a camera looks"
    }


def test_faults_are_those_of_their_seed_and_end() -> None:
    faults = random_faults(7, 5.0, 60.0)
    assert faults == random_faults(7, 5.0, 60.0) != random_faults(8, 5.0, 60.0)
    assert switches_at(faults, 4 * NS) == switches_at([], 0)
    ends_ns = max(f.end_ns for f in faults)
    assert switches_at(faults, ends_ns + MS) == switches_at([], 0)
