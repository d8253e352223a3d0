"""What is broken at an instant of a flight, and the random sequence of faults of a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

NS = 1_000_000_000
MS = 1_000_000


@dataclass(slots=True)
class Switches:
    """The state of each part that a fault can change. The defaults are those without a fault.

    Attributes:
        broken_camera: number of the camera that the faults of a camera concern; -1: all.
        delivers: the camera delivers frames.
        repeats: the camera repeats its newest images, of this number in turn, with new stamps; 0: it does not.
        stamp_shift_ns: added to the stamps of the camera.
        frame_delay_ns: added to the delay of every second frame, so that frames arrive out of order.
        other_size: the images have another size.
        covered: share of the image's columns, from the left, that are not measured.
        hides_attitude: no attitude is sent.
        repeats_attitude: the same attitude is sent with advancing stamps.
        repeats_stamp: the same attitude is sent with the same stamp.
        negates: each second quaternion has the other sign, which is the same attitude.
        not_a_number: attitudes are not finite.
        link_up, link_down: messages of the autopilot arrive; it receives messages.
        delay_ns, jitter_ns: added to the delay of messages of the autopilot; at most jitter_ns, at random.
        lost_share: share of the autopilot's messages that are lost.
        noise_share: share of its messages with a wrong byte.
        answer_delay_ns: added to the delay of answers to TIMESYNC.
        answer_shift_ns: added to the time in these answers.
        answer_scatter_ns: the same, at random in both directions.
        second_system_id: of a second autopilot on the line; 0: none.
        stops_pipeline, stops_sender, stops_all: threads, or the process, that do not run.
        clock_rate: by which CLOCK_MONOTONIC is corrected, seconds per second."""

    broken_camera: int = -1
    delivers: bool = True
    repeats: int = 0
    stamp_shift_ns: int = 0
    frame_delay_ns: int = 0
    other_size: bool = False
    covered: float = 0.0
    hides_attitude: bool = False
    repeats_attitude: bool = False
    repeats_stamp: bool = False
    negates: bool = False
    not_a_number: bool = False
    link_up: bool = True
    link_down: bool = True
    delay_ns: int = 0
    jitter_ns: int = 0
    lost_share: float = 0.0
    noise_share: float = 0.0
    answer_delay_ns: int = 0
    answer_shift_ns: int = 0
    answer_scatter_ns: int = 0
    second_system_id: int = 0
    stops_pipeline: bool = False
    stops_sender: bool = False
    stops_all: bool = False
    clock_rate: float = 0.0


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault between two instants of the flight.

    Attributes:
        name: of its kind.
        begin_ns, end_ns: the same for an event.
        changes: values of Switches.
        event: name of the method of the loop that is called at its beginning; empty: none.
        recovery_s: after its end, without another fault, the sectors must be seen again within this time."""

    name: str
    begin_ns: int
    end_ns: int
    changes: dict[str, float] = field(default_factory=dict)
    event: str = ""
    recovery_s: float = 1.5


Kind = Callable[[np.random.Generator], tuple[dict[str, float], str, float]]
"""Returns changes, event and recovery_s of a random fault of a kind."""


def _switch(recovery_s: float = 1.5, **changes: float) -> Kind:
    return lambda rng: (dict(changes), "", recovery_s)


def _event(name: str, recovery_s: float) -> Kind:
    return lambda rng: ({}, name, recovery_s)


def _between(name: str, low: float, high: float, recovery_s: float = 1.5, *, both_signs: bool = False) -> Kind:
    def kind(rng: np.random.Generator) -> tuple[dict[str, float], str, float]:
        value = rng.uniform(low, high) * (rng.choice([-1.0, 1.0]) if both_signs else 1.0)
        return {name: round(value) if name.endswith("_ns") else float(value)}, "", recovery_s

    return kind


KINDS: dict[str, Kind] = {
    "camera delivers nothing": _switch(delivers=False),
    "camera repeats one image": _switch(repeats=1),
    "camera repeats its last images": lambda rng: ({"repeats": int(rng.integers(2, 12))}, "", 1.5),
    "camera stamps in the future": _between("stamp_shift_ns", 0.3 * NS, 5.0 * NS, 6.5),
    "camera stamps in the past": _between("stamp_shift_ns", -5.0 * NS, -0.45 * NS),
    "camera frames out of order": _between("frame_delay_ns", 0.1 * NS, 0.8 * NS),
    "camera has another size": _switch(other_size=True),
    "camera half covered": _between("covered", 0.3, 0.7),
    "camera covered": _switch(covered=1.0),
    "attitude missing": _switch(hides_attitude=True),
    "attitude repeated": _switch(repeats_attitude=True, recovery_s=5.0),
    "attitude and stamp repeated": _switch(repeats_stamp=True),
    "attitude with both signs": _switch(negates=True),
    "attitude not finite": _switch(not_a_number=True),
    "messages late": _between("delay_ns", 0.05 * NS, 1.5 * NS, 3.0),
    "messages with jitter": _between("jitter_ns", 0.02 * NS, 0.5 * NS, 3.0),
    "messages lost": _between("lost_share", 0.2, 0.95),
    "messages with noise": _between("noise_share", 0.1, 0.9),
    "answers late": _between("answer_delay_ns", 0.02 * NS, 0.8 * NS, 3.0),
    "answers wrong": _between("answer_shift_ns", 0.02 * NS, 5.0 * NS, 5.0, both_signs=True),
    "answers scattered": _between("answer_scatter_ns", 0.02 * NS, 2.0 * NS, 5.0),
    "another autopilot": _switch(second_system_id=2),
    "another autopilot with the same id": _switch(second_system_id=1, recovery_s=5.0),
    "nothing received": _switch(link_up=False, recovery_s=3.0),
    "nothing sent": _switch(link_down=False, recovery_s=3.0),
    "link lost": _switch(link_up=False, link_down=False, recovery_s=3.0),
    "pipeline stopped": _switch(stops_pipeline=True),
    "sender stopped": _switch(stops_sender=True),
    "process stopped": _switch(stops_all=True, recovery_s=3.0),
    "clock corrected": _between("clock_rate", 100e-6, 0.08, 5.0, both_signs=True),
    "heading reset": _event("reset_heading", 1.5),
    "position reset": _event("reset_position", 1.5),
    "change of the estimator": _event("change_estimator", 1.5),
    "autopilot rebooted": _event("reboot", 4.0),
    "service restarted": _event("restart", 4.0),
    "computer suspended": _event("suspend", 7.0),
}
"""The kinds of faults by name."""


def random_faults(seed: int, begin_s: float, end_s: float, names: tuple[str, ...] = tuple(KINDS)) -> list[Fault]:
    """The faults of a seed, always the same, one after the other: some overlap, most leave time to recover."""
    rng = np.random.default_rng([5, seed])
    faults: list[Fault] = []
    t_s = begin_s
    while True:
        name = names[int(rng.integers(len(names)))]
        changes, event, recovery_s = KINDS[name](rng)
        if name.startswith("camera"):
            changes["broken_camera"] = int(rng.integers(-1, 2))
        duration_s = 0.0 if event else float(rng.choice([0.15, 0.5, 1.5, 3.0]) * rng.uniform(0.7, 1.4))
        if t_s + duration_s + recovery_s > end_s:
            return faults
        begin_ns = round(t_s * NS)
        faults.append(Fault(name, begin_ns, begin_ns + round(duration_s * NS), changes, event, recovery_s))
        overlaps = rng.random() < 0.25
        t_s += float(rng.uniform(0.0, 0.5)) if overlaps else duration_s + recovery_s + 1.2


def switches_at(faults: list[Fault], flown_ns: int) -> Switches:
    """What is broken at an instant of the flight."""
    switches = Switches()
    for fault in faults:
        if fault.begin_ns <= flown_ns < fault.end_ns:
            for name, value in fault.changes.items():
                setattr(switches, name, value)
    return switches
