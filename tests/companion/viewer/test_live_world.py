"""The merged world for the page: which planes are drawn, and that one which may not be used is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.viewer.live_world import LiveWorld, nearest_cm
from core.world.world import World
from osape_client.world.snapshot import WorldSnapshot
from tests.client.test_world_mirror import WALLS, Speaker, look
from tests.core.worlds import seen
from tests.waiting import until

pytestmark = pytest.mark.process

HERE = (100.0, 50.0, -2.0)


def picture(n: int) -> WorldSnapshot:
    """A row of walls along x, the k-th one 4 m wide, seen at k."""
    x = 4.0 * np.arange(n)
    planes = np.stack([x, np.full(n, 50.0), x + 4.0, np.full(n, 50.0), np.full(n, -5.0), np.zeros(n)], axis=1)
    return WorldSnapshot(
        section=1,
        slots=np.arange(n, dtype=np.int32),
        planes=planes.astype(np.float32),
        margin_m=np.full(n, 0.1, np.float32),
        flags=np.zeros(n, np.uint8),
        hits=np.full(n, 3, np.int32),
        seen_ns=np.arange(n, dtype=np.int64),
        blocks=np.zeros((0, 3), np.int32),
        masks=np.zeros((0, 256), np.uint64),
    )


def test_all_planes_of_a_small_world_are_drawn_in_centimetres() -> None:
    assert nearest_cm(picture(2), None) == [0, 5000, 400, 5000, -500, 0, 400, 5000, 800, 5000, -500, 0]
    assert nearest_cm(WorldSnapshot.empty(), HERE) == []


def test_of_a_large_one_those_near_the_vehicle_else_the_newest() -> None:
    near = np.array(nearest_cm(picture(200), HERE, most=3)).reshape(-1, 6)
    assert sorted(near[:, 0]) == [9200, 9600, 10000] or sorted(near[:, 0]) == [9600, 10000, 10400]
    newest = np.array(nearest_cm(picture(200), None, most=3)).reshape(-1, 6)
    assert sorted(newest[:, 0]) == [78800, 79200, 79600]


@pytest.fixture(scope="module")
def compiled() -> None:
    """As the service does before it takes frames."""
    world = World()
    for k in range(2):
        world.add(seen(WALLS, (0.0, 0.0), 0.0, k))


@pytest.mark.usefixtures("compiled")
def test_a_world_is_drawn_while_it_may_be_used_and_taken_away_when_not(tmp_path: Path) -> None:
    speaker = Speaker(tmp_path)
    world = LiveWorld(*speaker.addresses, None, lambda: None)
    try:
        assert world.update(0) == {"number": 0, "received": False, "cause": "", "total": 0, "planes": None}
        world.open()
        speaker.service.open()

        def drawn() -> bool:
            look(speaker)
            return world.update(0)["total"] > 0

        assert until(drawn)
        update = world.update(0)
        assert update["received"]
        assert update["cause"] == ""
        assert len(update["planes"]) == 6 * update["total"]
        assert update["planes"][0] == 800
        speaker.service.close()
        assert until(lambda: world.update(0)["cause"] != "")
        gone = world.update(update["number"])
        assert "old" in gone["cause"]
        assert gone["planes"] == []
        assert world.update(gone["number"])["planes"] is None
    finally:
        world.close()
        speaker.close()
