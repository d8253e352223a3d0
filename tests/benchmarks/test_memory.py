"""Nothing grows while frames of all kinds go through one extractor; and the harness would see it if something did."""

from __future__ import annotations

import ctypes
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import benchmarks.speed.memory as memory
import benchmarks.speed.section_memory as page
from benchmarks.speed.cases import KINDS
from benchmarks.speed.memory import (
    LARGE,
    SIZES,
    Sample,
    every_frame,
    growth_per_10k,
    growth_words,
    held_bytes,
    in_use_bytes,
    mixed_frames,
    shots_of,
    watch,
)
from core.extractor import Extractor
from core.types import ExtractorState

QUICK_FRAMES, SOAK_FRAMES = 300, 20_000
HELD_SHARE = 0.02
"""Buffers are as long as a frame has strips: a frame handed another state may need a little more than any before."""
STEP_SHARE, MOST_STEPS = 0.01, 8
"""Tables grow by this share at least when they do, and seldom: none is beyond what the largest image can need."""
QUICK_RESIDENT = 4e6
"""Bytes that the allocator may take more: fragments, not frames (one frame's arrays at 160x120 are 0.5 MB)."""
IN_USE = 1e6
"""Bytes besides what the extractor holds that may be in use in addition: the last model, lists of the interpreter."""
BLOCKS = 250
"""Objects of Python that may be more: one a frame kept would be as many as the frames."""


@pytest.mark.slow
def test_a_few_hundred_frames_leave_nothing_behind() -> None:
    shots = shots_of([SIZES[0]], images=1)
    samples = watch(every_frame(shots), mixed_frames(shots, []), 2 * QUICK_FRAMES, QUICK_FRAMES // 2)
    first, warm, last = samples[0], samples[2], samples[-1]
    assert [s.frames for s in samples] == [0, 150, 300, 450, 600]
    assert 0 < last.held <= (1.0 + HELD_SHARE) * first.held
    assert last.resident - first.resident < QUICK_RESIDENT
    # calls of kernels with records keep up to 450 blocks, most of them since the first frames: a leak goes on after them
    assert last.blocks - warm.blocks < BLOCKS


@pytest.mark.soak
def test_many_frames_leave_nothing_behind() -> None:
    small, large = shots_of(SIZES), shots_of([LARGE])
    samples = watch(every_frame([*large, *small]), mixed_frames(small, large), SOAK_FRAMES, SOAK_FRAMES // 20)
    text = growth_words(samples)
    # the same image needs more room in another state: tables then grow, in steps; what leaks grows from look to look
    rises = [b.held - a.held for a, b in pairwise(samples)]
    steps = [rise for rise in rises if rise > STEP_SHARE * samples[0].held]
    assert len(steps) <= MOST_STEPS, text
    assert sum(rises) - sum(steps) <= HELD_SHARE * samples[0].held, text
    beside = [s.in_use - s.held for s in samples]
    assert max(beside) - beside[0] < IN_USE, text
    assert samples[-1].blocks - samples[1].blocks < BLOCKS, text


class Hoarder(Extractor):
    """Keeps every image, as a careless change might."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: list[Any] = []

    def extract(self, depth: Any, info: Any, R: Any, state: Any = None, **kwargs: Any) -> Any:
        self.kept.append([np.array(depth), object()])
        return super().extract(depth, info, R, state, **kwargs)


@pytest.mark.slow
def test_an_extractor_that_keeps_images_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "Extractor", Hoarder)
    shots = shots_of([SIZES[0]], KINDS[-1:])
    samples = watch(every_frame(shots), mixed_frames(shots, []), 300, 100)
    assert samples[-1].held > (1.0 + HELD_SHARE) * samples[0].held
    assert samples[-1].blocks - samples[0].blocks > BLOCKS
    image = shots[0].depth_mm[0].nbytes
    assert growth_per_10k(samples, lambda s: s.held) == pytest.approx(
        1e4 * 1.1 * image, rel=0.05
    )  # one in ten in floats


class Leaker(Extractor):
    """Gets memory from the C library for every frame and never gives it back."""

    def extract(self, depth: Any, info: Any, R: Any, state: Any = None, **kwargs: Any) -> Any:
        library = ctypes.CDLL(None)
        library.malloc.restype = ctypes.c_void_p
        assert library.malloc(ctypes.c_size_t(5000))
        return super().extract(depth, info, R, state, **kwargs)


@pytest.mark.slow
@pytest.mark.skipif(in_use_bytes() == 0, reason="this C library does not tell what is in use")
def test_memory_that_is_not_released_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "Extractor", Leaker)
    shots = shots_of([SIZES[0]], KINDS[-1:])
    samples = watch(every_frame(shots), mixed_frames(shots, []), 400, 200)
    beside = [s.in_use - s.held for s in samples]
    assert max(beside) - beside[0] > IN_USE
    assert samples[-1].held <= (1.0 + HELD_SHARE) * samples[0].held


def test_held_bytes_counts_each_array_once_wherever_it_hangs() -> None:
    base = np.zeros(100, np.uint8)

    class Owner:
        def __init__(self) -> None:
            self.views = [base[:10], {"b": base[20:]}, (base,)]
            self.other = np.zeros(7, np.int64)

    Owner.__module__ = "core.something"
    assert held_bytes(Owner()) == 100 + 56
    extractor = Extractor()
    shot = shots_of([SIZES[0]], KINDS[:1])[0]
    most = 50_000 + 30 * extractor.params.ground_max_samples  # samples of the ground, and tables for strips of one size
    assert held_bytes(extractor) < most
    extractor.extract(shot.depth_mm[0], shot.info, shot.R_level_optical, ExtractorState())
    assert held_bytes(extractor) > 3 * shot.depth_mm[0].nbytes


def test_growth_is_a_slope() -> None:
    samples = [Sample(n, 1_000_000 + 3 * n, 500, 10, 0) for n in (0, 1000, 2000, 5000)]
    assert growth_per_10k(samples, lambda s: s.resident) == pytest.approx(30_000)
    assert growth_per_10k(samples, lambda s: s.held) == 0.0
    assert "grew by +30.0 kB per 10 000 frames, from 1.0 to 1.0 MB" in growth_words(samples)
    with pytest.raises(ValueError, match="two at least"):
        growth_per_10k(samples[:1], lambda s: s.resident)


def test_the_mix_is_the_same_each_time() -> None:
    shots = shots_of([SIZES[0]], KINDS[:2])
    one, again = mixed_frames(shots, []), mixed_frames(shots, [])
    for _ in range(20):
        (depth, _, R), (depth_again, _, R_again) = next(one), next(again)
        np.testing.assert_array_equal(depth, depth_again)
        np.testing.assert_array_equal(R, R_again)


@pytest.mark.slow
def test_the_section_makes_its_page_and_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    samples = [Sample(n, 200_000_000, 20_000_000, 480_000, 90_000_000) for n in range(0, 1100, 100)]
    monkeypatch.setattr(page, "measured", lambda frames, every: samples)
    text = page.section(tmp_path, quick=True)
    assert text.startswith("1000 frames in one process")
    assert "| 1000 | 200.0 | 20.00 | 480000 | 90.00 |" in text
    assert (tmp_path / "memory.png").stat().st_size > 5000
