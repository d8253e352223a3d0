"""The service as a process merges what its camera sees and streams it; when it ends, nothing of it is free."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import Occupancy
from osape_client.world.mirror import WorldMirror
from tests.waiting import PATIENCE_S, until

from ..live_service import Live, flown
from .test_service import CONFIG

pytestmark = pytest.mark.process

WORLD = '\n[publish]\nworld = "ipc://{run}/world"\nworld_requests = "ipc://{run}/world-snapshot"\n'


def test_the_live_world_is_mirrored_and_ends_with_the_service(tmp_path: Path, renders: Path) -> None:
    live = Live(tmp_path, CONFIG + WORLD, renders)
    try:
        with flown(live), WorldMirror(f"ipc://{tmp_path}/run/world", f"ipc://{tmp_path}/run/world-snapshot") as mirror:
            live.start()
            health = live.subscribe("health", pb.Health)
            assert until(lambda: mirror.update(0.2) and len(mirror.space.snapshot.blocks) > 0, PATIENCE_S), (
                mirror.cause + live.output()
            )
            assert until(lambda: (mirror.update(0.2), len(mirror.space.snapshot.planes) >= 4)[1], PATIENCE_S)
            picture = mirror.space.snapshot
            free = np.unpackbits(picture.masks.view(np.uint8)).sum()
            assert free > 200
            # the middle of each plane is occupied
            middle = np.column_stack(
                [picture.planes[:, [0, 2]].mean(1), picture.planes[:, [1, 3]].mean(1), picture.planes[:, 4:].mean(1)]
            )
            assert (mirror.space.points(middle, 0.01) == Occupancy.OCCUPIED).all()
            health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, PATIENCE_S)
            assert live.stop() == 0
            assert until(lambda: not mirror.update(0.05))
            assert Occupancy.FREE not in mirror.space.points(middle)
    finally:
        live.close()


def test_one_address_without_the_other_is_refused() -> None:
    from companion.config.service import PublishConfig

    with pytest.raises(ValueError, match="world and world_requests: give both addresses, or neither"):
        PublishConfig(world="ipc://x")
    with pytest.raises(ValueError, match="world and world_requests have the same address"):
        PublishConfig(world="ipc:///tmp/x", world_requests="ipc:///tmp/x")
