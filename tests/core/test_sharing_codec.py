"""Packets between vehicles: what is decoded contains what was encoded, and damage is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.sharing.packet_codec import (
    MOTION_BYTES,
    MOVERS_PER_TUNNEL,
    OVERHEAD_BYTES,
    TUNNEL_BYTES,
    anchor_of,
    decoded,
    movers_packet,
    planes_packet,
    state_packet,
)
from core.sharing.plane_codec import LONG, SHORT, PlaneForm
from core.sharing.records import (
    CUT,
    MOVER_IDS,
    Header,
    LocalFrame,
    Motion,
    PacketError,
    SharedMover,
    SharedPlanes,
    VehicleState,
)
from core.types import PlaneFlags

from .neighbours import mover

HEADER = Header(vehicle=7, stream=1_700_000_000, sent_ms=123_456, section=3)


def planes(*rows: tuple[float, ...], margin_m: float = 0.1, flags: int = 0, age_s: float = 0.2) -> SharedPlanes:
    n = len(rows)
    return SharedPlanes(
        ids=np.arange(n, dtype=np.uint16),
        box=np.array(rows, np.float64).reshape(n, 6),
        margin_m=np.full(n, margin_m),
        flags=np.full(n, flags, np.uint8),
        age_s=np.full(n, age_s),
    )


def boxes(reach_m: float, size_m: float, top_m: float, height_m: float) -> st.SearchStrategy[tuple[float, ...]]:
    near, by = st.floats(-reach_m, reach_m), st.floats(-size_m, size_m)
    parts = st.tuples(near, near, by, by, st.floats(-top_m, top_m), st.floats(0.05, height_m))
    return parts.map(lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3], b[4], b[4] + b[5]))


def contained(form: PlaneForm, b: tuple[float, ...], margin_m: float, flags: int, age_s: float) -> None:
    if math.dist(b[:2], b[2:4]) < 2.5 * form.step_m:
        return
    sent = planes(b, margin_m=margin_m, flags=flags, age_s=age_s)
    data = planes_packet(HEADER, sent, (0.0, 0.0, 0.0), form)
    assert len(data) == OVERHEAD_BYTES + form.bytes
    packet = decoded(data)
    got = packet.content
    assert packet.header == HEADER
    assert isinstance(got, SharedPlanes)
    moved_m = max(math.dist(got.box[0, :2], b[:2]), math.dist(got.box[0, 2:4], b[2:4]))
    assert moved_m <= form.place_error_m + 1e-6
    assert got.margin_m[0] >= margin_m + moved_m - 1e-6
    step_m = 0.05 if margin_m + form.place_error_m < form.margin.fine * form.margin.fine_codes else 0.25
    assert got.margin_m[0] <= margin_m + form.place_error_m + step_m + 1e-6
    assert b[4] - 0.1 - 1e-6 <= got.box[0, 4] <= b[4] + 1e-6
    assert b[5] - 1e-6 <= got.box[0, 5] <= b[5] + 0.6 + 1e-6
    assert got.age_s[0] >= age_s


@given(boxes(160.0, 160.0, 150.0, 280.0), st.floats(0.0, 9.0), st.integers(0, 127), st.floats(0.0, 5000.0))
def test_a_decoded_plane_contains_the_encoded_one(
    b: tuple[float, ...], margin_m: float, flags: int, age_s: float
) -> None:
    contained(LONG, b, margin_m, flags, age_s)


@given(boxes(76.0, 25.5, 25.4, 36.0), st.floats(0.0, 4.4), st.integers(0, 127), st.floats(0.0, 5000.0))
def test_a_decoded_short_plane_contains_the_encoded_one(
    b: tuple[float, ...], margin_m: float, flags: int, age_s: float
) -> None:
    contained(SHORT, b, margin_m, flags, age_s)


@pytest.mark.parametrize("form", [LONG, SHORT])
@given(st.integers(0, 127))
def test_flags_of_a_plane(form: PlaneForm, flags: int) -> None:
    """One bit says that any of the four sides is cut."""
    got = decoded(planes_packet(HEADER, planes((0, 0, 4, 0, -3, 0), flags=flags), (0.0, 0.0, 0.0), form)).content
    assert isinstance(got, SharedPlanes)
    cut = PlaneFlags.CUT_LEFT if PlaneFlags(flags) & CUT else PlaneFlags(0)
    kept = PlaneFlags(flags) & (PlaneFlags.INFERRED | PlaneFlags.UNKNOWN_BEHIND | PlaneFlags.IRREGULAR)
    assert got.flags[0] == kept | cut


@pytest.mark.parametrize("form", [LONG, SHORT])
@pytest.mark.parametrize(
    ("row", "margin_m"),
    [
        ((0, 0, 400, 0, -3, 0), 0.1),  # longer than the range of one anchor
        ((0, 0, 4, 0, -3, 0), 9.5),
        ((0, 0, 4, 0, -400, 0), 0.1),
        ((0, 0, 0, 0, -3, 0), 0.1),  # no length
        ((0, 0, 4, 0, 0, -3), 0.1),  # top below bottom
        ((0, 0, math.nan, 0, -3, 0), 0.1),
        ((0, 0, 4, 0, -3, 0), math.inf),
        ((0, 0, 4, 0, -3, 0), -1.0),
    ],
)
def test_a_plane_that_would_be_made_smaller_is_refused(
    row: tuple[float, ...], margin_m: float, form: PlaneForm
) -> None:
    with pytest.raises(PacketError) as refused:
        planes_packet(HEADER, planes(row, margin_m=margin_m), (0.0, 0.0, 0.0), form)
    assert refused.value.code == "plane_unencodable"


@pytest.mark.parametrize(("form", "count"), [(SHORT, 10), (LONG, 8)])
def test_a_tunnel_message_holds_ten_short_planes_or_eight_long_ones(form: PlaneForm, count: int) -> None:
    far = [(5000.0 + k, -9000.0, 5020.0, -9000.0, -40.0, -34.0) for k in range(count)]
    data = planes_packet(HEADER, planes(*far), anchor_of(5000.0, -9000.0, -40.0), form)
    assert TUNNEL_BYTES - form.bytes < len(data) <= TUNNEL_BYTES
    assert sum(form.widths) == 8 * form.bytes
    got = decoded(data).content
    assert isinstance(got, SharedPlanes)
    assert np.abs(got.box - far).max() <= 0.11
    assert MOVERS_PER_TUNNEL == 7


@pytest.mark.parametrize("count", [0, 3])
def test_the_motion_of_the_sender_travels_with_planes_or_alone(count: int) -> None:
    motion = Motion(position_m=(1234.56, -77.0, -20.5), velocity_m_s=(3.1, -1.0, 0.5))
    rows = [(1200.0 + k, -70.0, 1205.0, -70.0, -22.0, -18.0) for k in range(count)]
    data = planes_packet(HEADER, planes(*rows), anchor_of(1200.0, -70.0, -22.0), SHORT, motion)
    assert len(data) == OVERHEAD_BYTES + MOTION_BYTES + count * SHORT.bytes
    packet = decoded(data)
    assert packet.motion is not None
    assert packet.motion.position_m == pytest.approx(motion.position_m, abs=0.011)
    assert packet.motion.velocity_m_s == pytest.approx(motion.velocity_m_s, abs=0.126)
    assert isinstance(packet.content, SharedPlanes)
    assert len(packet.content) == count


def test_a_motion_out_of_range_is_refused() -> None:
    with pytest.raises(PacketError):
        planes_packet(
            HEADER, planes(), (0.0, 0.0, 0.0), SHORT, Motion(position_m=(0, 0, 0), velocity_m_s=(40.0, 0.0, 0.0))
        )


coordinate = st.floats(-600.0, 600.0)


@given(
    st.tuples(coordinate, coordinate, coordinate),
    st.tuples(*[st.floats(0.0, 25.0)] * 3),
    st.tuples(*[st.floats(-31.0, 31.0)] * 2),
    st.floats(0.0, 12.0),
    st.floats(0.0, 25.0),
    st.floats(0.0, 12.0),
)
def test_a_decoded_mover_contains_the_encoded_one(
    centre: tuple[float, float, float],
    half: tuple[float, float, float],
    velocity: tuple[float, float],
    sigma: float,
    speed_sigma: float,
    age_s: float,
) -> None:
    sent = SharedMover(
        id=9,
        centre_m=centre,
        half_size_m=half,
        velocity_m_s=velocity,
        sigma_m=sigma,
        sigma_m_s=speed_sigma,
        age_s=age_s,
    )
    (got,) = movers_of(movers_packet(HEADER, (sent,), (0.0, 0.0, 0.0)))
    for c, h, d, e in zip(centre, half, got.centre_m, got.half_size_m, strict=True):
        assert d - e <= c - h + 1e-6
        assert d + e >= c + h - 1e-6
        assert e <= h + 0.12
    assert all(abs(a - b) <= 0.125 + 1e-9 for a, b in zip(velocity, got.velocity_m_s, strict=True))
    assert sigma - 1e-6 <= got.sigma_m <= sigma + 0.05 + 1e-6
    assert speed_sigma + 0.125 <= got.sigma_m_s + 1e-6
    assert age_s - 1e-6 <= got.age_s <= age_s + 0.05 + 1e-6


def test_a_state_survives() -> None:
    frame = LocalFrame(
        latitude_deg=47.3977419,
        longitude_deg=-8.5455938,
        altitude_m=488.0,
        yaw_rad=-0.31,
        sigma_m=1.5,
        sigma_z_m=2.0,
        sigma_yaw_rad=0.04,
    )
    sent = VehicleState(frame=frame, position_m=(1234.56, -77.0, -20.5), velocity_m_s=(3.0, -1.0, 0.5), radius_m=0.35)
    data = state_packet(HEADER, sent)
    got = decoded(data).content
    assert len(data) == 48
    assert isinstance(got, VehicleState)
    assert got.frame.latitude_deg == pytest.approx(frame.latitude_deg, abs=6e-8)
    assert got.frame.yaw_rad == pytest.approx(frame.yaw_rad, abs=1e-4)
    assert got.position_m == pytest.approx(sent.position_m, abs=0.06)
    assert got.velocity_m_s == pytest.approx(sent.velocity_m_s, abs=0.01)
    assert got.radius_m >= sent.radius_m


def movers_of(data: bytes) -> tuple[SharedMover, ...]:
    """The moving obstacles of a packet."""
    content = decoded(data).content
    assert isinstance(content, tuple)
    return content


@given(st.integers(0, 0xFFFF), st.booleans())
def test_a_mover_that_may_be_larger_keeps_its_number(number: int, partial: bool) -> None:
    data = movers_packet(HEADER, (replace(mover(3.0), id=number, partial=partial),), (0.0, 0.0, 0.0))
    (got,) = movers_of(data)
    assert (got.id, got.partial) == (number % MOVER_IDS, partial)


def test_packets_of_earlier_versions_are_decoded() -> None:
    """They have no mark of a moving obstacle, and that of planes at their ends only."""
    for packet in (
        "240700f1536540e2010003000000000000050140280a000f11e1b0",
        "220700f1536540e2010003000000000000050064019004b0064fe2078361",
    ):
        got = decoded(bytes.fromhex(packet)).content
        assert isinstance(got, SharedPlanes)
        assert got.box[0] == pytest.approx([1.0, 2.0, 3.0, 2.0, -3.0, 0.0])
        assert got.flags[0] == PlaneFlags.CUT_LEFT | PlaneFlags.UNKNOWN_BEHIND
    (got_mover,) = movers_of(bytes.fromhex("230700f1536540e2010003000000000009009600c8009cff0606060400020402"))
    assert (got_mover.id, got_mover.partial, got_mover.centre_m) == (9, False, pytest.approx((3.0, 4.0, -2.0)))


@given(st.binary(max_size=200))
def test_noise_is_refused_or_decoded_to_finite_numbers(data: bytes) -> None:
    _refused_or_finite(data)


@given(st.binary(min_size=1, max_size=130), st.sampled_from([0x21, 0x22, 0x23, 0x24, 0x2A, 0x2B, 0x2C]))
def test_noise_behind_a_true_first_byte(data: bytes, first: int) -> None:
    _refused_or_finite(bytes([first]) + data)


@given(st.integers(0, 10_000))
def test_a_truncated_packet_is_refused(cut: int) -> None:
    data = planes_packet(HEADER, planes((0, 0, 4, 0, -3, 0), (1, 1, 5, 2, -3, 0)), (0.0, 0.0, 0.0))
    length = cut % len(data)
    if length - OVERHEAD_BYTES == LONG.bytes:
        return  # a shorter packet of its own right; the transport checks the length
    with pytest.raises(PacketError):
        decoded(data[:length])


def _refused_or_finite(data: bytes) -> None:
    try:
        content = decoded(data).content
    except PacketError:
        return
    if isinstance(content, SharedPlanes):
        assert np.isfinite(content.box).all()
        assert np.isfinite(content.margin_m).all()
        assert (content.box[:, 5] > content.box[:, 4]).all()
    elif isinstance(content, VehicleState):
        assert abs(content.frame.latitude_deg) <= 90.0


@pytest.mark.parametrize("form", [LONG, SHORT])
def test_steps_round_up(form: PlaneForm) -> None:
    for steps in (form.margin, form.height):
        values = [steps.value(code) for code in range(steps.codes)]
        assert values == sorted(values)
        assert [steps.code_up(value) for value in values] == list(range(steps.codes))
        assert steps.code_up(steps.value(steps.codes - 1) + 0.01) >= steps.codes
    assert len(form.ages_s) in (8, 16)
    assert form.ages_s[-1] == math.inf


@pytest.mark.parametrize("fill", [0x01, 0x7F, 0xFF])
def test_any_kind_and_length_is_refused_or_decoded(fill: int) -> None:
    """Any other exception would end the thread that receives packets."""
    for first in range(256):
        for length in range(150):
            _refused_or_finite(bytes([first]) + bytes([fill]) * length)


@pytest.mark.parametrize(("latitude_deg", "longitude_deg"), [(90.1, 8.0), (-90.1, 8.0), (47.0, 180.1), (47.0, -180.1)])
def test_a_state_of_no_place_on_earth_is_refused(latitude_deg: float, longitude_deg: float) -> None:
    frame = LocalFrame(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=0.0)
    sent = VehicleState(frame=frame, position_m=(0.0, 0.0, 0.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=0.4)
    with pytest.raises(PacketError) as refused:
        decoded(state_packet(HEADER, sent))
    assert refused.value.code == "bad_place"


@given(st.floats(0.0, 600.0), st.floats(0.0, 600.0), st.floats(0.0, 6.0), st.floats(0.0, 25.0))
def test_uncertainties_of_a_state_are_rounded_up(
    sigma_m: float, sigma_z_m: float, sigma_yaw_rad: float, radius_m: float
) -> None:
    frame = LocalFrame(
        latitude_deg=47.0,
        longitude_deg=8.0,
        altitude_m=0.0,
        sigma_m=sigma_m,
        sigma_z_m=sigma_z_m,
        sigma_yaw_rad=sigma_yaw_rad,
    )
    sent = VehicleState(frame=frame, position_m=(0.0, 0.0, 0.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=radius_m)
    got = decoded(state_packet(HEADER, sent)).content
    assert isinstance(got, VehicleState)
    for value, sent_value, step in (
        (got.frame.sigma_m, sigma_m, 0.01),
        (got.frame.sigma_z_m, sigma_z_m, 0.01),
        (got.frame.sigma_yaw_rad, sigma_yaw_rad, 1e-4),
        (got.radius_m, radius_m, 0.1),
    ):
        assert sent_value - 1e-6 <= value <= sent_value + step + 1e-6


def test_a_plane_without_size_is_refused() -> None:
    with pytest.raises(PacketError) as refused:
        decoded(planes_packet(HEADER, planes(), (0.0, 0.0, 0.0), LONG) + bytes(LONG.bytes))
    assert refused.value.code == "plane_without_size"


@pytest.mark.parametrize("place", [(3e6, 0.0, 0.0), (0.0, -3e6, 0.0), (0.0, 0.0, 3e3), (math.nan, 0.0, 0.0)])
def test_an_anchor_too_far_from_the_origin_is_refused(place: tuple[float, float, float]) -> None:
    with pytest.raises(PacketError):
        anchor_of(*place)
