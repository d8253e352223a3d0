"""What sharing leaves out: floods, other coordinates, an unknown own number, and its faults."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from companion.config.share import ShareConfig
from companion.diagnostic import DiagnosticCode
from companion.pipeline.tracking import TracksResult
from companion.share.output import SharingOutput
from companion.share.packet_rate import ALL_BURST, BURST, PacketRate
from companion.share.sharing_thread import OwnVehicle, Sharing
from companion.streams.publication import PublicationStamps
from core.sharing.packet_codec import decoded
from core.sharing.records import SharedPlanes
from core.sharing.send_budget import Budget
from core.sharing.send_queue import Offer, SendQueue
from drivers.mavlink.parser import SIGNATURE_BYTES
from drivers.sharing.link import ReceivedPacket
from drivers.sharing.tunnel import FRAME_BYTES, PAYLOAD_BYTES
from drivers.sharing.zenoh_link import OVERHEAD_BYTES, PACKET_BYTES

from .test_share_campaign import some_planes
from .test_share_thread import NS, STATE, Made, MemoryLink, moving, received_movers, tracked


def burst(rate: PacketRate, count: int, sender: int, transport: str = "tunnel") -> int:
    """Number of packets at one instant that are allowed."""
    return sum(rate.allows(ReceivedPacket(transport, b"", NS, sender)) for _ in range(count))


def test_all_senders_together_are_bounded() -> None:
    rate = PacketRate(frozenset())
    allowed = sum(burst(rate, round(BURST), sender) for sender in range(1, 20))
    assert allowed == ALL_BURST


def test_a_flood_on_one_link_leaves_room_for_the_same_sender_on_another() -> None:
    rate = PacketRate(frozenset())
    assert burst(rate, 1000, 3) == BURST
    assert burst(rate, 10, 3, "zenoh") == 10


def sharing(vehicle: int, origin: str) -> Sharing:
    return Sharing(
        ShareConfig(origin=origin),
        OwnVehicle(lambda: vehicle, 1, 0.4),
        lambda deliver: [MemoryLink(deliver)],
        SharingOutput(None, PublicationStamps(""), lambda *_: None),
    )


def codes(one: Sharing, now_ns: int) -> list[DiagnosticCode]:
    return [d.code for d in one.diagnostics(now_ns, 1.0)]


def test_the_origin_of_an_autopilot_without_one_is_not_used() -> None:
    one = sharing(1, "")
    one.origin(0.0, 0.0, 0.0)
    one.step(NS)
    assert DiagnosticCode.SHARE_NO_FRAME in codes(one, NS)
    one.origin(47.0, 8.0, 400.0)
    one.step(2 * NS)
    assert DiagnosticCode.SHARE_NO_FRAME not in codes(one, NS)


@pytest.mark.parametrize(
    ("north_deg", "east_deg", "up_m", "corrected"),
    [
        (1e-6, 0.0, 0.0, False),
        (0.0, 0.0, 0.19, False),
        (2e-6, 0.0, 0.0, True),
        (0.0, 3e-6, 0.0, True),
        (0.0, 0.0, -0.21, True),
    ],
)
def test_an_origin_within_a_tenth_of_its_uncertainty_is_the_same(
    north_deg: float, east_deg: float, up_m: float, corrected: bool
) -> None:
    """ArduPilot can filter the altitude of its origin all the time: each new one sends all planes anew and ends all alignments."""
    one = sharing(1, "")
    one.origin(47.0, 8.0, 400.0)
    one.origin(47.0 + north_deg, 8.0 + east_deg, 400.0 + up_m)
    one.step(NS)
    assert one._team is not None
    assert (one._team.own.origin != (47.0, 8.0, 400.0)) is corrected


def test_small_corrections_of_the_origin_add_up() -> None:
    one = sharing(1, "")
    for k in range(100):
        one.origin(47.0, 8.0, 400.0 + 0.01 * k)
    one.step(NS)
    assert one._team is not None
    assert one._team.own.origin is not None
    assert one._team.own.origin[2] == pytest.approx(400.99, abs=0.21)


def test_nothing_is_exchanged_before_the_own_number_is_known() -> None:
    one = sharing(0, "47.0, 8.0, 400")
    one.step(NS)
    assert one.health.vehicle == 0
    assert one.obstacles.now_ns != NS


def test_moving_obstacles_in_other_coordinates_than_ned_are_not_sent() -> None:
    made = Made()
    level = cast(SimpleNamespace, tracked("front", 5 * NS, moving(20.0)))
    level.frame = "level"
    made.sharing.tracks(cast(TracksResult, level))
    assert received_movers(made, 5 * NS + NS // 10) == []


def test_a_flood_of_one_sender_is_dropped_before_it_is_decoded() -> None:
    made = Made()
    for number in range(500):
        made.deliver(1000 + number, 5 * NS)
    for k in range(10):
        made.sharing.step(5 * NS + k * NS // 5)
    assert made.sharing.health.received["accepted"] == BURST
    assert made.sharing.health.received["flood"] == 500 - BURST


def test_a_packet_in_the_name_of_another_vehicle_than_its_sender_is_refused() -> None:
    made = Made()
    made.deliver(1000, 5 * NS)
    made.sharing.step(5 * NS)
    (packet,) = made.link.confirmed
    made.link.deliver(replace(packet, arrival_ns=6 * NS, sender=3))
    made.sharing.step(6 * NS)
    assert made.sharing.health.received["sender_mismatch"] == 1
    assert made.sharing.health.received["accepted"] == 1


def test_only_the_link_of_a_packet_is_confirmed() -> None:
    made = Made()
    data = made.deliver(1000, 5 * NS)
    made.sharing.step(5 * NS)
    (packet,) = made.link.confirmed
    made.link.deliver(
        replace(packet, transport="zenoh", data=data[:6] + (2000).to_bytes(4, "little") + data[10:], arrival_ns=6 * NS)
    )
    made.sharing.step(6 * NS)
    assert made.sharing.health.received["accepted"] == 2
    assert len(made.link.confirmed) == 1


def test_a_link_that_is_not_open_and_a_thread_that_does_not_respond_are_reported() -> None:
    made = Made()
    made.sharing.step(5 * NS)
    now_ns = made.sharing.alive_ns
    assert codes(made.sharing, now_ns) == []
    assert codes(made.sharing, now_ns + 2 * NS) == [DiagnosticCode.SHARE_FAULT]
    cast(SimpleNamespace, made.link).fault = "no such device"
    assert codes(made.sharing, now_ns) == [DiagnosticCode.SHARE_LINK_CLOSED]


def configured(rate: str, bytes_per_s: float) -> ShareConfig:
    limits: dict[str, Any] = {rate: bytes_per_s}
    return ShareConfig(**limits)


@pytest.mark.parametrize(
    ("rate", "least", "overhead_bytes", "packet_bytes"),
    [
        ("tunnel_bytes_per_s", 100.0, FRAME_BYTES + SIGNATURE_BYTES, PAYLOAD_BYTES),
        ("zenoh_bytes_per_s", 150.0, OVERHEAD_BYTES, PACKET_BYTES),
    ],
)
def test_new_planes_are_sent_at_the_least_data_rate_after_a_rest(
    rate: str, least: float, overhead_bytes: int, packet_bytes: int
) -> None:
    """Below it the own motion takes what is left beside the reserve for it, and no plane is ever sent."""
    with pytest.raises(ValueError, match=rate):
        configured(rate, least - 1.0)
    configured(rate, least)
    queue = SendQueue(1, 5, 0, Budget(bytes_per_s=least, overhead_bytes=overhead_bytes, packet_bytes=packet_bytes))
    given = Offer(planes=SharedPlanes.empty(), movers=(), state=STATE, section=1)
    for k in range(300):
        queue.packets(given, k * NS // 10)
    sent = queue.packets(replace(given, planes=some_planes(np.random.default_rng(1), 5)), 30 * NS)
    assert any(isinstance(content := decoded(data).content, SharedPlanes) and len(content) for data in sent)
