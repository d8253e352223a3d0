"""Replies of a simulated autopilot to a reader of parameters."""

from __future__ import annotations

from companion.config.avoidance import AvoidParams
from drivers.mavlink.parser import MessageSplitter
from drivers.simulation.autopilot import SimulatedAutopilot

AVOID = AvoidParams(max_distance_m=12.0)
NS = 1_000_000_000


def answers(autopilot: SimulatedAutopilot, requests: list, now_ns: int) -> list:
    """The autopilot's answers to messages, decoded from bytes."""
    for request in requests:
        autopilot.receive(bytes(request.pack(autopilot._mavlink)), now_ns)
    return MessageSplitter().feed(b"".join(autopilot.due(now_ns)))
