"""A plane in 11 bytes, or in 14 if it does not fit into them. The layout is in docs/research/packets.md.

Rounding never makes an obstacle smaller: the decoded plane with its margin contains the encoded one with its margin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..types import PlaneFlags
from .records import CUT, PacketError, SharedPlanes
from .steps import (
    LONG_AGES_S,
    LONG_HEIGHT_M,
    LONG_MARGIN_M,
    SHORT_AGES_S,
    SHORT_HEIGHT_M,
    SHORT_MARGIN_M,
    Steps,
    age_code,
)

TOP_STEP_M: Final = 0.1
_ID_BITS: Final = 16
_FLAG_BITS: Final = (PlaneFlags.INFERRED, PlaneFlags.UNKNOWN_BEHIND, PlaneFlags.CUT_LEFT, PlaneFlags.IRREGULAR)
_TINY: Final = 1e-9
Anchor = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class PlaneForm:
    """A layout."""

    bytes: int  # size of a plane
    step_m: float  # step of horizontal coordinates
    first_bits: int  # first_bits, second_bits: of each coordinate of the first end and of the second end
    second_bits: int
    relative: bool  # the second end is relative to the first one; otherwise to the anchor
    top_bits: int  # of the top, relative to the anchor
    height: Steps  # height, margin: steps of them
    margin: Steps
    ages_s: tuple[float, ...]  # classes of the age, a power of two

    @property
    def place_error_m(self) -> float:
        """Greatest distance of a decoded end from the encoded one; the margin contains it."""
        return self.step_m * math.sqrt(0.5)

    @property
    def widths(self) -> tuple[int, ...]:
        """Bits of the values of a plane in their order."""
        return (
            _ID_BITS,
            *(self.first_bits, self.first_bits, self.second_bits, self.second_bits, self.top_bits),
            *(_bits(self.height.codes), _bits(self.margin.codes), len(_FLAG_BITS), _bits(len(self.ages_s))),
        )


SHORT: Final = PlaneForm(11, 0.05, 12, 10, True, 9, SHORT_HEIGHT_M, SHORT_MARGIN_M, SHORT_AGES_S)
LONG: Final = PlaneForm(14, 0.02, 15, 15, False, 12, LONG_HEIGHT_M, LONG_MARGIN_M, LONG_AGES_S)


def fits(form: PlaneForm, box: tuple[float, ...], margin_m: float, anchor_m: Anchor) -> bool:
    """True if a plane can be encoded in this form with this anchor."""
    return _codes(form, box, margin_m, anchor_m) is not None


def encoded_plane(form: PlaneForm, planes: SharedPlanes, row: int, anchor_m: Anchor) -> bytes:
    """Returns the encoded plane. Raises PacketError if it does not fit."""
    box = tuple(planes.box[row].tolist())
    codes = _codes(form, box, float(planes.margin_m[row]), anchor_m)
    if codes is None:
        raise PacketError(
            "plane_unencodable", f"a plane {box} with margin {planes.margin_m[row]:g} m does not fit to {anchor_m}"
        )
    flags = sum(1 << k for k, flag in enumerate(_FLAG_BITS) if _has(int(planes.flags[row]), flag))
    values = (int(planes.ids[row]), *codes, flags, age_code(float(planes.age_s[row]), form.ages_s))
    number = 0
    for value, width in zip(values, form.widths, strict=True):
        number = number << width | (value & ((1 << width) - 1))
    return number.to_bytes(form.bytes, "big")


def decoded_planes(form: PlaneForm, data: bytes, anchor_m: Anchor) -> SharedPlanes:
    """Returns the decoded planes.

    Raises:
        PacketError: the length is not a multiple of the size of a plane, or a plane has no length or height."""
    count, rest = divmod(len(data), form.bytes)
    if rest:
        raise PacketError("bad_length", f"{len(data)} bytes of planes are no multiple of {form.bytes}")
    ids, flags = np.zeros(count, np.uint16), np.zeros(count, np.uint8)
    box, margin_m, age_s = np.zeros((count, 6)), np.zeros(count), np.zeros(count)
    for k in range(count):
        number = int.from_bytes(data[k * form.bytes : (k + 1) * form.bytes], "big")
        values = []
        for width in reversed(form.widths):
            values.append(number & ((1 << width) - 1))
            number >>= width
        age, flag_bits, margin, height, top, by, bx, ay, ax, ids[k] = values
        first = _signed(ax, form.first_bits), _signed(ay, form.first_bits)
        second = _signed(bx, form.second_bits), _signed(by, form.second_bits)
        if form.relative:
            second = first[0] + second[0], first[1] + second[1]
        top_m = anchor_m[2] + TOP_STEP_M * _signed(top, form.top_bits)
        ends = (form.step_m * code + anchor_m[i % 2] for i, code in enumerate((*first, *second)))
        box[k] = *ends, top_m, top_m + form.height.value(height)
        if first == second or height == 0:
            raise PacketError("plane_without_size", f"plane {ids[k]} has no length or no height")
        margin_m[k], age_s[k] = form.margin.value(margin), form.ages_s[age]
        flags[k] = sum(int(flag) for i, flag in enumerate(_FLAG_BITS) if flag_bits >> i & 1)
    return SharedPlanes(ids=ids, box=box, margin_m=margin_m, flags=flags, age_s=age_s)


def _codes(form: PlaneForm, box: tuple[float, ...], margin_m: float, anchor_m: Anchor) -> tuple[int, ...] | None:
    """Returns the codes of both ends, top, height and margin; None if one is out of range, or the plane has no size."""
    if not all(map(math.isfinite, (*box, margin_m))) or margin_m < 0.0:
        return None
    ends = [round((v - anchor_m[k % 2]) / form.step_m) for k, v in enumerate(box[:4])]
    first, second = ends[:2], ends[2:]
    if first == second:
        return None
    if form.relative:
        second = [second[0] - first[0], second[1] - first[1]]
    top = math.floor((box[4] - anchor_m[2]) / TOP_STEP_M + _TINY)
    height = form.height.code_up(box[5] - (anchor_m[2] + TOP_STEP_M * top))
    margin = form.margin.code_up(margin_m + form.place_error_m)
    limits = (form.first_bits, form.first_bits, form.second_bits, form.second_bits, form.top_bits)
    within = all(-(1 << (n - 1)) <= v < 1 << (n - 1) for v, n in zip((*first, *second, top), limits, strict=True))
    if not within or not 0 < height < form.height.codes or margin >= form.margin.codes:
        return None
    return (*first, *second, top, height, margin)


def _has(flags: int, flag: PlaneFlags) -> bool:
    return bool(flags & (CUT if flag is PlaneFlags.CUT_LEFT else flag))


def _bits(codes: int) -> int:
    return (codes - 1).bit_length()


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value
