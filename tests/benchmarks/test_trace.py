"""A watched call gives the same model, and what went in and out of its stages is kept."""

from __future__ import annotations

import numpy as np

from benchmarks.trace import Calls, traced
from companion.bench.frames import Flight, render_sequence
from core.extractor import Extractor


def test_a_tapped_call_gives_the_same_model_and_copies_of_what_its_stages_saw() -> None:
    shot = render_sequence("window", "window", (160, 120), roll_deg=5.0, pitch_deg=-5.0, images=1)
    extractor = Extractor()
    plain = Flight(extractor, shot).frame()
    calls = Calls()
    with traced(calls):
        seen = Flight(extractor, shot).frame()
    assert len(plain.planes) > 0
    assert np.array_equal(plain.planes, seen.planes)
    given = calls.of("classify").before[0]
    assert np.array_equal(given, shot.depth_mm[0])
    assert given is not shot.depth_mm[0]
    assert {"level_view", "extract_strips", "layered_prisms"} <= set(calls.names())
