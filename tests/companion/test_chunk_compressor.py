"""Chunks of noise are compressed at the quickest level, all others as asked."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard

from companion.chunk_compressor import QUICKEST, TRIED_EVERY, ChunkCompressor

RNG = np.random.default_rng(5)
SMOOTH = np.repeat(RNG.integers(4000, 5000, 12_000, dtype=np.uint16), RNG.integers(1, 17, 12_000)).tobytes()
NOISE = RNG.integers(4000, 5000, 100_000, dtype=np.uint16).tobytes() + SMOOTH[:8000]


def at(level: int, chunk: bytes) -> bytes:
    return zstandard.ZstdCompressor(level=level).compress(chunk)


def given(compressor: ChunkCompressor, chunk: bytes) -> bytes:
    out = compressor.compress(memoryview(chunk))
    assert zstandard.ZstdDecompressor().decompress(out) == chunk
    return out


def test_noise_is_written_at_the_quickest_level_and_what_is_smooth_as_asked() -> None:
    assert at(-1, NOISE) != at(QUICKEST, NOISE)
    assert len(at(QUICKEST, NOISE)) <= 1.03 * len(at(-1, NOISE))
    assert len(at(QUICKEST, SMOOTH)) > 1.1 * len(at(-1, SMOOTH))
    noisy, smooth = ChunkCompressor(-1), ChunkCompressor(-1)
    for _ in range(3):
        assert given(noisy, NOISE) == at(QUICKEST, NOISE)
        assert given(smooth, SMOOTH) == at(-1, SMOOTH)


def test_what_a_camera_gives_is_tried_again() -> None:
    """A camera that flies out of the noise is soon compressed as asked, and back."""
    compressor = ChunkCompressor(-1)
    given(compressor, NOISE)
    levels = [given(compressor, SMOOTH) == at(-1, SMOOTH) for _ in range(TRIED_EVERY)]
    assert levels == [False] * (TRIED_EVERY - 1) + [True]
    levels = [given(compressor, NOISE) == at(QUICKEST, NOISE) for _ in range(TRIED_EVERY)]
    assert levels == [False] * (TRIED_EVERY - 1) + [True]


@pytest.mark.parametrize("level", [-20, QUICKEST, 0, 1, 3])
def test_who_asks_for_size_or_for_less_time_still_gets_that_alone(level: int) -> None:
    compressor = ChunkCompressor(level)
    for chunk in (NOISE, SMOOTH, b""):
        assert given(compressor, chunk) == at(level, chunk)


def test_the_same_chunks_make_the_same_file() -> None:
    chunks = [NOISE, SMOOTH, NOISE[:7], b"", SMOOTH[:5000]] * 40
    one, other = ChunkCompressor(-2), ChunkCompressor(-2)
    assert [given(one, c) for c in chunks] == [given(other, c) for c in chunks]
