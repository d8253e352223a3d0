"""The streams over real ZeroMQ sockets, in and out of this process."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

from companion.cli import main
from companion.config.endpoints import beyond_loopback
from companion.live.health_stream import address_in_use
from companion.streams.curve_auth import AllowList, load_keys, make_keys
from companion.streams.publisher import MOST_RECEIVED_BYTES, Publisher, Stream
from drivers.base import BadData, DeviceNotFound
from osape_client.boot import boot_id
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.stream_subscriber import StreamSubscriber

pytestmark = pytest.mark.process

Context = zmq.Context[zmq.Socket[bytes]]


@pytest.fixture
def context() -> Iterator[Context]:
    context: Context = zmq.Context()
    yield context
    context.destroy(linger=0)


def frame(sequence: int, size: int = 0) -> pb.PrismsFrame:
    return pb.PrismsFrame(camera="front", sequence=sequence, planes=pb.Planes(corners_m=[1.0] * size))


def subscriber(context: Context, address: str) -> zmq.Socket[bytes]:
    socket = context.socket(zmq.SUB)
    socket.setsockopt(zmq.RCVTIMEO, 60_000)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.connect(address)
    return socket


def publish_until(publisher: Publisher, socket: zmq.Socket[bytes], seconds: float = 60.0) -> pb.PrismsFrame | None:
    """Publishes until the subscriber has one (joining takes a moment)."""
    for k in range(int(seconds * 100)):
        publisher.publish(frame(k))
        if socket.poll(10):
            return pb.PrismsFrame.FromString(socket.recv())
    return None


def test_a_subscriber_receives_frames(tmp_path: Path, context: Context) -> None:
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    publisher = Publisher(stream, context)
    got = publish_until(publisher, subscriber(context, stream.address))
    assert got is not None
    assert got.camera == "front"
    assert os.stat(tmp_path / "prisms").st_mode & 0o777 == 0o660
    publisher.close()
    publisher.close()


SLEEPER = textwrap.dedent("""
    import sys, time, zmq
    socket = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.connect(sys.argv[1])
    socket.recv()
    print("joined", flush=True)
    time.sleep(600)
""")


def idle_subscriber(publisher: Publisher) -> subprocess.Popen[bytes]:
    """A process that has received one message and reads no further one."""
    process = subprocess.Popen([sys.executable, "-c", SLEEPER, publisher.stream.address], stdout=subprocess.PIPE)
    assert process.stdout is not None
    for k in range(3000):
        publisher.publish(frame(k))
        if select.select([process.stdout], [], [], 0.005)[0]:
            return process
    process.kill()
    process.wait()
    raise AssertionError("the subscriber has received nothing")


def test_a_blocked_subscriber_costs_nothing(tmp_path: Path, context: Context) -> None:
    """A subscriber process that stops reading: publishing continues, and another subscriber receives the newest
    message."""
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    publisher = Publisher(stream, context)
    blocked = idle_subscriber(publisher)
    try:
        longest = 0.0
        for k in range(500):
            begun = time.monotonic()
            publisher.publish(frame(k, size=50_000))
            longest = max(longest, time.monotonic() - begun)
        assert longest < 1.0
        assert publish_until(publisher, subscriber(context, stream.address)) is not None
    finally:
        blocked.kill()
        blocked.wait()
        publisher.close()


def memory_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_what_waits_for_a_stopped_subscriber_is_bounded(tmp_path: Path, context: Context) -> None:
    """As for a viewer on a laptop that has left the radio range: 1000 waiting depth images took 150 MB."""
    stream = Stream("depth", f"ipc://{tmp_path}/depth")
    publisher = Publisher(stream, context, newest_only=False, most_waiting=10)
    blocked = idle_subscriber(publisher)
    try:
        blocked.send_signal(signal.SIGSTOP)
        before = memory_bytes()
        for k in range(1000):
            publisher.publish(frame(k, size=150_000))
        assert memory_bytes() - before < 30e6
        assert publish_until(publisher, subscriber(context, stream.address)) is not None
    finally:
        blocked.kill()
        blocked.wait()
        publisher.close()


def test_a_large_message_of_a_client_takes_no_memory(tmp_path: Path, context: Context) -> None:
    """Only subscriptions and requests without content are expected. ZeroMQ reserves what the header of a message states."""
    publisher = Publisher(Stream("requests", f"ipc://{tmp_path}/requests"), context, kind=zmq.REP, newest_only=False)
    for size, arrives in ((MOST_RECEIVED_BYTES + 1, False), (MOST_RECEIVED_BYTES, True)):
        client = context.socket(zmq.REQ)
        client.connect(publisher.stream.address)
        client.send(bytes(size))
        assert bool(publisher.socket.poll(60_000 if arrives else 500)) == arrives
        client.close(0)
    publisher.close()


def test_a_late_subscriber_gets_the_newest_only(tmp_path: Path, context: Context) -> None:
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    publisher = Publisher(stream, context)
    for k in range(100):
        publisher.publish(frame(k))
    late = subscriber(context, stream.address)
    for k in range(200, 700):
        publisher.publish(frame(k))
        if late.poll(10):
            assert pb.PrismsFrame.FromString(late.recv()).sequence >= 200
            break
    else:
        pytest.fail("the late subscriber received nothing")
    publisher.close()


def test_a_second_service_on_the_same_path_is_refused(tmp_path: Path, context: Context) -> None:
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    first = Publisher(stream, context)
    with pytest.raises(DeviceNotFound, match=rf"another service \(process {os.getpid()}\) publishes"):
        Publisher(stream, context)
    first.close()
    Publisher(stream, context).close()


def test_a_path_left_by_a_killed_service_is_taken_over(tmp_path: Path, context: Context) -> None:
    (tmp_path / "prisms.lock").write_text("99999\n")
    (tmp_path / "prisms").touch()
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    publisher = Publisher(stream, context)
    assert publish_until(publisher, subscriber(context, stream.address)) is not None
    publisher.close()


def test_a_folder_that_is_missing_and_a_port_that_is_taken(tmp_path: Path, context: Context) -> None:
    with pytest.raises(DeviceNotFound, match="does not exist; create it"):
        Publisher(Stream("prisms", f"ipc://{tmp_path}/none/prisms"), context)
    first = Publisher(Stream("prisms", "tcp://127.0.0.1:*"), context)
    address = first._socket.getsockopt_string(zmq.LAST_ENDPOINT)
    with pytest.raises(DeviceNotFound, match="the port is free"):
        Publisher(Stream("prisms", address), context)
    first.close()


def test_a_stream_on_an_ipv6_address(context: Context) -> None:
    publisher = Publisher(Stream("prisms", "tcp://[::1]:*"), context)
    address = publisher.socket.getsockopt_string(zmq.LAST_ENDPOINT)
    assert address_in_use(address)
    subscriber = StreamSubscriber("prisms", address, None)
    found = None
    for k in range(6000):
        publisher.publish(frame(k))
        found = subscriber._socket.take(10)
        if found is not None:
            break
    subscriber.close()
    publisher.close()
    assert found is not None


@pytest.mark.parametrize(
    ("address", "beyond"),
    [
        ("ipc:///run/x", False),
        ("tcp://127.0.0.1:5601", False),
        ("tcp://localhost:1", False),
        ("tcp://[::1]:5", False),
        ("tcp://[::]:5", True),
        ("tcp://*:5601", True),
        ("tcp://0.0.0.0:5601", True),
        ("tcp://eth0:5601", True),
        ("tcp://192.168.1.2:5", True),
    ],
)
def test_which_addresses_other_machines_can_reach(address: str, beyond: bool) -> None:
    assert beyond_loopback(address) is beyond


def test_an_open_stream_without_keys_is_refused(context: Context) -> None:
    with pytest.raises(ValueError, match="needs keys: make them with `companion keys`"):
        Publisher(Stream("prisms", "tcp://0.0.0.0:*"), context)


def test_the_printed_line_of_the_configuration_has_the_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The service looks for a relative path below its working directory."""
    monkeypatch.chdir(tmp_path)
    assert main(["keys", "mine"]) == 0
    assert f'[publish] keys = "{tmp_path / "mine"}"' in capsys.readouterr().out


def test_only_known_clients_receive_a_stream_with_keys(tmp_path: Path, context: Context) -> None:
    written = make_keys(tmp_path / "keys", "planner")
    keys = load_keys(tmp_path / "keys")
    assert [f.stat().st_mode & 0o777 for f in written if f.suffix == ".secret"] == [0o600, 0o600]
    allow = AllowList(context, keys)
    publisher = Publisher(Stream("prisms", "tcp://0.0.0.0:*"), context, keys)
    address = publisher._socket.getsockopt_string(zmq.LAST_ENDPOINT).replace("0.0.0.0", "127.0.0.1")

    def client(secret: bytes | None) -> zmq.Socket[bytes]:
        socket = context.socket(zmq.SUB)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        if secret is not None:
            socket.setsockopt(zmq.CURVE_SERVERKEY, keys.public)
            socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
            socket.setsockopt(zmq.CURVE_PUBLICKEY, zmq.curve_public(secret))
        socket.connect(address)
        return socket

    try:
        known = client((tmp_path / "keys" / "planner.secret").read_bytes().strip())
        assert publish_until(publisher, known) is not None
        other, naked = client(zmq.curve_keypair()[1]), client(None)
        assert publish_until(publisher, other, 0.5) is None
        assert publish_until(publisher, naked, 0.5) is None
    finally:
        publisher.close()
        allow.close()


def test_keys_that_cannot_be_used_name_the_cause(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match="`companion keys` makes keys"):
        load_keys(tmp_path)
    make_keys(tmp_path, "planner")
    with pytest.raises(ValueError, match="there is such a client"):
        make_keys(tmp_path, "planner")
    with pytest.raises(ValueError, match="expected letters"):
        make_keys(tmp_path, "../x")
    (tmp_path / "server.secret").chmod(0o644)
    with pytest.raises(BadData, match="others can read it"):
        load_keys(tmp_path)
    (tmp_path / "server.secret").chmod(0o600)
    (tmp_path / "server.public").write_text("short")
    with pytest.raises(BadData, match="not a key of 40 characters"):
        load_keys(tmp_path)


def test_the_secret_does_not_show(tmp_path: Path) -> None:
    make_keys(tmp_path, "planner")
    keys = load_keys(tmp_path)
    assert keys.secret.decode() not in f"{keys!r} {keys}"


def test_the_boot_has_an_id() -> None:
    assert boot_id() == boot_id()
    assert len(boot_id()) == 36


def test_no_socket_is_left_behind(tmp_path: Path, context: Context) -> None:
    """A socket file without a process would lead clients to the wrong folder."""
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    for _ in range(2):
        publisher = Publisher(stream, context)
        assert (tmp_path / "prisms").is_socket()
        publisher.close()
        assert not (tmp_path / "prisms").exists()
        publisher.close()


def test_a_refused_service_leaves_the_socket_of_the_other(tmp_path: Path, context: Context) -> None:
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")
    publisher = Publisher(stream, context)
    with pytest.raises(DeviceNotFound, match="another service"):
        Publisher(stream, context)
    assert (tmp_path / "prisms").is_socket()
    publisher.close()


def test_an_address_that_cannot_be_closed_to_others_is_free_for_the_next(
    tmp_path: Path, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = Stream("prisms", f"ipc://{tmp_path}/prisms")

    def refused(path: str, mode: int) -> None:
        raise PermissionError(1, "Operation not permitted", path)

    with monkeypatch.context() as patched:
        patched.setattr(os, "chmod", refused)
        with pytest.raises(DeviceNotFound, match="Operation not permitted"):
            Publisher(stream, context)
    assert not (tmp_path / "prisms").exists(), "clients would take it for a service"
    Publisher(stream, context).close()
