"""The health report of a running service, as other commands receive it."""

from __future__ import annotations

import socket

import zmq
from google.protobuf.message import DecodeError

from drivers.base import BadData, DeviceNotFound
from osape_client.connect import connect
from osape_client.proto import osape_v1_pb2 as pb

PROBE_S = 1.0


def address_in_use(address: str) -> bool:
    """Returns True if a process listens on an address, or if that cannot be determined.

    Raises PermissionError if this user may not connect."""
    try:
        if address.startswith("ipc://"):
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
                probe.settimeout(PROBE_S)
                probe.connect(address.removeprefix("ipc://"))
        else:
            host, _, port = address.removeprefix("tcp://").rpartition(":")
            here = "127.0.0.1" if host in ("*", "0.0.0.0") else host.strip("[]")
            socket.create_connection((here, int(port)), PROBE_S).close()
    except (FileNotFoundError, ConnectionRefusedError):
        return False
    except PermissionError:
        raise
    except (OSError, ValueError):
        return True
    return True


def newest_health(address: str, timeout_s: float) -> pb.Health:
    """The next health report on an address. Raises DeviceNotFound when none arrives, and BadData for other messages."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    subscriber = context.socket(zmq.SUB)
    try:
        subscriber.setsockopt(zmq.SUBSCRIBE, b"")
        subscriber.setsockopt(zmq.LINGER, 0)
        connect(subscriber, address, None)
        if not subscriber.poll(round(timeout_s * 1000)):
            raise DeviceNotFound(
                f"no health report on {address} within {timeout_s:g} s: the service does not run (check `systemctl "
                "status osape-companion`, start `companion run`) or publishes elsewhere (give its configuration with "
                "-c)"
            )
        data = subscriber.recv()
        try:
            return pb.Health.FromString(data)
        except DecodeError as error:
            raise BadData(
                f"{address}: {len(data)} bytes that are no health report: another program or another stream of the service "
                "publishes there; give the configuration of the service with -c"
            ) from error
    finally:
        subscriber.close(0)
        context.term()
