"""A frame that a second thread helps with: the same model, bit for bit, whoever did what and however late."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest

from core.extractor import Extractor
from core.helper import AtOnce, Done, Helper, Job
from core.packed import packed_model
from core.params import Params
from core.types import CameraInfo, ExtractorState, FrameModel, Intrinsics

pytestmark = pytest.mark.nojit
T = TypeVar("T")
INFO = CameraInfo("front", Intrinsics(96, 72, 70.0, 70.0, 47.5, 35.5))
LEVEL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
PITCHED = np.array([[np.cos(0.2), 0.0, np.sin(0.2)], [0.0, 1.0, 0.0], [-np.sin(0.2), 0.0, np.cos(0.2)]]) @ LEVEL


class Never:
    """Too late for everything."""

    def start(self, work: Callable[[], T]) -> Job[T]:
        return Done(None)


class Late:
    """Begins when it is asked for the result."""

    def start(self, work: Callable[[], T]) -> Job[T]:
        class Waiting:
            def result(self) -> T | None:
                return work()

        return Waiting()


class Beside:
    """A thread for each piece."""

    def start(self, work: Callable[[], T]) -> Job[T]:
        found: list[T] = []
        thread = threading.Thread(target=lambda: found.append(work()))
        thread.start()

        class Running:
            def result(self) -> T | None:
                thread.join()
                return found[0]

        return Running()


HELPERS = (AtOnce(), Never(), Late(), Beside())


def depth_of(seed: int) -> np.ndarray:
    """Ground, a wall with a hole, a pole, leaves."""
    rng = np.random.default_rng(seed)
    depth = np.full((72, 96), 7000, np.uint16)
    rows = np.arange(42, 72)
    depth[42:] = np.minimum(7000, 1500 * 70.0 / (rows - 35.5)).astype(np.uint16)[:, None]
    depth[12:30, 60:75] = 11000
    depth[5:60, 20 + seed : 23 + seed] = 3000
    leaves = rng.random((20, 20)) < 0.4
    depth[8:28, 36:56][leaves] = rng.integers(4000, 5000, int(leaves.sum()))
    depth[rng.random(depth.shape) < 0.05] = 0
    return depth


def models_of(params: Params, helper: Helper | None) -> list[FrameModel]:
    """Three frames with one extractor."""
    extractor, state, models = Extractor(params, helper), ExtractorState(), []
    for seed, R in enumerate((LEVEL, PITCHED, LEVEL)):
        model, state = extractor.extract(depth_of(seed), INFO, R, state)
        models.append(model)
    return models


@pytest.mark.parametrize("mode", ["safe", "paper"])
@pytest.mark.parametrize("helper", HELPERS, ids=lambda h: type(h).__name__)
def test_the_same_model_bit_for_bit(mode: str, helper: Helper) -> None:
    numbers = np.arange(20, dtype=np.uint8) % 15 + 1
    for alone, helped in zip(models_of(Params(mode=mode), None), models_of(Params(mode=mode), helper), strict=True):
        assert alone.valid
        assert len(alone.planes)
        assert helped.stats == alone.stats
        assert helped.ground == alone.ground
        if mode == "safe":
            assert packed_model(numbers, helped) == packed_model(numbers, alone)
        for name in ("planes", "support_px", "margin_m", "flags", "cluster"):
            np.testing.assert_array_equal(getattr(helped, name), getattr(alone, name))


class Broken:
    """Fails at one piece of a frame."""

    def __init__(self, at: int) -> None:
        self._left = at

    def start(self, work: Callable[[], T]) -> Job[T]:
        self._left -= 1
        broken = self._left < 0

        class Failed:
            def result(self) -> T | None:
                if broken:
                    raise RuntimeError("broken")
                return work()

        return Failed()


@pytest.mark.parametrize("piece", [0, 1])
def test_an_error_of_the_helper_is_no_model(piece: int) -> None:
    """What it should have found would be missing: free space where something stands."""
    with pytest.raises(RuntimeError, match="broken"):
        Extractor(Params(), Broken(piece)).extract(depth_of(0), INFO, LEVEL)
