"""The client's queries of models and worlds of core, without a message between them. The classes of both have the same
fields."""

from __future__ import annotations

from typing import cast

from core.types import FrameModel
from core.world.snapshot import WorldSnapshot
from osape_client.model import CameraModel
from osape_client.query.space import PlacedModel, Space
from osape_client.world.snapshot import WorldSnapshot as ClientSnapshot
from osape_client.world.space import WorldSpace


def world_space(snapshot: WorldSnapshot) -> WorldSpace:
    """Returns the queries of a snapshot of the world."""
    return WorldSpace(cast(ClientSnapshot, snapshot))


def frame_space(model: FrameModel, position_ned_m: tuple[float, float, float]) -> Space:
    """Returns the queries of one model in ned."""
    return Space([PlacedModel(cast(CameraModel, model), position_ned_m)])
