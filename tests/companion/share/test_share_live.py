"""The service as a process in a team: it sends its planes in TUNNEL messages, publishes those of a neighbour beside its own world, and
its log replays bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.replay.replay import Options, replay
from core.sharing.packet_codec import decoded, planes_packet, state_packet
from core.sharing.records import Header, LocalFrame, SharedPlanes, VehicleState
from drivers.logs.reader import McapRecording
from drivers.mavlink.address import parse_address
from drivers.sharing.link import ReceivedPacket
from drivers.sharing.tunnel_line import TunnelLine
from osape_client.neighbours_subscriber import NeighboursSubscriber
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.world.mirror import WorldMirror
from tests.ports import free_port
from tests.waiting import PATIENCE_S, until

from ..live.test_service import CONFIG
from ..live_service import Live, flown

pytestmark = pytest.mark.process

SHARE = """
[publish]
world = "ipc://{run}/world"
world_requests = "ipc://{run}/world-snapshot"

[share]
enabled = true
origin = "47.0, 8.0, 400"
tunnel = "udpin:127.0.0.1:PORT"
least_hits = 1
"""
FRAME = LocalFrame(
    latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0, sigma_m=0.5, sigma_z_m=0.5, sigma_yaw_rad=0.01
)
FAR = (500.0, 0.0, 500.0, 9.0, -9.0, 0.0)


def packets(sent_ms: int) -> list[bytes]:
    """State and one plane of vehicle 9."""
    state = VehicleState(frame=FRAME, position_m=(480.0, 0.0, -5.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=0.4)
    one = np.ones(1)
    plane = SharedPlanes(
        ids=np.zeros(1, np.uint16),
        box=np.array([FAR]),
        margin_m=0.1 * one,
        flags=np.zeros(1, np.uint8),
        age_s=0.1 * one,
    )
    head = {"vehicle": 9, "stream": 1_700_000_000, "section": 0}
    return [
        state_packet(Header(sent_ms=sent_ms, **head), state),
        planes_packet(Header(sent_ms=sent_ms + 1, **head), plane, (512.0, 0.0, 0.0)),
    ]


def test_a_service_in_a_team(tmp_path: Path, renders: Path) -> None:
    port = free_port()
    config = CONFIG.replace('record = "off"', 'record = "always"') + SHARE.replace("PORT", str(port))
    live = Live(tmp_path, config, renders)
    received: list[ReceivedPacket] = []
    line = TunnelLine(parse_address(f"udpout:127.0.0.1:{port}"), 196, received.append)
    try:
        with (
            flown(live),
            NeighboursSubscriber(f"ipc://{tmp_path}/run/neighbours") as subscriber,
            WorldMirror(f"ipc://{tmp_path}/run/world", f"ipc://{tmp_path}/run/world-snapshot") as mirror,
        ):
            live.start()
            health = live.subscribe("health", pb.Health)
            line.open()
            sent = [0]

            def neighbours_received() -> bool:
                sent[0] += 200
                line.send(packets(sent[0]), 9)
                return len(subscriber.newest(wait_s=0.1).sender) == 1

            assert until(neighbours_received, PATIENCE_S), live.output()
            found = subscriber.newest()
            assert np.abs(found.planes[0, :4] - FAR[:4]).max() < 0.1
            assert [m.is_vehicle for m in found.movers] == [True]
            assert until(lambda: mirror.update(0.2), PATIENCE_S)
            assert (mirror.space.snapshot.planes[:, 0] < 400.0).all()  # the own world has nothing of it

            def own_planes() -> bool:
                return any(isinstance(decoded(p.data).content, SharedPlanes) for p in received)

            assert until(lambda: neighbours_received() and own_planes(), PATIENCE_S)
            assert {p.sender for p in received} == {decoded(received[0].data).header.vehicle}
            team = health.wait(lambda h: len(h.team.neighbours) == 1, PATIENCE_S).team
            assert team.received["accepted"] > 0
            assert live.stop() == 0
        (log,) = live.logs
        check = replay(log, Options(check=True)).comparison
        assert check is not None
        assert check.passed, check
        with McapRecording(log) as recording:
            assert any(recording.messages("team"))
    finally:
        line.close()
        live.close()
