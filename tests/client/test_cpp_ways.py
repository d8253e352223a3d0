"""Ways of a ball in the C++ library: they answer as the balls that cover them, and are free only where the whole way is."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import zmq

from osape_client.decode import model_from_message
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import Occupancy, PlacedModel, Space

from .test_cpp_subscriber import compiled, over_ground

STEP_M = 0.1


def answers(program: Path, file: Path, lines: list[str], *arguments: str) -> list[int]:
    query: list[str | Path] = [program.parent / "query", file, *arguments]
    done = subprocess.run(query, input="\n".join(lines), capture_output=True, text=True, check=True)
    return [int(word) for word in done.stdout.split()]


def of_balls(space: Space, a: np.ndarray, b: np.ndarray, radius_m: float, allow_open: bool) -> int:
    """Occupied before unknown before open before free."""
    length_m = float(np.linalg.norm(b - a))
    steps = int(np.ceil(length_m / STEP_M))
    share = np.arange(steps + 1) / max(steps, 1)
    larger_m = 0.5 * length_m / steps if steps else 0.0
    found = set(space.points(a + share[:, None] * (b - a), radius_m + larger_m, allow_open=allow_open).tolist())
    ranking = (Occupancy.OCCUPIED, Occupancy.UNKNOWN, Occupancy.OPEN, Occupancy.FREE)
    return int(next(kind for kind in ranking if kind in found))


@pytest.mark.parametrize("allow_open", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_way_is_answered_by_balls_that_cover_it(program: Path, tmp_path: Path, seed: int, allow_open: bool) -> None:
    """From anywhere to anywhere, also from inside of an obstacle and back to the same place."""
    rng = np.random.default_rng(seed)
    camera = rng.uniform(-3.0, 3.0, 3)
    message = over_ground(rng, (float(camera[0]), float(camera[1]), float(camera[2])))
    model = model_from_message(message)
    assert model is not None
    space, radius_m = Space([PlacedModel(model, tuple(camera))]), 0.25 * seed
    a = rng.uniform([-12, -12, -4], [12, 12, 5], (600, 3)) + camera
    b = a + rng.normal(0.0, rng.choice([0.0, 0.3, 3.0], (600, 1)), (600, 3))
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    lines = [" ".join(f"{x:.17g}" for x in (*p, *q, radius_m)) for p, q in zip(a, b, strict=True)]
    found = answers(program, file, lines, *(["--allow-open"] if allow_open else []))
    expected = [of_balls(space, p, q, radius_m, allow_open) for p, q in zip(a, b, strict=True)]
    assert set(expected) == set(Occupancy) - (set() if allow_open else {Occupancy.OPEN})
    assert np.mean(np.array(found) == expected) > 0.999  # a border may round differently
    exact = space.segments(a, b, radius_m, allow_open=allow_open)
    assert all(kind == Occupancy.OCCUPIED for kind, of in zip(found, exact, strict=True) if of == Occupancy.OCCUPIED)
    share = np.linspace(0.0, 1.0, 501)[:, None]
    for p, q, kind in zip(a, b, found, strict=True):
        if kind in (Occupancy.FREE, Occupancy.OPEN):
            on_the_way = space.points(p + share * (q - p), radius_m, allow_open=kind == Occupancy.OPEN)
            assert set(on_the_way.tolist()) <= {Occupancy.FREE, kind}


def test_a_way_through_a_thin_plane_and_one_beyond_all_numbers_are_occupied(program: Path, tmp_path: Path) -> None:
    message = over_ground(np.random.default_rng(0), (0.0, 0.0, 0.0))
    message.planes.corners_m[:6] = [5.0, 0.0, 5.0, 0.01, -1.0, 1.0]
    message.planes.margin_m[0] = 0.0
    file = tmp_path / "frame"
    file.write_bytes(message.SerializeToString())
    ways = ["0 0.005 0 10 0.005 0 0", "0 0 0 1e10 0 0 0.1", "0 0 0 1 0 0 -1", "-9e8 0.005 0 9e8 0.005 0 0.1"]
    assert answers(program, file, ways) == [Occupancy.OCCUPIED] * len(ways)


def test_the_first_program_of_the_page(program: Path, tmp_path: Path) -> None:
    """It prints that nothing is free before the first message, of an invalid one and of one without the vehicle, and the way of
    another one. Of one without the vehicle it printed nothing, so that "free" stood there last."""
    page = (Path(__file__).resolve().parents[2] / "clients/cpp/README.md").read_text()
    address = f"ipc://{tmp_path}/prisms"
    text = page.split("```cpp\n")[1].split("```")[0].replace("ipc:///run/osape-companion/prisms", address)
    seen = pb.FreeProfile(azimuth_edges_rad=[-1.0, 1.0], layer_edges_m=[-2.0, 2.0], free_from_m=[0.5], end=b"\0")
    messages = [
        pb.PrismsFrame(schema_version=1, frame=frame, valid=valid, free=seen, stats=pb.FrameStats())
        for frame, valid in (("level", False), ("level", True), ("ned", True), ("level", True))
    ]
    for number, (message, to_m) in enumerate(zip(messages, (20.0, 20.0, 20.0, 5.0), strict=True)):
        message.free.free_to_m.append(to_m)
        message.transform.yaw_rad = 0.1
        message.publication.number = number
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.bind(address)
        with subprocess.Popen([compiled(program, tmp_path, text)], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            try:
                nothing = "nothing may be taken as free"
                assert process.stdout.readline() == f"{nothing}\n"
                assert socket.poll(60_000)
                for message, answer in zip(messages, (nothing, "free", nothing, "not free"), strict=True):
                    socket.send(message.SerializeToString())
                    assert answer in (line.strip() for line in process.stdout)
            finally:
                process.kill()
