"""The demo's planner: a subscriber in a process of its own, `python -m companion.demo.listener PRISMS`.

It reads each message as a planner would and prints one JSON object when it is ended (SIGTERM)."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass, field

import numpy as np
import zmq

from osape_client.connect import connect
from osape_client.decode import cause_code
from osape_client.proto import osape_v1_pb2 as pb

from ..diagnostic import without_digits
from ..stop_signal import stop_event

POLL_MS = 100


@dataclass(slots=True)
class ReceiveStats:
    """Counts of a subscriber."""

    messages: int = 0
    valid: int = 0
    planes: int = 0
    bytes: int = 0
    age_ms: tuple[float, float] = (0.0, 0.0)  # (p50, p99) from exposure to reception of valid frames
    causes: dict[str, int] = field(default_factory=dict)
    """Number of invalid frames by code of the cause."""
    texts: dict[str, int] = field(default_factory=dict)
    """Number of invalid frames by text of the cause. Texts that differ in numbers only are counted under the first one."""

    def add_invalid(self, message: pb.PrismsFrame) -> None:
        """Counts an invalid frame."""
        code, kind = cause_code(message.cause), without_digits(message.cause_text)
        self.causes[code] = self.causes.get(code, 0) + 1
        text = next((t for t in self.texts if without_digits(t) == kind), message.cause_text)
        self.texts[text] = self.texts.get(text, 0) + 1


def listen(address: str) -> ReceiveStats:
    """Counts messages until SIGTERM or SIGINT."""
    stop = stop_event()
    received, ages_ms = ReceiveStats(), []
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    connect(socket, address, None)
    while not stop.is_set():
        if not socket.poll(POLL_MS):
            continue
        data = socket.recv()
        message = pb.PrismsFrame.FromString(data)
        received.messages += 1
        received.bytes += len(data)
        if not message.valid:
            received.add_invalid(message)
            continue
        received.valid += 1
        received.planes += len(message.planes.margin_m)
        ages_ms.append((time.monotonic_ns() - message.t_exposure_ns) / 1e6)
    socket.close(0)
    context.term()
    if ages_ms:
        received.age_ms = (float(np.percentile(ages_ms, 50)), float(np.percentile(ages_ms, 99)))
    return received


if __name__ == "__main__":
    sys.stdout.write(json.dumps(asdict(listen(sys.argv[1]))) + "\n")
