"""The kinds of faults, and the random sequence of faults of a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .switches import NS, Fault

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
    "camera measures few pixels": _between("unmeasured_share", 0.5, 0.99),
    "camera with more noise": _between("noise_factor", 1.5, 3.0),
    "camera opened again": _event("reopen", 5.0),
    "attitude missing": _switch(hides_attitude=True),
    "attitude seldom": _between("attitude_gap_ns", 0.08 * NS, 0.4 * NS),
    "attitude repeated": _switch(repeats_attitude=True, recovery_s=5.0),
    "attitude and stamp repeated": _switch(repeats_stamp=True),
    "attitude with both signs": _switch(negates=True),
    "attitude not finite": _switch(not_a_number=True),
    "messages late": _between("delay_ns", 0.05 * NS, 1.5 * NS, 3.0),
    "messages very late": _between("delay_ns", 1.5 * NS, 6.0 * NS, 5.0),
    "messages in bursts": _between("burst_ns", 0.05 * NS, 1.0 * NS, 3.0),
    "messages twice": lambda rng: (
        {
            "copied_share": float(rng.uniform(0.05, 1.0)),
            "copy_delay_ns": round(rng.choice([0.002, 0.1, 0.6, 3.0]) * NS),
        },
        "",
        5.0,
    ),
    "messages by two routes": _between("route_delay_ns", 0.02 * NS, 2.0 * NS, 5.0),
    "requests late": _between("request_delay_ns", 0.02 * NS, 3.0 * NS, 5.0),
    "messages with jitter": _between("jitter_ns", 0.02 * NS, 0.5 * NS, 3.0),
    "messages lost": _between("lost_share", 0.2, 0.95),
    "messages with noise": _between("noise_share", 0.1, 0.9),
    "answers late": _between("answer_delay_ns", 0.02 * NS, 0.8 * NS, 3.0),
    "answers wrong": _between("answer_shift_ns", 0.02 * NS, 5.0 * NS, 5.0, both_signs=True),
    "answers scattered": _between("answer_scatter_ns", 0.02 * NS, 2.0 * NS, 5.0),
    "another autopilot": _switch(second_system_id=2, recovery_s=61.0),
    "another autopilot with the same id": _switch(second_system_id=1, recovery_s=5.0),
    "nothing received": _switch(link_up=False, recovery_s=3.0),
    "nothing sent": _switch(link_down=False, recovery_s=3.0),
    "link lost": _switch(link_up=False, link_down=False, recovery_s=3.0),
    "pipeline stopped": _switch(stops_pipeline=True),
    "pipeline slow": _between("pipeline_ns", 0.05 * NS, 0.6 * NS),
    "sender stopped": _switch(stops_sender=True),
    "process stopped": _switch(stops_all=True, recovery_s=3.0),
    "clock corrected": _between("clock_rate", 100e-6, 0.08, 5.0, both_signs=True),
    "vehicle carried": _switch(disarmed=True),
    "parameter changed": _event("change_parameter", 1.5),
    "heading reset": _event("reset_heading", 1.5),
    "position reset": _event("reset_position", 1.5),
    "change of the estimator": _event("change_estimator", 1.5),
    "autopilot rebooted": _event("reboot", 4.0),
    "autopilot clock stepped": _event("step_clock", 5.0),
    "service restarted": _event("restart", 4.0),
    "computer suspended": _event("suspend", 7.0),
}
"""The kinds of faults by name."""


def random_faults(seed: int, begin_s: float, end_s: float, names: tuple[str, ...] = tuple(KINDS)) -> list[Fault]:
    """The faults of a seed, always the same, one after the other: some overlap, most leave time to recover."""
    rng = np.random.default_rng([5, seed])
    faults: list[Fault] = []
    t_s = begin_s if names else end_s
    while True:
        if t_s >= end_s:
            return faults
        name = names[int(rng.integers(len(names)))]
        changes, event, recovery_s = KINDS[name](rng)
        camera = int(rng.integers(-1, 2)) if name.startswith("camera") else -1
        duration_s = 0.0 if event else float(rng.choice([0.15, 0.5, 1.5, 3.0]) * rng.uniform(0.7, 1.4))
        if t_s + duration_s + recovery_s > end_s:
            return faults
        begin_ns = round(t_s * NS)
        faults.append(Fault(name, begin_ns, begin_ns + round(duration_s * NS), changes, event, recovery_s, camera))
        overlaps = rng.random() < 0.4
        t_s += float(rng.uniform(0.0, 0.5)) if overlaps else duration_s + recovery_s + 1.2
