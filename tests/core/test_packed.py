"""The fast encoding decodes to the same message and, encoded again by the library, to the same content."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from companion.pipeline.encode import MODEL_FIELDS
from companion.pipeline.fast_encode import encode_model
from core.stages.prism_table import prism_table
from core.types import FrameModel, FrameStats, FreeProfile, Ground, InvalidCause, Prism
from osape_client.proto import osape_v1_pb2 as pb

from .tables import some_prisms


def model(planes: int = 0, prisms: Sequence[Prism] = (), directions: int = 1, layers: int = 1) -> FrameModel:
    """With numbers of one to five bytes, clusters below zero too, and floats of both signs."""
    rng = np.random.default_rng(4)

    def floats(*shape: int) -> np.ndarray:
        return rng.normal(0.0, 100.0, shape).astype(np.float32)

    some = np.array([0, 127, 128, 16383, 16384, 2097151, 2097152, 268435456, 2147483647], np.int32)
    corners = floats(planes, 6)
    corners[:, 5] = corners[:, 4] + 1.0
    return FrameModel(
        valid=True, cause=InvalidCause.NONE, planes=corners, support_px=np.resize(some, planes), margin_m=floats(planes),
        flags=np.resize(np.arange(256, dtype=np.uint8)[::-1], planes),
        cluster=np.resize(np.append(some, [-1, -2147483648]).astype(np.int32), planes), prisms=prism_table(prisms),
        free=FreeProfile(
            azimuth_edges_rad=floats(directions + 1), layer_edges_m=floats(layers + 1), free_from_m=floats(directions, layers),
            free_to_m=floats(directions, layers), end=rng.integers(0, 5, (directions, layers)).astype(np.uint8),
        ),
        ground=Ground(seen=False), stats=FrameStats(), ke_per_m=0.005,
    )  # fmt: skip


def encoded_one_by_one(model: FrameModel) -> pb.PrismsFrame:
    free = model.free
    return pb.PrismsFrame(
        planes=pb.Planes(
            corners_m=model.planes.ravel().tolist(), margin_m=model.margin_m.tolist(), support_px=model.support_px.tolist(),
            flags=model.flags.tolist(), cluster=model.cluster.tolist(),
        ),
        prisms=[
            pb.Prism(
                cluster=p.cluster, top_m=p.top_m, bottom_m=p.bottom_m, closed=p.closed, margin_m=p.margin_m,
                vertices_m=p.vertices_m.ravel().tolist(), plane=p.plane.tolist(),
            )
            for p in model.prisms
        ],
        free=pb.FreeProfile(
            azimuth_edges_rad=free.azimuth_edges_rad.tolist(), layer_edges_m=free.layer_edges_m.tolist(),
            free_from_m=free.free_from_m.ravel().tolist(), free_to_m=free.free_to_m.ravel().tolist(), end=free.end.tobytes(),
        ),
    )  # fmt: skip


def check(frame_model: FrameModel) -> None:
    read, expected = pb.PrismsFrame.FromString(encode_model(MODEL_FIELDS, frame_model)), encoded_one_by_one(frame_model)
    assert read == expected
    assert read.SerializeToString(deterministic=True) == expected.SerializeToString(deterministic=True)


def odd_prisms() -> list[Prism]:
    """Zeros, a number below zero, numbers of one to five bytes, more vertices than a byte can count, none but one."""
    square = np.zeros((1, 2), np.float32)
    long = np.linspace(-3.0, 3.0, 600, dtype=np.float32).reshape(300, 2)
    planes = np.array([0, 127, 128, 16383, 16384, 2097152, 2147483647, -1, -2147483648], np.int32)
    return [
        Prism(cluster=0, top_m=-1.0, bottom_m=0.0, closed=False, margin_m=0.0, vertices_m=square, plane=planes[:0]),
        Prism(cluster=-1, top_m=0.0, bottom_m=1e-3, closed=True, margin_m=0.5, vertices_m=square, plane=planes[:1]),
        Prism(
            cluster=2**31 - 1,
            top_m=-2.5,
            bottom_m=-0.0,
            closed=False,
            margin_m=0.25,
            vertices_m=long,
            plane=np.resize(planes, 299),
        ),
    ]


@pytest.mark.nojit
@pytest.mark.parametrize(
    "prisms", [[], some_prisms(1), some_prisms(60), odd_prisms()], ids=["none", "one", "many", "odd"]
)
def test_prisms(prisms: list[Prism]) -> None:
    check(model(prisms=prisms))


@pytest.mark.nojit
@pytest.mark.parametrize("count", [0, 1, 9, 300])
def test_planes(count: int) -> None:
    """More of them than a byte can count, too."""
    check(model(planes=count))


@pytest.mark.nojit
@pytest.mark.parametrize(("directions", "layers"), [(1, 1), (31, 1), (32, 8), (150, 40)])
def test_free_ranges(directions: int, layers: int) -> None:
    check(model(planes=3, prisms=some_prisms(2), directions=directions, layers=layers))
