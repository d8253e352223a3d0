"""A plane in 14 bytes. The layout is in docs/reference/sharing.md.

Rounding never makes an obstacle smaller: the decoded plane with its margin contains the encoded one with its margin."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..types import PlaneFlags
from .records import PacketError, SharedPlanes
from .steps import AGES_S, HEIGHT_M, MARGIN_M, age_code

PLANE_BYTES: Final = 14
STEP_M: Final = 0.02
"""Step of horizontal coordinates."""
PLACE_ERROR_M: Final = STEP_M * math.sqrt(0.5)
"""Greatest distance of a decoded end from the encoded one; the margin contains it."""
TOP_STEP_M: Final = 0.1
_XY_BITS, _TOP_BITS = 15, 12
_XY_LIMIT, _TOP_LIMIT = 1 << (_XY_BITS - 1), 1 << (_TOP_BITS - 1)
_WIDTHS: Final = (16, _XY_BITS, _XY_BITS, _XY_BITS, _XY_BITS, _TOP_BITS, 10, 6, 4, 4)
_TINY: Final = 1e-9
_FLAG_BITS: Final = (PlaneFlags.INFERRED, PlaneFlags.UNKNOWN_BEHIND, PlaneFlags.CUT_LEFT, PlaneFlags.IRREGULAR)
Anchor = tuple[float, float, float]


def fits(box: tuple[float, ...], margin_m: float, anchor_m: Anchor) -> bool:
    """True if a plane can be encoded with this anchor."""
    return _codes(box, margin_m, anchor_m) is not None


def encoded_plane(planes: SharedPlanes, row: int, anchor_m: Anchor) -> bytes:
    """Returns the encoded plane. Raises PacketError if it does not fit."""
    box = tuple(planes.box[row].tolist())
    codes = _codes(box, float(planes.margin_m[row]), anchor_m)
    if codes is None:
        raise PacketError(
            "plane_unencodable", f"a plane {box} with margin {planes.margin_m[row]:g} m does not fit to {anchor_m}"
        )
    flags = sum(1 << k for k, flag in enumerate(_FLAG_BITS) if _has(int(planes.flags[row]), flag))
    values = (int(planes.ids[row]), *codes, flags, age_code(float(planes.age_s[row])))
    number = 0
    for value, width in zip(values, _WIDTHS, strict=True):
        number = number << width | (value & ((1 << width) - 1))
    return number.to_bytes(PLANE_BYTES, "big")


def decoded_planes(data: bytes, anchor_m: Anchor) -> SharedPlanes:
    """Returns the planes of consecutive records.

    Raises:
        PacketError: the length is not a multiple of PLANE_BYTES, or a plane has no length or height."""
    count, rest = divmod(len(data), PLANE_BYTES)
    if rest:
        raise PacketError("bad_length", f"{len(data)} bytes of planes are no multiple of {PLANE_BYTES}")
    ids, flags = np.zeros(count, np.uint16), np.zeros(count, np.uint8)
    box, margin_m, age_s = np.zeros((count, 6)), np.zeros(count), np.zeros(count)
    for k in range(count):
        number = int.from_bytes(data[k * PLANE_BYTES : (k + 1) * PLANE_BYTES], "big")
        values = []
        for width in reversed(_WIDTHS):
            values.append(number & ((1 << width) - 1))
            number >>= width
        age, flag_bits, margin, height, top, *ends, ids[k] = values
        places = [STEP_M * _signed(end, _XY_BITS) for end in reversed(ends)]
        top_m = anchor_m[2] + TOP_STEP_M * _signed(top, _TOP_BITS)
        box[k] = *(p + anchor_m[i % 2] for i, p in enumerate(places)), top_m, top_m + HEIGHT_M.value(height)
        if places[:2] == places[2:] or height == 0:
            raise PacketError("plane_without_size", f"plane {ids[k]} has no length or no height")
        margin_m[k], age_s[k] = MARGIN_M.value(margin), AGES_S[age]
        flags[k] = sum(int(flag) for i, flag in enumerate(_FLAG_BITS) if flag_bits >> i & 1)
    return SharedPlanes(ids=ids, box=box, margin_m=margin_m, flags=flags, age_s=age_s)


def _codes(box: tuple[float, ...], margin_m: float, anchor_m: Anchor) -> tuple[int, ...] | None:
    """Returns the codes of both ends, top, height and margin; None if one is out of range, or the plane has no size."""
    if not all(map(math.isfinite, (*box, margin_m))) or margin_m < 0.0:
        return None
    ends = [round((v - anchor_m[k % 2]) / STEP_M) for k, v in enumerate(box[:4])]
    top = math.floor((box[4] - anchor_m[2]) / TOP_STEP_M + _TINY)
    height = HEIGHT_M.code_up(box[5] - (anchor_m[2] + TOP_STEP_M * top))
    margin = MARGIN_M.code_up(margin_m + PLACE_ERROR_M)
    within = all(-_XY_LIMIT <= end < _XY_LIMIT for end in ends) and -_TOP_LIMIT <= top < _TOP_LIMIT
    if not within or ends[:2] == ends[2:] or not 0 < height < HEIGHT_M.codes or margin >= MARGIN_M.codes:
        return None
    return (*ends, top, height, margin)


def _has(flags: int, flag: PlaneFlags) -> bool:
    wanted = PlaneFlags.CUT_LEFT | PlaneFlags.CUT_RIGHT if flag is PlaneFlags.CUT_LEFT else flag
    return bool(flags & wanted)


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value
