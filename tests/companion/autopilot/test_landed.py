"""On the ground nothing at the camera's feet refuses arming, and nothing that is not seen is clear."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.landed import FRESH_NS, LandedState
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.config.avoidance import AvoidParams
from core.types import Ground
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import Vehicle

from ..report_chain import Chain
from ..sector_models import model, wall_at

NS = 1_000_000_000
ARMING_WANTS_CM = 60
NEAR = model(wall_at(0.0, 0.5), free_to_m=0.0, view_deg=72.0)


def vehicle(armed: bool) -> Vehicle:
    return Vehicle(1, "ArduPilot", 2, armed, 5, 0)


def says(state: int) -> Any:
    return dialect.MAVLink_extended_sys_state_message(0, state)


@pytest.mark.parametrize(
    ("state", "armed", "on_ground"),
    [(None, False, True), (None, True, False), (0, False, True), (1, True, True), (2, False, False), (3, True, False)],
)
def test_the_reported_landed_state_counts_and_else_whether_it_is_armed(
    state: int | None, armed: bool, on_ground: bool
) -> None:
    landed = LandedState()
    if state is not None:
        landed.take(says(state), NS)
    assert landed.on_ground(vehicle(armed), 2 * NS) == on_ground
    assert landed.on_ground(vehicle(armed), 2 * NS + FRESH_NS) == (not armed)


@pytest.mark.parametrize(("state", "near"), [(0, False), (1, False), (2, False), (3, True), (4, True)])
def test_take_off_and_landing(state: int, near: bool) -> None:
    landed = LandedState()
    assert not landed.takes_off_or_lands(NS)
    landed.take(says(state), NS)
    assert landed.takes_off_or_lands(2 * NS) == near
    assert not landed.takes_off_or_lands(2 * NS + FRESH_NS)


@pytest.mark.parametrize("kind", ["ArduPilot", "PX4", "ArduPilot or PX4"])
def test_what_is_near_on_the_ground_is_not_seen_and_not_clear(kind: str) -> None:
    chain = Chain(NEAR)
    chain.fly(1.0)
    flying = AutopilotNow(kind=kind, margin_m=2.0)
    before = chain.report(flying).values
    assert before is not None
    assert before[0] == 21
    standing = chain.report(replace(flying, on_ground=True)).values
    assert standing is not None
    assert (standing > ARMING_WANTS_CM).all()
    assert standing[0] in ({UNKNOWN} if kind == "PX4" else {212, 213})
    far = standing[np.flatnonzero(before > 75)]
    assert (far == before[before > 75]).all()


def test_a_vehicle_in_flight_is_not_landed_whatever_is_reported() -> None:
    chain = Chain(replace(NEAR, ground=Ground(seen=True, height_m=3.0, tolerance_m=0.25)))
    chain.fly(1.0)
    assert chain.ahead(AutopilotNow(kind="ArduPilot", margin_m=2.0, on_ground=True)) == 21


def test_it_is_asked_for_and_reaches_the_decision() -> None:
    posted: list[Any] = []
    part = ObstacleOutput(
        AvoidParams(send=True),
        CameraUse(cameras=("front",), timeout_s=0.3),
        AutopilotLine(lambda: vehicle(True), posted.append),
    )
    part.tick(NS)
    asked = [m for m in posted if m.get_type() == "COMMAND_LONG" and m.command == 511]
    assert 245 in [int(m.param1) for m in asked]
    assert not part._autopilot().on_ground
    part.message(says(1), time.monotonic_ns())
    assert part._autopilot().on_ground
