"""A hovering vehicle that is given one model a frame."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np

from core.types import FrameModel

from .report_chain import CLEAR, Chain
from .sector_models import model, wall_at

CLEAR_CM = 1201


def pole(distance_m: float, support_px: int, at_deg: float = 0.0) -> FrameModel:
    found = model(wall_at(at_deg, distance_m), free_to_m=13.0, view_deg=72.0)
    return replace(found, support_px=np.array([support_px], np.int32))


def seeing() -> Chain:
    """A hovering vehicle that has seen ten free frames."""
    return deepcopy(_seeing_free())  # ten frames take three times as long as their copy


@cache
def _seeing_free() -> Chain:
    return after_ten(CLEAR)


def after_ten(found: FrameModel) -> Chain:
    """A hovering vehicle after ten such frames; what is sent is decided after each, as the sender's thread does."""
    chain = Chain(found)
    chain.position = (0.0, 0.0, -2.0)
    for _ in range(10):
        one_frame(chain, found)
    return chain


def one_frame(chain: Chain, found: FrameModel) -> None:
    chain.sees.found = found
    chain.fly(0.1)
    chain.report()
