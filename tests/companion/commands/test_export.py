"""Exports of a log, read back by the libraries that people use."""

from __future__ import annotations

import csv
import json
import struct
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from companion.cli import main
from companion.export.gltf import glb, to_gltf
from companion.log.log_writer import LogWriter
from companion.pipeline.encode import prisms_from_message
from core.types import PoseSample, Prism
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import MS, START_NS, flight, write_flight


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    assert main(["replay", str(write_flight(folder / "in.mcap")), "-o", str(folder / "prisms.mcap")]) == 0
    return folder / "prisms.mcap"


@pytest.fixture(scope="module")
def results(log: Path) -> list[Any]:
    with McapRecording(log) as source:
        return [prisms_from_message(cast(pb.PrismsFrame, m.message)) for m in source.messages("prisms")]


def test_npz_holds_what_the_log_holds(log: Path, results: list[Any], tmp_path: Path) -> None:
    assert main(["export", str(log), "-f", "npz", "-o", str(tmp_path / "a.npz")]) == 0
    with np.load(tmp_path / "a.npz") as data:
        assert data["frames.sequence"].tolist() == [r.sequence for r in results]
        assert data["frames.valid"].tolist() == [r.valid for r in results]
        planes = np.concatenate([r.model.planes for r in results if r.valid])
        got = np.stack([data[f"planes.{c}_m"] for c in ("a_x", "a_y", "b_x", "b_y", "top", "bottom")], axis=1)
        np.testing.assert_array_equal(got, planes)
        first = next(r for r in results if r.valid).model.free
        cells = first.free_to_m.size
        np.testing.assert_array_equal(data["free.free_to_m"][:cells], first.free_to_m.ravel())
        vertices = sum(len(p.vertices_m) for r in results if r.valid for p in r.model.prisms)
        assert len(data["prisms.x_m"]) == vertices


def test_csv_gives_the_same_numbers(log: Path, results: list[Any], tmp_path: Path) -> None:
    assert main(["export", str(log), "-f", "csv", "-o", str(tmp_path / "out")]) == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "frames.csv",
        "free.csv",
        "planes.csv",
        "prisms.csv",
    ]
    with (tmp_path / "out" / "planes.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    planes = np.concatenate([r.model.planes for r in results if r.valid])
    assert [np.float32(row["top_m"]) for row in rows] == planes[:, 4].tolist()
    with (tmp_path / "out" / "frames.csv").open() as stream:
        frames = list(csv.DictReader(stream))
    assert [int(f["t_exposure_ns"]) for f in frames] == [r.t_exposure_ns for r in results]


def test_parquet_is_read_by_pyarrow(log: Path, results: list[Any], tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra parquet)")
    assert main(["export", str(log), "-f", "parquet", "-o", str(tmp_path / "out")]) == 0
    table = parquet.read_table(tmp_path / "out" / "frames.parquet").to_pydict()
    assert table["cause"] == [str(r.cause.value) for r in results]
    assert table["t_exposure_ns"] == [r.t_exposure_ns for r in results]


def test_without_pyarrow_the_remedy_is_named(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", str(log), "-f", "parquet", "-o", str(tmp_path / "out")]) == 1
    assert "pyarrow" in capsys.readouterr().err


def read_glb(data: bytes) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    content = json.loads(data[20 : 20 + size])
    binary = data[20 + size + 8 :]
    return content, binary


def positions(content: dict[str, Any], binary: bytes, accessor: int) -> np.ndarray:
    a = content["accessors"][accessor]
    view = content["bufferViews"][a["bufferView"]]
    return np.frombuffer(binary, "<f4", 3 * a["count"], view["byteOffset"]).reshape(-1, 3)


def test_gltf_has_north_away_and_up_upwards() -> None:
    square = np.array([[4, -1], [4, 1], [5, 1]], np.float32)
    closed = Prism(
        cluster=0, top_m=-2.0, bottom_m=1.0, closed=True, margin_m=0.1, vertices_m=square, plane=np.zeros(3, np.int32)
    )
    content, binary = read_glb(glb([closed], np.array([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0]]), "front frame 3"))
    assert [m["name"] for m in content["meshes"]] == ["obstacles of front frame 3", "trajectory"]
    corners = positions(content, binary, content["meshes"][0]["primitives"][0]["attributes"]["POSITION"])
    assert len(corners) == 12  # three edges, the last one back to the first corner
    np.testing.assert_allclose(corners[0], [-1, 2, -4])
    np.testing.assert_allclose(corners[-2], [-1, -1, -4])
    indices = content["accessors"][content["meshes"][0]["primitives"][0]["indices"]]
    assert indices["count"] == 18
    np.testing.assert_allclose(to_gltf(np.array([[1.0, 2.0, 3.0]])), [[2.0, -3.0, -1.0]])


def test_gltf_of_a_log(log: Path, results: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.glb"
    assert main(["export", str(log), "-f", "gltf", "-o", str(out)]) == 0
    content, _ = read_glb(out.read_bytes())
    best = max((r for r in results if r.valid), key=lambda r: len(r.model.planes))
    assert content["meshes"][0]["name"] == f"obstacles of front frame {best.sequence}"
    assert main(["export", str(log), "-f", "gltf", "-o", str(out), "--replace", "--frame", "9999"]) == 1
    valid = [r.sequence for r in results if r.valid]
    assert f"no valid frame 9999; the sequence numbers of valid ones lie between {min(valid)} and {max(valid)}" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("field", "value", "why"),
    [
        ("cause", 77, "cause 77 is not one of InvalidCause: was this written by a newer version?"),
        ("schema_version", 2, "prisms of schema version 2"),
        ("attitude", 9, "source 9 of a sample is unknown: was this written by a newer version?"),
        ("camera", "other", "the log does not describe its camera 'other'"),
    ],
)
@pytest.mark.parametrize("kind", ["npz", "gltf"])
def test_a_frame_of_a_newer_version_costs_itself_only(
    kind: str, field: str, value: Any, why: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One such frame refused the whole export, without the name of the log; one of another camera ended with a traceback."""
    newer, out = tmp_path / "newer.mcap", tmp_path / ("a.npz" if kind == "npz" else "a.glb")
    number = 0
    with McapRecording(log) as source, LogWriter(newer) as written:
        assert source.run is not None
        written.begin(source.run, source.cameras, t_ns=START_NS)
        for item in source.messages("prisms"):
            message = cast(pb.PrismsFrame, item.message)
            if number == 1:
                message.valid = field == "camera"
                if field == "attitude":
                    message.attitude.source = value
                else:
                    setattr(message, field, value)
                if field == "camera":
                    _double_planes(message)
            written.write("prisms", message, item.t_log_ns, item.camera, item.sequence)
            number += 1
    assert main(["export", str(newer), "-f", kind, "-o", str(out)]) == 1
    error = capsys.readouterr().err
    assert f"{newer}: 1 frame left out, the first: /camera/front/prisms, frame 1: {why}" in error
    if kind == "npz":
        with np.load(out) as data:
            assert data["frames.sequence"].tolist() == [n for n in range(number) if n != 1]
    else:
        assert out.exists()


def _double_planes(message: pb.PrismsFrame) -> None:
    """Gives the frame more planes than the others: it would be chosen."""
    message.planes.MergeFrom(pb.Planes.FromString(message.planes.SerializeToString()))


def test_gltf_of_a_frame_without_position_has_no_trajectory(tmp_path: Path) -> None:
    """Its obstacles stand around the vehicle as the origin, which is not that of the trajectory."""
    recorded, log, out = tmp_path / "in.mcap", tmp_path / "prisms.mcap", tmp_path / "a.glb"
    late = [e for e in flight(10) if not isinstance(e, PoseSample) or e.t_ns > START_NS + 500 * MS]
    assert main(["replay", str(write_flight(recorded, late)), "-o", str(log)]) == 0
    with McapRecording(log) as source:
        results = [prisms_from_message(cast(pb.PrismsFrame, m.message)) for m in source.messages("prisms")]
    placed = {r.pose is not None: r.sequence for r in results if r.valid}
    for position, meshes in ((True, 2), (False, 1)):
        frame = str(placed[position])
        assert main(["export", str(log), "-f", "gltf", "-o", str(out), "--replace", "--frame", frame]) == 0
        assert len(read_glb(out.read_bytes())[0]["meshes"]) == meshes


def test_wrong_outputs_and_logs(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = log.read_bytes()
    assert main(["export", str(log), "-f", "npz", "-o", str(log)]) == 2
    assert ".npz" in capsys.readouterr().err
    assert main(["export", str(log), "-f", "csv", "-o", str(log)]) == 1
    assert log.read_bytes() == before
    assert main(["export", str(write_flight(tmp_path / "in.mcap")), "-f", "npz", "-o", str(tmp_path / "a.npz")]) == 1
    assert "companion replay" in capsys.readouterr().err
