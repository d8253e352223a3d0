"""The taps change nothing, and see every stage."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stages import Stopwatch, frame_of
from benchmarks.taps import STAGES, Calls, tapped
from core.extractor import Extractor
from core.types import ExtractorState


def test_a_tapped_call_gives_the_same_model_and_every_stage_is_seen() -> None:
    frame = frame_of("window", 5.0, -5.0, 160, 0.0015, 1)
    extractor, state = Extractor(), ExtractorState()
    plain, _ = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state)
    calls = Calls()
    with tapped(calls):
        seen, _ = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state)
    assert len(plain.planes) > 0
    assert np.array_equal(plain.planes, seen.planes)
    assert {name for _, _, name in STAGES} == set(calls.names())
    assert np.array_equal(calls.of("classify").before[0], frame.depth_mm)


def test_the_stages_are_themselves_again_after_the_block_even_after_an_error() -> None:
    before = [getattr(module, name) for _, module, name in STAGES]
    with pytest.raises(ZeroDivisionError), tapped(Stopwatch()):
        raise ZeroDivisionError
    assert all(getattr(m, n) is f for (_, m, n), f in zip(STAGES, before, strict=True))
