"""The C++ example is built from the .proto and hears what the service says, where a compiler and the libraries are."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq

from drivers.proto import osape_v1_pb2 as pb

SOURCE = Path(__file__).resolve().parents[2] / "examples" / "cpp"


def missing() -> str:
    tools = [tool for tool in ("c++", "cmake", "protoc", "pkg-config") if shutil.which(tool) is None]
    if tools:
        return f"not here: {', '.join(tools)}"
    known = subprocess.run(["pkg-config", "--exists", "libzmq", "protobuf"], check=False)
    return "" if known.returncode == 0 else "no headers of libzmq or protobuf"


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if missing():
        pytest.skip(f"the C++ example cannot be built: {missing()}")
    build = tmp_path_factory.mktemp("cpp")
    for command in (["cmake", "-S", SOURCE, "-B", build], ["cmake", "--build", build]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return build / "subscriber"


@pytest.fixture
def publisher(tmp_path: Path) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.setsockopt(zmq.XPUB_VERBOSE, 1)
        socket.bind(f"ipc://{tmp_path}/prisms")
        yield socket


def heard(program: Path, publisher: zmq.Socket[bytes], message: bytes | None) -> str:
    address = publisher.getsockopt_string(zmq.LAST_ENDPOINT)
    with subprocess.Popen([program, address, "1"], stdout=subprocess.PIPE, text=True) as process:
        assert publisher.poll(10_000), "it did not subscribe"
        publisher.recv()
        if message is not None:
            publisher.send(message)
        said, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    return said.strip()


def frame(**more: object) -> pb.PrismsFrame:
    wall = pb.Planes(corners_m=[6, 3, 6, -3, -2, 2, 9, 1, 9, -1, 0, 1], margin_m=[0.25, 0.25])
    return pb.PrismsFrame(schema_version=1, frame="level", valid=True, planes=wall, **more)


def test_planes_and_the_nearest_of_them(program: Path, publisher: zmq.Socket[bytes]) -> None:
    said = heard(program, publisher, frame(publication=pb.Publication(age_ns=20_000_000)).SerializeToString())
    assert said.startswith("level: 2 planes, 0 prisms, nearest 5.75 m, 2")


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (frame(publication=pb.Publication(age_ns=900_000_000)).SerializeToString(), "0.9 s old"),
        (pb.PrismsFrame(schema_version=1, cause_text="camera front is silent").SerializeToString(), "camera front is silent"),
        (b"\xff" * 40, "not a message of this version"),
        (pb.PrismsFrame(schema_version=2, valid=True).SerializeToString(), "not a message of this version"),
        (None, "no news"),
    ],
    ids=["stale", "blind", "foreign", "of another version", "silent"],
)  # fmt: skip
def test_what_says_nothing_frees_nothing(
    program: Path, publisher: zmq.Socket[bytes], message: bytes | None, why: str
) -> None:
    assert heard(program, publisher, message) == f"nothing may be taken as free: {why}"
