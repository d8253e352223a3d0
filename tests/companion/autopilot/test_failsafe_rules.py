"""The rules of the values that are sent, for any state: against their definition, not against the code that makes them.

The state is drawn without regard to whether cameras could produce it: each sector has a state, distances, and any set of
blind and seeing cameras. A sequence of such states is decided with one `BlindPolicy`, as in flight."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.autopilot.failsafe import (
    GROUND_CM,
    AutopilotNow,
    BlindPolicy,
    PolicyInput,
    braking_reach,
    policy_of,
)
from companion.autopilot.obstacle_distance import UNKNOWN, clear_cm, for_reader, near_cm
from companion.autopilot.obstacle_memory import Remembered
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.polar_histogram import SECTORS, SectorScan, SectorState, centres_rad
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.config.avoidance import AvoidParams
from drivers.mavlink.session_types import ARDUPILOT, PX4
from tests.nightly import examples

from ..report_chain import CAMERA, Chain
from ..report_chain import CLEAR as CLEAR_VIEW

MS, NS = 1_000_000, 1_000_000_000
AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, min_distance_m=0.2, avoid_margin_m=2.0)
CLEAR = clear_cm(AVOID)
WALL_CM = 302
"""Of PX4 with CP_DIST 3 m."""
AUTOPILOTS = (
    AutopilotNow(),
    AutopilotNow(kind=ARDUPILOT, margin_m=3.0),
    AutopilotNow(kind=PX4),
    AutopilotNow(kind=PX4, cp_dist_m=3.0),
    AutopilotNow(kind=f"{ARDUPILOT} or {PX4}", margin_m=2.0),
    AutopilotNow(kind="generic"),
)


def drawn(rng: np.random.Generator, now_ns: int) -> PolicyInput:
    """A state in which sectors of one kind lie beside each other, as those of a view do."""

    def runs(values: list[int]) -> np.ndarray:
        """(72,), in runs of 1 to 20 sectors."""
        drawn_values = np.repeat(
            np.array(values)[rng.integers(len(values), size=SECTORS)], rng.integers(1, 21, SECTORS)
        )
        return np.roll(drawn_values[:SECTORS], int(rng.integers(SECTORS)))

    state = runs([SectorState.UNSEEN, SectorState.CLEAR, SectorState.OBSTACLE]).astype(np.uint8)
    distance_m = np.where(runs([0, 1, 2]) > 0, rng.uniform(0.0, 15.0, SECTORS), np.inf)
    distance_m[state == SectorState.CLEAR] = np.inf
    near = (state == SectorState.OBSTACLE) & (distance_m >= AVOID.max_distance_m)
    distance_m[near] = rng.uniform(0.0, AVOID.max_distance_m - 0.01, int(near.sum()))
    seeing = runs([0, 1]).astype(bool)
    recalled_m = np.where(runs([0, 0, 1]) > 0, rng.uniform(0.0, 8.0, SECTORS), np.inf)
    return PolicyInput(
        SectorScan(state, distance_m, rng.uniform(0.0, 12.0, SECTORS), centres_rad(), np.zeros((SECTORS, 1, 1), bool)),
        Remembered(recalled_m, np.where(rng.random(SECTORS) < 0.5, recalled_m, np.inf)),
        runs([0, 1]).astype(bool) if rng.random() < 0.7 else np.zeros(SECTORS, bool),
        seeing if rng.random() < 0.8 else np.zeros(SECTORS, bool),
        seeing & runs([0, 1, 1]).astype(bool),
        now_ns - int(rng.integers(0, NS)),
        runs([0, 0, 1]).astype(bool),
        None if rng.random() < 0.3 else (float(rng.uniform(-8.0, 8.0)), float(rng.uniform(-8.0, 8.0))),
        bool(rng.random() < 0.2),
        runs([0, 0, 1]).astype(bool),
    )


@examples(3)
@given(st.integers(0, 2**32 - 1), st.sampled_from(AUTOPILOTS), st.sampled_from(["auto", "stop", "unknown"]))
def test_the_rules_hold_in_every_state(seed: int, autopilot: AutopilotNow, blind: str) -> None:
    rng, now_ns = np.random.default_rng(seed), 100 * NS
    avoid = AvoidParams(
        radius_m=0.3, max_distance_m=12.0, min_distance_m=0.2, avoid_margin_m=2.0, blind=blind, silence_s=2.0
    )
    decides, policy = BlindPolicy(avoid), policy_of(avoid, autopilot)
    for _ in range(6):
        now_ns += int(rng.integers(NS // 20, 2 * NS))
        view = drawn(rng, now_ns)
        values = decides.values(view, policy, now_ns)
        if values is None:
            assert policy.name != "stop"
            assert not view.seeing.any()
            continue
        wall_cm = policy.wall_cm if policy.name == "stop" else 0
        sent = for_reader(values, avoid, autopilot.kind, braking_reach(view, avoid, policy), wall_cm)
        clear = sent == CLEAR
        seen_clear = (view.scan.state == SectorState.CLEAR) & view.seeing
        assert not (clear & ~seen_clear).any()
        assert (sent[~clear] != CLEAR).all()
        assert ((sent == UNKNOWN) | (sent <= CLEAR)).all()
        if autopilot.kind == PX4:
            check_px4(view, sent)
        elif policy.name == "stop":
            check_stop(view, sent, policy.wall_m)


def check_stop(view: PolicyInput, sent: np.ndarray, wall_m: float) -> None:
    """An autopilot that may take unknown for clear: where a camera covers a sector, something stops the vehicle unless the
    sector was seen clear."""
    not_seen = view.scan.state == SectorState.UNSEEN
    seen_clear = (view.scan.state == SectorState.CLEAR) & view.seeing
    covered = view.whole & not_seen
    assert (sent[covered] < CLEAR).all()
    alone = view.blind & (~view.whole | view.heights_lost) & ~seen_clear
    assert (sent[alone] < CLEAR).all()
    wall_cm = max(math.ceil(100.0 * wall_m), GROUND_CM)
    assert (sent[alone] <= wall_cm).all()
    obstacles = (view.scan.state == SectorState.OBSTACLE) & view.seeing
    limit = np.maximum(near_cm(view.scan.distance_m[obstacles], AVOID), wall_cm if view.on_ground else 0)
    assert (sent[obstacles] <= limit).all()
    known = np.isfinite(view.recalled.distance_m)
    limit = np.maximum(near_cm(view.recalled.distance_m[known], AVOID), wall_cm if view.on_ground else 0)
    assert (sent[known] <= limit).all()


def check_px4(view: PolicyInput, sent: np.ndarray) -> None:
    """PX4 does not move into unknown, and brakes for what is nearer: no sector is sent farther than what was found in it, or than the
    wall."""
    found_m = np.where(view.scan.state == SectorState.OBSTACLE, view.scan.distance_m, np.inf)
    known = np.isfinite(found_m)
    limit = np.maximum(near_cm(found_m[known], AVOID), WALL_CM)
    if not view.on_ground:  # where what is nearer than GROUND_CM is not sent
        assert ((sent[known] == UNKNOWN) | (sent[known] <= limit)).all()


FAULTS = ("", "", "", "frames", "attitudes", "deliver", "invalid", "late", "future", "camera")
"""What does not arrive, or is wrong; empty: nothing."""


class Evidence:
    """What the service knows of a camera, by the definition of blind in docs/explanation/failsafe.md."""

    def __init__(self) -> None:
        self.attitude_ns = -NS
        self.frames: list[tuple[int, int, bool]] = []  # arrival, exposure, valid
        self.fault = ""

    def allows_clear(self, now_ns: int) -> bool:
        """Whether a sector may be clear."""
        arrived = [(exposed_ns, valid) for at_ns, exposed_ns, valid in self.frames if at_ns <= now_ns]
        last = arrived[-AVOID.recover_frames :]
        if self.fault or len(last) < AVOID.recover_frames or not all(valid for _, valid in last):
            return False
        return now_ns - last[-1][0] <= 300 * MS and now_ns - self.attitude_ns <= 150 * MS


@examples(1)
@given(st.integers(0, 2**32 - 1))
def test_no_sector_is_clear_without_the_evidence_for_it(seed: int) -> None:
    """Random faults of the frames, of their stamps, of the attitude and of the camera, in any order and for any time."""
    rng, evidence = np.random.default_rng(seed), Evidence()
    coarse = replace(AVOID, rays=2, slices=6, step_m=0.5)
    chain = Chain(CLEAR_VIEW, coarse)
    chain.builder = ObstacleReportBuilder(
        coarse, CameraUse(cameras=("front",), timeout_s=0.3, frame_fault=lambda camera: evidence.fault)
    )
    chain.builder.announce(CAMERA)
    autopilot = AUTOPILOTS[int(rng.integers(len(AUTOPILOTS)))]
    clear_once = False
    for k in range(10):
        faults = set() if k == 0 else set(rng.choice(FAULTS, int(rng.integers(1, 3))).tolist())
        evidence.fault = "frozen" if "camera" in faults else ""
        chain.sees.found = replace(CLEAR_VIEW, valid="invalid" not in faults)
        late_ns = int(rng.integers(0, 600 * MS)) if "late" in faults else 20 * MS
        late_ns -= int(rng.integers(0, NS)) if "future" in faults else 0
        for _ in range(60 if k == 0 else int(rng.integers(1, 60))):
            chain.fly(0.01, frames=False, attitudes="attitudes" not in faults)
            if "attitudes" not in faults:
                evidence.attitude_ns = chain.now_ns
            if "frames" not in faults and chain.now_ns // (10 * MS) % 10 == 0:
                for result in chain.results(late_ns) if "deliver" not in faults else ():
                    chain.builder.result(result)
                    evidence.frames.append((chain.now_ns, min(result.t_exposure_ns, chain.now_ns), result.valid))
            if chain.now_ns // (10 * MS) % 4:
                continue
            values = chain.report(autopilot).values
            if values is not None and (values == CLEAR).any():
                clear_once = True
                assert evidence.allows_clear(chain.now_ns)
        assert clear_once
