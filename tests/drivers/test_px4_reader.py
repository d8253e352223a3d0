"""The model of PX4's obstacle map against the rules of CollisionPrevention.cpp."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.mavlink.dialect import dialect
from drivers.simulation.firmware_models.px4 import Px4Reader

NS = 1_000_000_000


def message(cm: int, max_cm: int) -> Any:
    return dialect.MAVLink_obstacle_distance_message(0, 0, [cm] * 72, 5, 20, max_cm, 5.0, 0.0, 12)


@pytest.mark.parametrize("cm", [500, 1201])
def test_a_bin_without_fresh_data_takes_any_range(cm: int) -> None:
    """PX4 resets a stale bin to 65535, and then accepts an obstacle of any range, and clear of a longer one (_enterData)."""
    px4 = Px4Reader()
    px4.read(message(300, 600), NS)
    px4.read(message(cm, 1200), NS + NS // 4)
    assert set(px4.bins_cm(NS + NS // 4)) == {300}  # a sensor of a longer range does not replace a fresh obstacle
    px4.read(message(cm, 1200), 2 * NS)
    assert set(px4.bins_cm(2 * NS)) == {cm}


def test_without_data_a_vehicle_with_another_system_id_than_1_does_not_change_to_hold() -> None:
    """Collision prevention commands Hold to system 1 (_publishVehicleCmdDoLoiter), and Commander handles only commands to its own
    system, or to all."""
    for system_id in (1, 2):
        px4 = Px4Reader(system_id=system_id)
        px4.read(message(300, 1200), NS)
        assert not px4.holds(6 * NS)
        assert px4.holds(7 * NS) == (system_id == 1)
        assert px4.room_m(0.0, 7 * NS) == 0.0
