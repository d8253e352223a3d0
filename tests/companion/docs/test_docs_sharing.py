"""docs/research/packets.md states sizes and ranges of the packets that are sent, docs/reference/sharing.md limits and codes."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from companion.share.output import MOST_LOGGED_PER_S
from companion.share.packet_rate import ALL_PER_S, PACKETS_PER_S
from core.sharing.packet_codec import (
    MOTION_BYTES,
    OVERHEAD_BYTES,
    TUNNEL_BYTES,
    movers_packet,
    planes_packet,
    state_packet,
)
from core.sharing.plane_codec import LONG, SHORT
from core.sharing.records import Header, LocalFrame, SharedMover, SharedPlanes, VehicleState
from drivers.sharing.tunnel import FRAME_BYTES, LINK_ID, PAYLOAD_TYPE, SIGNATURE_BYTES, TUNNEL_ID
from drivers.sharing.zenoh_link import PACKET_BYTES

DOCS: Final = Path(__file__).resolve().parents[3] / "docs"
LAYOUT: Final = (DOCS / "research" / "packets.md").read_text(encoding="utf-8")
CODES: Final = (DOCS / "reference" / "sharing.md").read_text(encoding="utf-8")
HEADER: Final = Header(vehicle=7, stream=1_700_000_000, sent_ms=123_456, section=3)
ANCHOR: Final = (0.0, 0.0, 0.0)
NONE: Final = SharedPlanes(
    ids=np.zeros(0, np.uint16),
    box=np.zeros((0, 6)),
    margin_m=np.zeros(0),
    flags=np.zeros(0, np.uint8),
    age_s=np.zeros(0),
)
STATE: Final = VehicleState(
    frame=LocalFrame(
        latitude_deg=47.0,
        longitude_deg=8.0,
        altitude_m=400.0,
        yaw_rad=0.1,
        sigma_m=1.0,
        sigma_z_m=2.0,
        sigma_yaw_rad=0.01,
    ),
    position_m=(1.0, 2.0, -3.0),
    velocity_m_s=(0.1, 0.2, 0.3),
    radius_m=0.5,
)
MOVER: Final = SharedMover(
    id=1,
    centre_m=(1.0, 2.0, -1.0),
    half_size_m=(0.3, 0.3, 0.9),
    velocity_m_s=(1.0, 0.0),
    sigma_m=0.1,
    sigma_m_s=0.2,
    age_s=0.1,
)


def section(title: str) -> str:
    """Heading and text of the section of the layout whose heading begins with `title`."""
    return next(part for part in LAYOUT.split("\n## ")[1:] if part.startswith(title))


def table_bytes(text: str) -> int:
    """Size of what the tables of a section list by their type, such as `2 x int32`."""
    types = re.findall(r"^\|(?:[^|]*\|)?? *(?:(\d+) x )?u?int(8|16|32) \|", text, re.MULTILINE)
    return sum(int(count or 1) * int(bits) // 8 for count, bits in types)


def test_the_header_has_the_stated_size() -> None:
    header = len(planes_packet(HEADER, NONE, ANCHOR)) - 5
    text = section("Header")
    assert text.startswith(f"Header of each packet, {header} bytes")
    assert table_bytes(text) == header
    places = [int(at) for at in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)]
    sizes = [int(bits) // 8 for bits in re.findall(r"\| u?int(\d+) \|", text)]
    assert [b - a for a, b in pairwise([*places, header])] == sizes


def test_the_state_has_the_stated_size() -> None:
    text, whole = section("State"), len(state_packet(HEADER, STATE))
    header = OVERHEAD_BYTES - 5
    assert table_bytes(text) == whole - header
    assert text.startswith(f"State, {whole - header} bytes more ({whole} in all)")


def test_anchor_motion_and_moving_obstacles_have_the_stated_sizes() -> None:
    assert section("Anchor and motion").startswith(f"Anchor and motion, 5 bytes and {MOTION_BYTES}")
    assert table_bytes(section("Anchor and motion")) == MOTION_BYTES
    mover = len(movers_packet(HEADER, (MOVER,), ANCHOR)) - OVERHEAD_BYTES
    assert section("Moving obstacles").startswith(f"Moving obstacles, 5 bytes and {mover} for each")
    assert table_bytes(section("Moving obstacles")) == mover


def test_planes_have_the_stated_sizes() -> None:
    text = section("Planes")
    assert text.startswith(f"Planes, {SHORT.bytes} or {LONG.bytes} bytes for each plane")
    room = TUNNEL_BYTES - OVERHEAD_BYTES
    assert f"holds {room // SHORT.bytes} short planes, or {room // LONG.bytes} long ones" in text
    rows = [line.split("|")[1:-1] for line in text.splitlines() if re.match(r"\| (\d|2 x)", line)]
    for column, form in ((0, SHORT), (2, LONG)):
        bits = [re.match(r" (?:(\d) x )?(\d+)", row[column]) for row in rows]
        assert sum(int(m[1] or 1) * int(m[2]) for m in bits if m) == 8 * form.bytes


def test_planes_have_the_stated_ranges() -> None:
    rows = [line.split("|")[1:-1] for line in section("Planes").splitlines() if re.match(r"\| (\d|2 x)", line)]
    for column, form in ((1, SHORT), (3, LONG)):
        first, second, height, margin, ages = (rows[k][column].strip() for k in (1, 2, 4, 5, 7))
        for stated, bits in ((first, form.first_bits), (second, form.second_bits)):
            step, limit = re.fullmatch(r"(\S+) cm, up to (\S+) m", stated).groups()
            assert float(step) / 100 == form.step_m
            assert float(limit) <= form.step_m * 2 ** (bits - 1) < float(limit) + 1
        for stated, steps in ((height, form.height), (margin, form.margin)):
            limits = steps.fine, steps.value(steps.fine_codes), steps.coarse, steps.value(steps.codes - 1)
            assert stated == "{:g} m up to {:g} m, {:g} m up to {:g} m".format(*limits)
        assert ages.startswith(", ".join(f"{age:g}" for age in form.ages_s[:4]))
        assert ages.endswith(f" {form.ages_s[-2]:g} s, longer")


def test_transports_have_the_stated_limits() -> None:
    text = section("TUNNEL")
    assert f"Message {TUNNEL_ID} of MAVLink 2 with `payload_type` {PAYLOAD_TYPE} (0x{PAYLOAD_TYPE:X}," in text
    assert f"Overhead: {FRAME_BYTES} bytes, {FRAME_BYTES + SIGNATURE_BYTES} with a signature" in text
    assert f"signs with link id {LINK_ID}" in text
    assert f"up to {PACKET_BYTES} bytes" in section("zenoh")
    assert f"more than {PACKETS_PER_S:g} packets per second of one sender on one link, or {ALL_PER_S:g} of all" in CODES
    assert f"beyond {MOST_LOGGED_PER_S} per second" in CODES


def test_every_code_by_which_a_packet_is_refused_is_documented() -> None:
    root = Path(__file__).resolve().parents[3]
    source = "\n".join(
        path.read_text(encoding="utf-8")
        for folder in ("core/sharing", "companion/share", "drivers/sharing")
        for path in sorted((root / folder).glob("*.py"))
    )
    refused = set(re.findall(r'(?:_refuse\(|refused\[)"(\w+)"', source)) | set(
        re.findall(r'PacketError\("(\w+)"', source)
    )
    sent_only = {"too_far", "state_unencodable", "motion_unencodable", "mover_unencodable"}
    documented = set(re.findall(r"`(\w+)`", CODES))
    assert refused - sent_only - documented == set()
