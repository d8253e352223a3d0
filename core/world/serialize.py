"""A world as bytes, 55 per plane, and its transform to another frame.

Coordinates are integer centimetres, ends relative to the middle of the plane; moments are float32 about it. Rounding
makes no plane lower than it was. A plane whose numbers do not fit is refused, never changed. Each part of a file has its
length and a checksum, so that the complete parts of a damaged file are read, and the place of the damage is reported. Free
space is not saved: it may have changed meanwhile."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"OSAPE world 1\n"
_CM = 100.0
_FARTHEST_M, _MOST_LENGTH_M, _MOST_HEIGHT_M = 2e7, 655.0, 655.3
"""Greatest coordinate, length and height of a plane in a record, after rounding."""
MOST_MARGIN_M = 65.535
"""Greatest margin of a plane in a record."""
_MOST_PLANES = 4096
"""Planes per part of a file, which is the greatest number that is lost at a damaged place."""
_PART = struct.Struct("<4sII")
_SECTION = struct.Struct("<IIqq")
_PLACE = [
    ("x_cm", "<i4"),
    ("y_cm", "<i4"),
    ("ends_cm", "<i2", (4,)),
    ("top_cm", "<i4"),
    ("height_cm", "<u2"),
    ("margin_mm", "<u2"),
    ("flags", "u1"),
    ("hits", "<u2"),
    ("age_s", "<u4"),
]
ON_DISK = np.dtype([*_PLACE, ("moments", "<f4", (6,))])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SavedSection:
    """Planes of one section, in ned."""

    number: int  # of the section
    reset_counter: int  # of the position estimate
    begun_ns: int  # first frame
    newest_ns: int  # newest frame
    box: NDArray[np.float64]  # (N, 6)
    moments: NDArray[np.float64]  # (N, 6), about the middle of each plane
    margin_m: NDArray[np.float64]  # (N,)
    flags: NDArray[np.uint8]  # (N,)
    hits: NDArray[np.int32]  # (N,)
    age_s: NDArray[np.float64]  # (N,), time since the last observation, at newest_ns


def unfit_planes(box: Any, margin_m: Any) -> dict[int, str]:
    """Returns why a plane does not fit in a record, as text, by its index. box: (N, 6) m; margin_m: (N,)."""
    box, margin = np.asarray(box, np.float64).reshape(-1, 6), np.asarray(margin_m, np.float64)
    numbers = np.column_stack([box, margin])
    height = box[:, 5] - box[:, 4]
    length = np.maximum(np.abs(box[:, 2] - box[:, 0]), np.abs(box[:, 3] - box[:, 1]))
    causes: dict[int, str] = {}
    for bad, cause in (
        (~np.isfinite(numbers).all(axis=1), "a number that is not finite"),
        (~(np.abs(box) <= _FARTHEST_M).all(axis=1), f"a coordinate beyond {_FARTHEST_M:g} m"),
        (~(length <= _MOST_LENGTH_M), f"more than {_MOST_LENGTH_M:g} m along x or y"),
        (~(height <= _MOST_HEIGHT_M), f"a height of more than {_MOST_HEIGHT_M:g} m"),
        (~(height >= 0.0), "a lower edge above its upper edge"),
        (~((margin >= 0.0) & (margin <= MOST_MARGIN_M)), f"a margin outside of 0..{MOST_MARGIN_M:g} m"),
    ):
        for k in np.flatnonzero(bad):
            causes.setdefault(int(k), cause)
    return causes


def packed(kind: np.dtype[Any], box: Any, margin_m: Any, flags: Any, hits: Any, age_s: Any) -> NDArray[np.void]:
    """Returns (N,) records of a dtype, filled except for slot or moments.

    Raises:
        ValueError: a plane does not fit; see `unfit_planes`."""
    for k, cause in unfit_planes(box, margin_m).items():
        raise ValueError(f"plane {k} of {len(box)} does not fit in a record: {cause}")
    out = np.zeros(len(box), kind)
    box = box.astype(np.float64)
    x, y = np.rint(50.0 * (box[:, 0] + box[:, 2])), np.rint(50.0 * (box[:, 1] + box[:, 3]))
    out["x_cm"], out["y_cm"] = x, y
    ends = np.rint(_CM * box[:, :4]) - np.column_stack([x, y, x, y])
    out["ends_cm"] = ends
    top, bottom = np.floor(_CM * box[:, 4] + 1e-3), np.ceil(_CM * box[:, 5] - 1e-3)
    out["top_cm"], out["height_cm"] = top, np.maximum(bottom - top, 1)
    out["margin_mm"] = np.maximum(np.ceil(1000.0 * margin_m.astype(np.float64) - 1e-3), 0)
    out["flags"], out["hits"] = flags, np.clip(hits, 1, 65535)
    out["age_s"] = np.clip(np.nan_to_num(age_s, nan=0.0), 0, 4294967295)
    return out


def box_of_records(records: NDArray[np.void]) -> NDArray[np.float64]:
    """Returns the boxes of records, (N, 6) in metres."""
    x, y = records["x_cm"].astype(np.float64), records["y_cm"].astype(np.float64)
    top = records["top_cm"].astype(np.float64)
    ends = records["ends_cm"] + np.column_stack([x, y, x, y])
    return np.column_stack([ends, top, top + records["height_cm"]]) / _CM


def fitting(section: SavedSection) -> tuple[SavedSection, dict[int, str]]:
    """Returns the planes of a section that fit in a file, and why the other ones do not, as text, by their index."""
    causes = unfit_planes(section.box, section.margin_m)
    with np.errstate(over="ignore"):
        moments = section.moments.astype(np.float32)
    for k in np.flatnonzero(~(np.isfinite(moments).all(axis=1) & (moments[:, 0] > 0.0))):
        causes.setdefault(int(k), "moments that no file can hold")
    if not causes:
        return section, causes
    fits = np.ones(len(section.box), bool)
    fits[list(causes)] = False
    arrays = {name: getattr(section, name)[fits] for name in ("box", "moments", "margin_m", "flags", "hits", "age_s")}
    return replace(section, **arrays), causes


def bytes_of(sections: tuple[SavedSection, ...]) -> bytes:
    """Returns the content of the file of a world.

    Raises:
        ValueError: a plane does not fit; `fitting` leaves such planes out."""
    out = [MAGIC]
    for s in sections:
        for k, cause in fitting(s)[1].items():
            raise ValueError(f"section {s.number}: plane {k} of {len(s.box)} does not fit in a file: {cause}")
        head = _SECTION.pack(s.number, s.reset_counter & 0xFFFFFFFF, s.begun_ns, s.newest_ns)
        out.append(_part(b"SECT", head))
        records = packed(ON_DISK, s.box, s.margin_m, s.flags, s.hits, s.age_s)
        records["moments"] = s.moments
        for begin in range(0, len(records), _MOST_PLANES):
            out.append(_part(b"PLAN", records[begin : begin + _MOST_PLANES].tobytes()))
    out.append(_part(b"END ", b""))
    return b"".join(out)


def sections_of(data: bytes) -> tuple[tuple[SavedSection, ...], str]:
    """Returns the complete sections of a file, and where it is damaged, as text; empty: it is not.

    Raises:
        ValueError: the content is not a saved world."""
    if not data.startswith(MAGIC):
        raise ValueError(f"no saved world: it begins with {data[: len(MAGIC)]!r}, expected {MAGIC!r}")
    heads: list[tuple[int, int, int, int]] = []
    parts: list[list[NDArray[np.void]]] = []
    at, fault, done = len(MAGIC), "", False
    while not done and not fault:
        tag, payload, after, fault = _read_part(data, at)
        if fault:
            break
        if tag == b"SECT" and len(payload) == _SECTION.size:
            heads.append(_SECTION.unpack(payload))
            parts.append([])
        elif tag == b"PLAN" and heads and len(payload) % ON_DISK.itemsize == 0:
            records = np.frombuffer(payload, ON_DISK)
            fault = _impossible(records, at)
            parts[-1].append(records[:0] if fault else records)
        elif tag == b"END ":
            done = True
        else:
            fault = f"byte {at}: a part {tag!r} of {len(payload)} bytes that does not belong there"
        at = after
    if done and at != len(data):
        fault = f"byte {at}: {len(data) - at} bytes after its end"
    return tuple(_section(h, p) for h, p in zip(heads, parts, strict=True)), fault


def _part(tag: bytes, payload: bytes) -> bytes:
    return _PART.pack(tag, len(payload), zlib.crc32(tag + payload)) + payload


def _read_part(data: bytes, at: int) -> tuple[bytes, bytes, int, str]:
    """Returns (tag, payload, position after the part, fault)."""
    if at + _PART.size > len(data):
        return b"", b"", at, f"byte {at}: it is cut in the head of a part"
    tag, length, checksum = _PART.unpack_from(data, at)
    begin = at + _PART.size
    if begin + length > len(data):
        return b"", b"", at, f"byte {at}: it is cut in a part of {length} bytes, of which {len(data) - begin} are there"
    payload = data[begin : begin + length]
    if zlib.crc32(tag + payload) != checksum:
        return b"", b"", at, f"byte {at}: a part of {length} bytes is damaged"
    return tag, payload, begin + length, ""


def _impossible(records: NDArray[np.void], at: int) -> str:
    """Returns which plane of a part cannot be, as text; empty: none. at: position of the part."""
    moments = records["moments"]
    possible = np.isfinite(moments).all(axis=1) & (moments[:, 0] > 0.0) & (records["height_cm"] > 0)
    if possible.all():
        return ""
    return f"byte {at}: plane {int(np.argmin(possible))} of this part has no height, or moments that cannot be"


def _section(head: tuple[int, int, int, int], parts: list[NDArray[np.void]]) -> SavedSection:
    records = np.concatenate([np.zeros(0, ON_DISK), *parts])
    number, reset_counter, begun_ns, newest_ns = head
    return SavedSection(
        number=number,
        reset_counter=reset_counter,
        begun_ns=begun_ns,
        newest_ns=newest_ns,
        box=box_of_records(records),
        moments=records["moments"].astype(np.float64),
        margin_m=records["margin_mm"] / 1000.0,
        flags=records["flags"],
        hits=records["hits"].astype(np.int32),
        age_s=records["age_s"].astype(np.float64),
    )


def moved(section: SavedSection, yaw_rad: float, translation_m: tuple[float, float, float]) -> SavedSection:
    """Returns the section in another frame: p' = Rz(yaw) p + translation.

    Raises:
        ValueError: an argument is not finite."""
    if not all(math.isfinite(v) for v in (yaw_rad, *translation_m)):
        raise ValueError(f"a world cannot be moved by {yaw_rad} rad and {translation_m}: not finite")
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    tx, ty, tz = translation_m
    b, m = section.box, section.moments
    box = np.column_stack(
        [
            c * b[:, 0] - s * b[:, 1] + tx,
            s * b[:, 0] + c * b[:, 1] + ty,
            c * b[:, 2] - s * b[:, 3] + tx,
            s * b[:, 2] + c * b[:, 3] + ty,
            b[:, 4] + tz,
            b[:, 5] + tz,
        ]
    )
    xx, xy, yy = m[:, 3], m[:, 4], m[:, 5]
    moments = np.column_stack(
        [
            m[:, 0],
            c * m[:, 1] - s * m[:, 2],
            s * m[:, 1] + c * m[:, 2],
            c * c * xx - 2 * c * s * xy + s * s * yy,
            c * s * (xx - yy) + (c * c - s * s) * xy,
            s * s * xx + 2 * c * s * xy + c * c * yy,
        ]
    )
    return replace(section, box=box, moments=moments)
