"""Packets as bytes, 128 at most for a TUNNEL message of MAVLink. The layout is in docs/research/packets.md."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Final, TypeVar

from .plane_codec import LONG, SHORT, Anchor, PlaneForm, decoded_planes, encoded_plane, fits
from .records import (
    MOVER_IDS,
    Header,
    LocalFrame,
    Motion,
    Packet,
    PacketError,
    SharedMover,
    SharedPlanes,
    VehicleState,
)

T = TypeVar("T")
VERSION: Final = 2
STATE_KIND, LONG_PLANES_KIND, MOVERS_KIND, SHORT_PLANES_KIND = 1, 2, 3, 4
MOTION_FLAG: Final = 8
"""Of the kind: the motion of the sender follows the anchor."""
TUNNEL_BYTES: Final = 128
"""Greatest payload of a TUNNEL message."""
ANCHOR_STEP_M: Final = 64.0
ANCHOR_STEP_Z_M: Final = 16.0
_HEADER: Final = struct.Struct("<BBIIB")
_ANCHOR: Final = struct.Struct("<hhb")
_STATE: Final = struct.Struct("<iiihHHHiihhhhB")
_MOVER: Final = struct.Struct("<Hhhh3B2b3B")
_MOTION: Final = struct.Struct("<hhh3b")
MOTION_BYTES: Final = _MOTION.size
STATE_BYTES: Final = _HEADER.size + _STATE.size
"""Of a whole packet."""
MOVERS_PER_TUNNEL: Final = (TUNNEL_BYTES - _HEADER.size - _ANCHOR.size) // _MOVER.size
OVERHEAD_BYTES: Final = _HEADER.size + _ANCHOR.size
MOST_BYTES: Final = 4096
_MOVER_STEP_M, _SIZE_STEP_M, _SPEED_STEP_M_S = 0.02, 0.1, 0.25
_SIGMA_STEP_M, _SIGMA_STEP_M_S, _AGE_STEP_S = 0.05, 0.1, 0.05
_TINY = 1e-9


def anchor_of(x_m: float, y_m: float, z_m: float) -> Anchor:
    """Returns the anchor nearest to a place. Raises PacketError for a place that is too far from the origin."""
    steps = (ANCHOR_STEP_M, ANCHOR_STEP_M, ANCHOR_STEP_Z_M)
    codes = [round(v / step) if math.isfinite(v) else 1 << 20 for v, step in zip((x_m, y_m, z_m), steps, strict=True)]
    if not all(abs(code) < limit for code, limit in zip(codes, (1 << 15, 1 << 15, 1 << 7), strict=True)):
        raise PacketError("too_far", f"({x_m:g}, {y_m:g}, {z_m:g}) m is too far from the origin of the frame")
    return ANCHOR_STEP_M * codes[0], ANCHOR_STEP_M * codes[1], ANCHOR_STEP_Z_M * codes[2]


def planes_packet(
    header: Header, planes: SharedPlanes, anchor_m: Anchor, form: PlaneForm = LONG, motion: Motion | None = None
) -> bytes:
    """Returns a packet of planes with one anchor, and the motion of the sender. No planes: of its motion alone.

    Raises:
        PacketError: something does not fit."""
    parts = [encoded_plane(form, planes, row, anchor_m) for row in range(len(planes))]
    kind = SHORT_PLANES_KIND if form is SHORT else LONG_PLANES_KIND
    if motion is None:
        return _head(header, kind) + _anchor(anchor_m) + b"".join(parts)
    return _head(header, kind | MOTION_FLAG) + _anchor(anchor_m) + _motion(motion, anchor_m) + b"".join(parts)


def movers_packet(header: Header, movers: tuple[SharedMover, ...], anchor_m: Anchor) -> bytes:
    """Returns a packet of moving obstacles with one anchor. Raises PacketError if one does not fit."""
    return _head(header, MOVERS_KIND) + _anchor(anchor_m) + b"".join(_mover(m, anchor_m) for m in movers)


def state_packet(header: Header, state: VehicleState) -> bytes:
    """Returns a packet with the sender's frame and place. Raises PacketError for values out of range."""
    f = state.frame
    try:
        body = _STATE.pack(
            round(f.latitude_deg * 1e7),
            round(f.longitude_deg * 1e7),
            round(f.altitude_m * 1e3),
            round(math.remainder(f.yaw_rad, math.tau) * 1e4),
            _up(f.sigma_m, 0.01),
            _up(f.sigma_z_m, 0.01),
            _up(f.sigma_yaw_rad, 1e-4),
            round(state.position_m[0] * 1e2),
            round(state.position_m[1] * 1e2),
            round(state.position_m[2] * 1e1),
            *(round(v * 1e2) for v in state.velocity_m_s),
            _up(state.radius_m, 0.1),
        )
    except (struct.error, ValueError, OverflowError) as error:
        raise PacketError("state_unencodable", f"the state of the vehicle is out of range: {error}") from error
    return _head(header, STATE_KIND) + body


def decoded(data: bytes) -> Packet:
    """Returns the decoded packet.

    Raises:
        PacketError: another version, a wrong length, or values out of range."""
    if len(data) < _HEADER.size or len(data) > MOST_BYTES:
        raise PacketError("bad_length", f"a packet of {len(data)} bytes")
    first, vehicle, stream, sent_ms, section = _HEADER.unpack_from(data)
    if first >> 4 != VERSION:
        raise PacketError("other_version", f"packet version {first >> 4}, expected {VERSION}")
    if vehicle == 0:
        raise PacketError("bad_vehicle", "a packet without the number of its vehicle")
    header, kind = Header(vehicle=vehicle, stream=stream, sent_ms=sent_ms, section=section), first & 15
    if kind == STATE_KIND:
        return Packet(header, _state_from(data[_HEADER.size :]))
    if kind & ~MOTION_FLAG not in (LONG_PLANES_KIND, MOVERS_KIND, SHORT_PLANES_KIND) or len(data) <= OVERHEAD_BYTES:
        raise PacketError("bad_kind", f"packet kind {kind} with {len(data)} bytes")
    x, y, z = _ANCHOR.unpack_from(data, _HEADER.size)
    anchor_m = ANCHOR_STEP_M * x, ANCHOR_STEP_M * y, ANCHOR_STEP_Z_M * z
    body = data[OVERHEAD_BYTES:]
    motion = None
    if kind & MOTION_FLAG:
        if len(body) < MOTION_BYTES:
            raise PacketError("bad_length", f"a packet with motion of {len(data)} bytes")
        motion, body = _motion_from(body[:MOTION_BYTES], anchor_m), body[MOTION_BYTES:]
    if kind & ~MOTION_FLAG == MOVERS_KIND:
        return Packet(header, _movers_from(body, anchor_m), motion)
    form = SHORT if kind & ~MOTION_FLAG == SHORT_PLANES_KIND else LONG
    return Packet(header, decoded_planes(form, body, anchor_m), motion)


def mover_fits(mover: SharedMover, anchor_m: Anchor) -> bool:
    """True if a moving obstacle can be sent with this anchor."""
    return _fits(_mover, mover, anchor_m)


def plane_fits(form: PlaneForm, planes: SharedPlanes, row: int, anchor_m: Anchor) -> bool:
    """True if a plane can be sent in this form with this anchor."""
    return fits(form, tuple(planes.box[row].tolist()), float(planes.margin_m[row]), anchor_m)


def motion_fits(motion: Motion, anchor_m: Anchor) -> bool:
    """True if a motion can be sent with this anchor."""
    return _fits(_motion, motion, anchor_m)


def _fits(encode: Callable[[T, Anchor], bytes], content: T, anchor_m: Anchor) -> bool:
    try:
        encode(content, anchor_m)
    except PacketError:
        return False
    return True


def _head(header: Header, kind: int) -> bytes:
    return _HEADER.pack(VERSION << 4 | kind, header.vehicle, header.stream, header.sent_ms, header.section)


def _anchor(anchor_m: Anchor) -> bytes:
    x, y, z = anchor_m
    return _ANCHOR.pack(round(x / ANCHOR_STEP_M), round(y / ANCHOR_STEP_M), round(z / ANCHOR_STEP_Z_M))


def _motion(motion: Motion, anchor_m: Anchor) -> bytes:
    """Returns MOTION_BYTES."""
    try:
        return _MOTION.pack(
            *(round((p - a) / _MOVER_STEP_M) for p, a in zip(motion.position_m, anchor_m, strict=True)),
            *(round(v / _SPEED_STEP_M_S) for v in motion.velocity_m_s),
        )
    except (struct.error, OverflowError, ValueError) as error:
        raise PacketError("motion_unencodable", f"the motion of the vehicle is out of range: {error}") from error


def _motion_from(data: bytes, anchor_m: Anchor) -> Motion:
    x, y, z, vx, vy, vz = _MOTION.unpack(data)
    ax, ay, az = anchor_m
    return Motion(
        position_m=(ax + _MOVER_STEP_M * x, ay + _MOVER_STEP_M * y, az + _MOVER_STEP_M * z),
        velocity_m_s=(_SPEED_STEP_M_S * vx, _SPEED_STEP_M_S * vy, _SPEED_STEP_M_S * vz),
    )


def _up(value: float, step: float) -> int:
    return math.ceil(value / step - _TINY)


def _mover(m: SharedMover, anchor_m: Anchor) -> bytes:
    """Returns 16 bytes. Sizes, deviations and the age are rounded up; the size contains the error of the centre."""
    try:
        places = [round((c - a) / _MOVER_STEP_M) for c, a in zip(m.centre_m, anchor_m, strict=True)]
        sizes = [_up(s + 0.5 * _MOVER_STEP_M, _SIZE_STEP_M) for s in m.half_size_m]
        speeds = [round(v / _SPEED_STEP_M_S) for v in m.velocity_m_s]
        sigma_m_s = _up(m.sigma_m_s + 0.5 * _SPEED_STEP_M_S, _SIGMA_STEP_M_S)
        number = m.id % MOVER_IDS + MOVER_IDS * m.partial
        return _MOVER.pack(
            number, *places, *sizes, *speeds, _up(m.sigma_m, _SIGMA_STEP_M), sigma_m_s, _up(m.age_s, _AGE_STEP_S)
        )
    except (struct.error, OverflowError, ValueError) as error:
        raise PacketError("mover_unencodable", f"moving obstacle {m.id} is out of range: {error}") from error


def _movers_from(body: bytes, anchor_m: Anchor) -> tuple[SharedMover, ...]:
    if len(body) % _MOVER.size:
        raise PacketError("bad_length", f"{len(body)} bytes of moving obstacles are no multiple of {_MOVER.size}")
    found = []
    for number, x, y, z, hx, hy, hz, vx, vy, sigma, speed_sigma, age in _MOVER.iter_unpack(body):
        centre_m = tuple(a + _MOVER_STEP_M * v for a, v in zip(anchor_m, (x, y, z), strict=True))
        found.append(
            SharedMover(
                id=number % MOVER_IDS,
                centre_m=(centre_m[0], centre_m[1], centre_m[2]),
                half_size_m=(_SIZE_STEP_M * hx, _SIZE_STEP_M * hy, _SIZE_STEP_M * hz),
                velocity_m_s=(_SPEED_STEP_M_S * vx, _SPEED_STEP_M_S * vy),
                sigma_m=_SIGMA_STEP_M * sigma,
                sigma_m_s=_SIGMA_STEP_M_S * speed_sigma,
                age_s=_AGE_STEP_S * age,
                partial=number >= MOVER_IDS,
            )
        )
    return tuple(found)


def _state_from(body: bytes) -> VehicleState:
    if len(body) != _STATE.size:
        raise PacketError("bad_length", f"a state of {len(body)} bytes, expected {_STATE.size}")
    lat, lon, alt, yaw, sigma, sigma_z, sigma_yaw, x, y, z, vx, vy, vz, radius = _STATE.unpack(body)
    if abs(lat) > 900_000_000 or abs(lon) > 1_800_000_000:
        raise PacketError("bad_place", f"latitude {lat / 1e7:g}, longitude {lon / 1e7:g} are no place on Earth")
    frame = LocalFrame(
        latitude_deg=lat / 1e7,
        longitude_deg=lon / 1e7,
        altitude_m=alt / 1e3,
        yaw_rad=yaw / 1e4,
        sigma_m=sigma / 1e2,
        sigma_z_m=sigma_z / 1e2,
        sigma_yaw_rad=sigma_yaw / 1e4,
    )
    return VehicleState(
        frame=frame,
        position_m=(x / 1e2, y / 1e2, z / 1e1),
        velocity_m_s=(vx / 1e2, vy / 1e2, vz / 1e2),
        radius_m=radius / 10,
    )
