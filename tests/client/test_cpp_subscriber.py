"""The C++ library and its examples: built from the .proto, fed with messages, compared with the queries in Python."""

from __future__ import annotations

import itertools
import math
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq

from companion.pipeline.decode_model import model_from_message
from companion.streams.publication import PublicationStamps
from osape_client import Message, tracks_from_message
from osape_client.boot import boot_id
from osape_client.clock import clock_ns
from osape_client.connect import MOST_BYTES
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import Occupancy, PlacedModel, Space

from .test_subscriber import answer_as_another_program

pytestmark = pytest.mark.process

Place = tuple[float, float, float]


@pytest.fixture
def publisher(tmp_path: Path) -> Iterator[zmq.Socket[bytes]]:
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.setsockopt(zmq.XPUB_VERBOSE, 1)
        socket.bind(f"ipc://{tmp_path}/prisms")
        yield socket


def output_for(program: Path, publisher: zmq.Socket[bytes], message: bytes | None) -> str:
    address = publisher.getsockopt_string(zmq.LAST_ENDPOINT)
    with subprocess.Popen([program, address, "1"], stdout=subprocess.PIPE, text=True) as process:
        assert publisher.poll(60_000), "it did not subscribe"
        publisher.recv()
        if message is not None:
            publisher.send(message)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    return output.strip()


def frame(**more: object) -> pb.PrismsFrame:
    wall = pb.Planes(
        corners_m=[6, 3, 6, -3, -2, 2, 9, 1, 9, -1, 0, 1],
        margin_m=[0.25, 0.25],
        support_px=[9, 9],
        flags=[0, 0],
        cluster=[0, 0],
    )
    return pb.PrismsFrame(schema_version=1, frame="level", valid=True, planes=wall, **more)


def test_planes_and_the_nearest_of_them(program: Path, publisher: zmq.Socket[bytes]) -> None:
    output = output_for(program, publisher, frame(publication=pb.Publication(age_ns=20_000_000)).SerializeToString())
    assert output.startswith("level: 2 planes, 0 prisms, nearest 5.75 m, 2")


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (frame(publication=pb.Publication(age_ns=900_000_000)).SerializeToString(), "0.9 s old"),
        (
            pb.PrismsFrame(
                schema_version=1, cause_text="camera front is silent", publication=pb.Publication()
            ).SerializeToString(),
            "camera front is silent",
        ),
        (b"\xff" * 40, "not a PrismsFrame of schema version 1"),
        (pb.PrismsFrame(schema_version=2, valid=True).SerializeToString(), "not a PrismsFrame of schema version 1"),
        (frame().SerializeToString(), "cut short: the part that is written last is missing"),
        (None, "no message"),
    ],
    ids=["stale", "blind", "foreign", "of another version", "without its end", "silent"],
)
def test_invalid_frames_free_nothing(
    program: Path, publisher: zmq.Socket[bytes], message: bytes | None, why: str
) -> None:
    output = output_for(program, publisher, message)
    assert output.startswith("nothing may be taken as free: ")
    assert why in output


@pytest.mark.parametrize(("suspended_s", "stale"), [(0.0, False), (100.0, True)])
def test_a_suspension_since_the_start_of_the_service_counts_in_the_age(
    program: Path, publisher: zmq.Socket[bytes], suspended_s: float, stale: bool
) -> None:
    publication = PublicationStamps(boot_id()).stamp(0, 0)
    publication.suspended_ns -= round(suspended_s * 1e9)
    ahead_ns = 5_000_000_000  # of a program that starts slowly; a stamp of the future counts as one of now
    message = frame(t_exposure_ns=time.monotonic_ns() + ahead_ns, publication=publication)
    output = output_for(program, publisher, message.SerializeToString())
    if stale:
        what, age = output.split(":")
        assert what == "nothing may be taken as free"
        assert float(age.removesuffix("s old")) >= 95.0
    else:
        assert output.startswith("level: 2 planes")


def over_ground(rng: np.random.Generator, camera: Place) -> pb.PrismsFrame:
    """A frame of a wall and of inclined ground 2 m below a camera whose view begins anywhere."""
    directions = 12
    edges = rng.uniform(-4.0, 4.0) + np.linspace(0.0, rng.uniform(0.5, 3.0), directions + 1)
    size = 4 * directions
    made = frame(stats=pb.FrameStats(planes=2))
    made.free.CopyFrom(
        pb.FreeProfile(
            azimuth_edges_rad=edges,
            layer_edges_m=camera[2] + np.array([-4.0, -2.0, 0.0, 2.0, 4.0]),
            free_from_m=rng.uniform(0.0, 3.0, size),
            free_to_m=rng.choice([0.0, 6.0, 12.0], size),
            end=bytes(size),
            open_from_dm=bytes(rng.integers(0, 30, size).tolist()),
            open_to_dm=bytes(rng.choice([0, 90, 140], size).tolist()),
        )
    )
    made.ground.CopyFrom(
        pb.Ground(
            seen=True,
            height_m=2.0,
            slope_x=rng.uniform(-0.1, 0.1),
            slope_y=rng.uniform(-0.1, 0.1),
            tolerance_m=0.25,
            noise_per_m=0.03,
            seen_from_m=rng.uniform(0.0, 3.0, directions),
            seen_to_m=rng.choice([0.0, 5.0, 9.0], directions),
        )
    )
    t = made.transform.translation_m
    t.x, t.y, t.z = camera
    return made


@pytest.mark.parametrize("seed", range(4))
def test_it_answers_as_the_queries_in_python_do(program: Path, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = tuple(rng.uniform(-3.0, 3.0, 3))
    message = over_ground(rng, camera)
    if seed == 3:
        message.ground.ClearField("tolerance_m")  # as an older version wrote it
    p = rng.uniform([-12, -12, -4], [12, 12, 5], (4000, 3)) + camera
    radius_m = 0.15 * seed
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    asked = "\n".join(f"{x:.17g} {y:.17g} {z:.17g} {radius_m}" for x, y, z in p)
    model = model_from_message(message)
    assert model is not None
    space = Space([PlacedModel(model, camera)])
    for allow_open, kinds in ((False, set(Occupancy) - {Occupancy.OPEN}), (True, set(Occupancy))):
        query = [program.parent / "query", file, *(["--allow-open"] if allow_open else [])]
        done = subprocess.run(query, input=asked, capture_output=True, text=True, check=True)
        expected = space.points(p, radius_m, allow_open=allow_open)
        assert set(expected.tolist()) == kinds
        assert [int(line) for line in done.stdout.split()] == expected.tolist()


def at_planes_and_layers(message: pb.PrismsFrame, camera: Place, radius_m: float) -> list[Place]:
    """Points whose balls touch the ends and margins of planes and the borders of layers, and points far away."""
    x, y, z = camera
    rows = np.array(message.planes.corners_m).reshape(-1, 6)
    points = []
    for (ax, ay, bx, by, top, bottom), margin_m in zip(rows.tolist(), message.planes.margin_m, strict=True):
        reach_m = margin_m + radius_m
        for px, py in ((ax, ay), (bx, by), (0.5 * (ax + bx), 0.5 * (ay + by))):
            aside = [(px + s * reach_m, py) for s in (-1, 0, 1)] + [(px, py + s * reach_m) for s in (-1, 1)]
            points += [(qx, qy, qz) for qx, qy in aside for qz in (top - reach_m, top, bottom, bottom + reach_m)]
    points += [(x + 3.0, y, edge + s * radius_m) for edge in message.free.layer_edges_m for s in (-1, 0, 1)]
    for far_m in (1e9, 1.1e9, -1e300):
        points += [(far_m, y, z), (x, far_m, z), (x, y, far_m)]
    return points


def at_directions_and_ranges(message: pb.PrismsFrame, camera: Place, radius_m: float) -> list[Place]:
    """Points on the borders of directions, whose balls touch the ends of free ranges, as far as sine and cosine are exact."""
    x, y, z = camera
    ends_m = sorted(set(message.free.free_to_m))
    ranges_m = [0.0, radius_m, 3.0, *(end_m - radius_m for end_m in ends_m)]
    return [
        (x + range_m * math.cos(azimuth), y + range_m * math.sin(azimuth), z + 0.25)
        for azimuth in message.free.azimuth_edges_rad
        for range_m in ranges_m
    ]


NANOMETRES = np.vstack([np.zeros(3), 1e-9 * np.eye(3), -1e-9 * np.eye(3)])


@pytest.mark.parametrize("seed", range(20))
def test_it_answers_at_borders_as_the_queries_in_python_do(program: Path, tmp_path: Path, seed: int) -> None:
    """`occupancy` did not refuse positions beyond 1e9 m, and reduced azimuths to one turn in another way than Python.

    Functions such as the arc tangent may round differently: there the answer of a place 1 nm away is accepted."""
    rng = np.random.default_rng(seed)
    x, y, z = (np.round(rng.uniform(-3.0, 3.0, 3) * 4) / 4).tolist()
    message = over_ground(rng, (x, y, z))
    radius_m = float(rng.choice([0.0, 0.125, 0.5]))
    message.ground.seen = bool(rng.random() < 0.5)
    exact = at_planes_and_layers(message, (x, y, z), radius_m)
    rounded = at_directions_and_ranges(message, (x, y, z), radius_m)
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    asked = "\n".join(f"{px!r} {py!r} {pz!r} {radius_m}" for px, py, pz in exact + rounded)
    done = subprocess.run([program.parent / "query", file], input=asked, capture_output=True, text=True, check=True)
    answers = [int(word) for word in done.stdout.split()]
    space = Message(message, clock_ns(), timeout_s=1e9).space
    assert answers[: len(exact)] == space.points(exact, radius_m).tolist()
    for point, answer in zip(rounded, answers[len(exact) :], strict=True):
        assert answer in space.points(point + NANOMETRES, radius_m), point


OCCUPANCY_OF_MESSAGES = """
#include <cmath>
#include <iostream>
#include "osape_client/subscriber.h"
int main() {
  osape_client::Message message;
  if (!message.content.ParseFromIstream(&std::cin)) return 1;
  for (const double timeout_s : {1e9, 0.0}) {
    message.timeout_s = timeout_s;
    for (const double x : {3.0, 6.0, 11.0, std::nan(""), HUGE_VAL, 1.1e9})
      std::cout << static_cast<int>(osape_client::occupancy(message, {x, 0.0, 0.0}, 0.1, true)) << ' ';
  }
  for (const double x : {6.0, std::nan(""), HUGE_VAL})
    std::cout << osape_client::nearest_plane_m(message.content.planes(), x, 0.0) << ' ';
}
"""


def compiled(program: Path, tmp_path: Path, text: str) -> Path:
    """A program of this text with the library of `program`."""
    source, binary = tmp_path / "message.cpp", tmp_path / "message"
    source.write_text(text)
    libraries = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "protobuf", "libzmq"], capture_output=True, text=True, check=True
    )
    build, include = program.parent, Path(__file__).resolve().parents[2] / "clients" / "cpp" / "include"
    command = ["c++", "-std=c++17", source, f"-I{include}", f"-I{build}", build / "libosape_client.a", "-o", binary]
    done = subprocess.run([*command, *libraries.stdout.split()], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return binary


WAIT_WITHOUT_END = """
#include <iostream>
#include "osape_client/subscriber.h"
int main(int, char** argv) {
  osape_client::Subscriber subscriber(argv[1]);
  std::cout << (subscriber.wait(std::chrono::milliseconds::max()) ? "message" : "none");
}
"""


def test_it_can_wait_without_an_end(program: Path, tmp_path: Path, publisher: zmq.Socket[bytes]) -> None:
    """The end of the wait overflowed: it returned at once."""
    binary = compiled(program, tmp_path, WAIT_WITHOUT_END)
    address = publisher.getsockopt_string(zmq.LAST_ENDPOINT)
    with subprocess.Popen([binary, address], stdout=subprocess.PIPE, text=True) as process:
        assert publisher.poll(60_000), "it did not subscribe"
        publisher.recv()
        time.sleep(0.5)
        publisher.send(frame(publication=pb.Publication()).SerializeToString())
        assert process.communicate(timeout=60)[0] == "message"


def test_nothing_is_free_in_a_stale_message(program: Path, tmp_path: Path) -> None:
    """Free, behind a wall, open and not a position, first of a message that is not stale."""
    binary = compiled(program, tmp_path, OCCUPANCY_OF_MESSAGES)
    message = frame(stats=pb.FrameStats(planes=2))
    message.transform.SetInParent()
    message.free.CopyFrom(
        pb.FreeProfile(
            azimuth_edges_rad=[-1.0, 1.0],
            layer_edges_m=[-2.0, 2.0],
            free_from_m=[1.0],
            free_to_m=[8.0],
            end=bytes(1),
            open_from_dm=bytes([80]),
            open_to_dm=bytes([140]),
        )
    )
    done = subprocess.run([binary], input=message.SerializeToString(), capture_output=True, check=True)
    fresh, stale = (
        [Occupancy.FREE, Occupancy.OCCUPIED, Occupancy.OPEN],
        [Occupancy.UNKNOWN, Occupancy.OCCUPIED, Occupancy.UNKNOWN],
    )
    beyond = [Occupancy.OCCUPIED] * 3
    answers, nearest_m = done.stdout.split()[:-3], done.stdout.split()[-3:]
    assert [int(word) for word in answers] == [*fresh, *beyond, *stale, *beyond]
    assert [float(word) for word in nearest_m] == [-0.25, 0.0, 0.0]


DAMAGED_PRISMS: dict[str, dict[str, Any]] = {
    "prism upside down": {"top_m": 1.0, "bottom_m": 0.0, "vertices_m": [1, 1, 2, 2], "plane": [0]},
    "prism without height": {"bottom_m": float("nan"), "vertices_m": [1, 1, 2, 2], "plane": [0]},
    "prism of half a vertex": {"bottom_m": 1.0, "vertices_m": [1, 1, 2, 2, 3], "plane": [0]},
    "prism without an edge": {"bottom_m": 1.0, "vertices_m": [1, 1, 2, 2]},
    "prism of a wrong margin": {"bottom_m": 1.0, "margin_m": -1.0, "vertices_m": [1, 1, 2, 2], "plane": [0]},
}


BEYOND_ALL_MEASURE = {
    "planes.corners_m": 1e30,
    "planes.margin_m": 1e10,
    "free.free_from_m": -1e38,
    "free.free_to_m": 1e38,
    "free.layer_edges_m": -1e38,
    "ground.height_m": 1e300,
    "ground.slope_y": -1e300,
    "ground.noise_per_m": 1e300,
    "ground.tolerance_m": 1e300,
    "ground.seen_to_m": 1e38,
}


def _damage(message: pb.PrismsFrame, part: str) -> None:
    """Damages this part of a message."""
    if part in BEYOND_ALL_MEASURE:
        of, name = part.split(".")
        of, value = getattr(message, of), BEYOND_ALL_MEASURE[part]
        if isinstance(getattr(of, name), float):
            setattr(of, name, value)
        else:
            getattr(of, name)[0] = value
    elif part == "more than one turn":
        message.free.azimuth_edges_rad[-1] = message.free.azimuth_edges_rad[0] + 6.3
    elif part == "cause":
        message.cause = pb.CAUSE_MOUNT_ERROR
    elif part == "frame":
        message.frame = "another"
    elif part == "free_to_m":
        message.free.free_to_m[0] = float("inf")
    elif part == "place":
        message.transform.translation_m.z = float("nan")
    elif part == "place beyond all measure":
        message.transform.translation_m.z = 1e10
    elif part == "large support_px":
        message.planes.support_px[0] = 2**31
    elif part.startswith("prism"):
        message.prisms.add(**DAMAGED_PRISMS[part])
    elif part in ("end", "open_from_dm", "open_to_dm"):
        setattr(message.free, part, getattr(message.free, part)[:-1])
    elif part in ("support_px", "flags", "cluster"):
        getattr(message.planes, part).pop()
    else:
        message.ClearField(part)


@pytest.mark.parametrize(
    "part",
    [
        "stats",
        "transform",
        "cause",
        "frame",
        "free_to_m",
        "end",
        "open_from_dm",
        "open_to_dm",
        "support_px",
        "flags",
        "cluster",
        "free",
        "place",
        "place beyond all measure",
        "more than one turn",
        "large support_px",
        *BEYOND_ALL_MEASURE,
        *DAMAGED_PRISMS,
    ],
)
def test_in_a_damaged_message_everything_is_unknown(program: Path, tmp_path: Path, part: str) -> None:
    message = over_ground(np.random.default_rng(1), (0.0, 0.0, 0.0))
    message.prisms.add(bottom_m=1.0, vertices_m=[6, 3, 6, -3], plane=[0])
    assert Message(message, clock_ns()).space.knows
    _damage(message, part)
    assert not Message(message, clock_ns()).space.knows, "as in Python"
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    p = np.random.default_rng(2).uniform([-12, -12, -4], [12, 12, 2], (500, 3))
    asked = "\n".join(f"{x} {y} {z} 0.0" for x, y, z in p)
    query = [program.parent / "query", file, "--allow-open"]
    done = subprocess.run(query, input=asked, capture_output=True, text=True, check=True)
    assert {int(answer) for answer in done.stdout.split()} == {int(Occupancy.UNKNOWN)}


@pytest.mark.parametrize("name", ["height_m", "slope_x", "tolerance_m", "noise_per_m"])
def test_space_above_a_damaged_ground_is_unknown(program: Path, tmp_path: Path, name: str) -> None:
    message = over_ground(np.random.default_rng(1), (0.0, 0.0, 0.0))
    setattr(message.ground, name, float("nan"))
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    asked = "\n".join(f"{x} 0.5 1.0 0.1" for x in range(-10, 10))
    done = subprocess.run([program.parent / "query", file], input=asked, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {str(int(Occupancy.UNKNOWN))}


@pytest.mark.parametrize("slope", [1e9, -1e9, 1e300])
def test_over_a_ground_of_any_slope_both_give_an_answer(program: Path, tmp_path: Path, slope: float) -> None:
    """Python raised OverflowError; a slope beyond all measure is of a damaged message."""
    message = over_ground(np.random.default_rng(1), (0.0, 0.0, 0.0))
    message.ground.slope_x = slope
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    p = [(0.5 * x, 0.5, z) for x in range(-20, 20) for z in (-1.0, 1.0)]
    asked = "\n".join(f"{x} {y} {z} 0.1" for x, y, z in p)
    done = subprocess.run([program.parent / "query", file], input=asked, capture_output=True, text=True, check=True)
    expected = Message(message, clock_ns(), timeout_s=1e9).space.points(p, 0.1)
    assert [int(answer) for answer in done.stdout.split()] == expected.tolist()


NAN = float("nan")


@pytest.mark.parametrize(("corners", "margin"), [((NAN, 0), 0.1), ((6, 0), NAN), ((6, 0), -1.0)])
def test_planes_that_are_not_finite_make_everything_unknown(
    program: Path, tmp_path: Path, corners: tuple[float, float], margin: float
) -> None:
    """Such a plane touches nothing: what it occupied was free as far as the profile reached."""
    message = over_ground(np.random.default_rng(1), (0.0, 0.0, 0.0))
    message.planes.corners_m[:2], message.planes.margin_m[0] = corners, margin
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    asked = "\n".join(f"{x} 0.5 1.0 0.1" for x in range(-10, 10))
    done = subprocess.run([program.parent / "query", file], input=asked, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {str(int(Occupancy.UNKNOWN))}


def test_a_negative_radius_is_occupied(program: Path, tmp_path: Path) -> None:
    file = tmp_path / "frame"
    file.write_bytes(over_ground(np.random.default_rng(1), (0.0, 0.0, 0.0)).SerializeToString())
    asked = "\n".join(f"{x} 0.5 1.0 -0.1" for x in range(-10, 10))
    done = subprocess.run([program.parent / "query", file], input=asked, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {str(int(Occupancy.OCCUPIED))}


@pytest.mark.parametrize("name", ["query", "tracks"])
def test_a_file_that_cannot_be_used_is_an_error_that_names_it(program: Path, name: str, tmp_path: Path) -> None:
    """`tracks` ignored the name of a file and waited for the keyboard; of no data it printed no track, with status 0."""
    example = program.with_name(name)
    (tmp_path / "damaged").write_bytes(b"\xff" * 40)
    (tmp_path / "empty").write_bytes(b"")
    cases = {"missing": "cannot be opened; check the path", "damaged": "not an osape.v1."}
    for file, text in (cases | {"empty": "not an osape.v1."}).items():
        done = subprocess.run([example, tmp_path / file], input="", capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr.startswith(f"{tmp_path / file}: {text}")
    done = subprocess.run([example], input="", capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("usage:")


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("query", ["--help"]),
        ("tracks", ["--help"]),
        ("subscriber", ["--help"]),
        ("query", ["FILE", "--allow-opened"]),
        ("query", ["FILE", "--allow-open", "more"]),
        ("tracks", ["FILE", "more"]),
        ("subscriber", ["ipc:///tmp/none", "3x"]),
        ("subscriber", ["ipc:///tmp/none", "many"]),
        ("subscriber", ["ipc:///tmp/none", "-1"]),
        ("subscriber", ["ipc:///tmp/none", "1", "more"]),
    ],
)
def test_an_unknown_argument_is_wrong_usage(program: Path, name: str, arguments: list[str]) -> None:
    """`query FILE --allow-opened` answered as without it, `subscriber ADDRESS many` ended at once with status 0."""
    done = subprocess.run([program.with_name(name), *arguments], input="", capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("usage:")


def test_a_query_that_is_not_four_numbers_is_an_error(program: Path, tmp_path: Path) -> None:
    file = tmp_path / "frame"
    file.write_bytes(frame().SerializeToString())
    asked = "1 0 0 0.3\n1 0 zero 0.3\n"
    done = subprocess.run([program.with_name("query"), file], input=asked, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout.count("\n") == 1
    assert "line 2: expected x y z radius" in done.stderr


def test_a_message_over_ipv6(program: Path) -> None:
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.setsockopt(zmq.IPV6, 1)
        socket.bind("tcp://[::1]:*")
        message = frame(publication=pb.Publication())
        assert "2 planes" in output_for(program, socket, message.SerializeToString())


def test_a_connection_that_failed_for_good_is_opened_again(program: Path) -> None:
    """After bytes that no service sends ZeroMQ does not connect again: the client received nothing until it was restarted."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with subprocess.Popen([program, f"tcp://127.0.0.1:{port}"], stdout=subprocess.PIPE, text=True) as process:
            try:
                answer_as_another_program(other)
                other.close()
                with zmq.Context() as context, context.socket(zmq.XPUB) as service:
                    service.bind(f"tcp://127.0.0.1:{port}")
                    assert service.poll(60_000), "it connects again"
                    service.recv()
                    service.send(frame(publication=pb.Publication(age_ns=20_000_000)).SerializeToString())
                    assert process.stdout is not None
                    assert any("2 planes" in line for line in itertools.islice(process.stdout, 60))
            finally:
                process.kill()


def test_a_message_that_is_too_large_is_not_received_and_the_next_one_is(program: Path, tmp_path: Path) -> None:
    """There was no limit: the program took as much memory as the publisher announced."""
    with zmq.Context() as context, context.socket(zmq.XPUB) as service:
        service.setsockopt(zmq.XPUB_VERBOSE, 1)
        service.bind(f"ipc://{tmp_path}/s")
        with subprocess.Popen([program, f"ipc://{tmp_path}/s"], stdout=subprocess.PIPE, text=True) as process:
            try:
                assert service.poll(60_000)
                service.recv()
                service.send(bytes(MOST_BYTES + 1))
                subscribed = [service.recv() for _ in range(2) if service.poll(60_000)]
                assert subscribed == [b"\0", b"\1"], "the connection was closed, and opened again"
                assert process.stdout is not None
                for line in itertools.islice(process.stdout, 60):  # one each 0.5 s while no message arrives
                    if "2 planes" in line:
                        break
                    # again: the program connects anew after a silence too, and a frame of that moment is lost
                    service.send(frame(publication=pb.Publication(age_ns=20_000_000)).SerializeToString())
                else:
                    pytest.fail("the frame after the large message did not arrive")
            finally:
                process.kill()


def test_tracks_of_a_frame_that_is_not_valid_say_so(program: Path, tmp_path: Path) -> None:
    file = tmp_path / "tracks"
    file.write_bytes(pb.Tracks(schema_version=1, frame="ned", left_out=3).SerializeToString())
    done = subprocess.run([program.with_name("tracks"), file], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "nothing may be taken as free: the frame of these tracks is not valid",
        "3 detected obstacles have no track",
    ]


def test_the_tracks_are_those_of_python(program: Path, tmp_path: Path) -> None:
    message = pb.Tracks(
        schema_version=1, frame="ned", valid=True, id=[7], corners_m=[5.0, 1.0, 5.0, -1.0, -2.0, 0.0], margin_m=[0.125],
        sigma_m=[0.02], confidence=[0.75], state=[pb.Tracks.STATE_DETECTED], hits=[9], age_ns=[10**9], unseen_ns=[0],
        flags=[2], object_id=[3],
    )  # fmt: skip
    message.objects.add(
        id=3,
        centre_m=pb.Vector3(x=5.0, y=0.5),
        velocity_x_m_s=1.0,
        velocity_y_m_s=-2.0,
        position_sigma_m=0.1,
        velocity_sigma_m_s=0.2,
        covariance_m2_s=0.01,
    )
    expected = tracks_from_message(message)
    (x, y, _), sigma = expected.objects[0].predicted(0.5)
    tracks = program.with_name("tracks")
    file = tmp_path / "tracks"
    file.write_bytes(message.SerializeToString())
    done = subprocess.run([tracks, file], capture_output=True, check=True)
    assert done.stdout.decode().splitlines() == [
        "track 7 a 5.000 1.000 b 5.000 -1.000 margin 0.125 confidence 0.750 state 2",
        f"moving 3 at {x:.3f} {y:.3f} sigma {sigma:.3f}",
    ]
    damages = {"flags": 1, "margin_m": NAN, "sigma_m": -1.0, "velocity_x_m_s": NAN}
    damages |= {"id": 2**63, "object_id": 2**63, "hits": 2**31}
    for field, value in damages.items():
        damaged = pb.Tracks.FromString(message.SerializeToString())
        if field == "flags":
            damaged.flags.append(1)
        elif field == "velocity_x_m_s":
            damaged.objects[0].velocity_x_m_s = value
        else:
            getattr(damaged, field)[0] = value
        with pytest.raises(ValueError, match="damaged"):
            tracks_from_message(damaged)
        file.write_bytes(damaged.SerializeToString())
        done = subprocess.run([tracks, file], capture_output=True, check=False)
        assert done.returncode == 1, field
