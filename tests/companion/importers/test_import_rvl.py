"""RVL against an encoder of the tests, against bytes written by hand, and damaged."""

from __future__ import annotations

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from companion.importers.rvl import decode_rvl
from drivers.base import BadData

from ..rvl_encoder import encode_rvl, words_of

pytestmark = pytest.mark.unit


def scene(height: int, width: int) -> NDArray[np.uint16]:
    """A ramp with holes, the largest and the smallest depth beside each other."""
    rng = np.random.default_rng(4)
    image = np.tile(np.arange(width, dtype=np.uint16) * 7 + 400, (height, 1))
    image[rng.random(image.shape) < 0.2] = 0
    image[1, :2] = [65535, 1]
    return image


def test_bytes_written_by_hand() -> None:
    """2 zeros, 3 others: 5, 4, 20. Numbers 2, 3, 10, 1, 32 are the groups 2, 3, A 1, 1, 8 4, and one of padding."""
    data = struct.pack("<III", 5, 1, 0x23A11840)
    assert decode_rvl(data).tolist() == [[0, 0, 5, 4, 20]]


@pytest.mark.parametrize("size", [(3, 4), (1, 1), (30, 41), (120, 160)])
def test_what_was_encoded(size: tuple[int, int]) -> None:
    image = scene(max(size[0], 2), max(size[1], 2))[: size[0], : size[1]]
    assert (decode_rvl(encode_rvl(image)) == image).all()


@given(
    arrays.arrays(
        np.uint16, st.tuples(st.integers(1, 6), st.integers(1, 9)), elements=st.sampled_from((0, 1, 65535, 7))
    )
)
def test_any_image(image: NDArray[np.uint16]) -> None:
    assert (decode_rvl(encode_rvl(image)) == image).all()


@pytest.mark.parametrize("value", [0, 65535])
def test_an_image_of_one_value(value: int) -> None:
    image = np.full((4, 5), value, np.uint16)
    assert (decode_rvl(encode_rvl(image)) == image).all()


def test_data_cut_short_at_any_place() -> None:
    data = encode_rvl(scene(6, 8))
    for size in range(len(data)):
        with pytest.raises(BadData, match="RVL data are damaged"):
            decode_rvl(data[:size])


@pytest.mark.parametrize(
    ("numbers", "cause"),
    [
        ([0, 0, 0, 4, 2, 2, 2, 2], "a run of 0 pixels"),
        ([0, 5, 2, 2, 2, 2, 2], "a run of 5 pixels"),
        ([2**31, 0], "a run of"),
        ([0, 4, 2, 1, 2, 2], "outside of 1 to 65535"),
        ([0, 4, 2, 3, 8, 2], "outside of 1 to 65535"),
        ([0, 4, 131072, 2, 2, 2], "outside of 1 to 65535"),
        ([0, 4, 2**40, 2, 2, 2], "more than 32 bits"),
        ([0, 4, 2, 4096], "end at pixel 2 of 4"),
    ],
)
def test_numbers_that_fit_no_image_of_four_pixels(numbers: list[int], cause: str) -> None:
    with pytest.raises(BadData, match=cause):
        decode_rvl(struct.pack("<II", 2, 2) + words_of(numbers))


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (65536, 65536)])
def test_sizes_of_no_image(size: tuple[int, int]) -> None:
    with pytest.raises(BadData, match="pixels"):
        decode_rvl(struct.pack("<II", *size) + bytes(64))


@given(st.integers(0, 2**32 - 1), st.integers(0, 23))
def test_damage_is_an_error_or_an_image_of_the_same_size(word: int, place: int) -> None:
    data = bytearray(encode_rvl(scene(6, 8)))
    at = 8 + 4 * (place % ((len(data) - 8) // 4))
    data[at : at + 4] = struct.pack("<I", word)
    with contextlib.suppress(BadData):
        assert decode_rvl(bytes(data)).shape == (6, 8)
