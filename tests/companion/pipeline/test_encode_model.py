"""A model that is encoded and decoded is the same model, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pytest

from companion.pipeline.decode_model import model_from_message
from companion.pipeline.encode_model import set_model
from core.stages.prism_table import prism_table
from core.types import FrameModel, FrameStats, FreeProfile, Ground, InvalidCause, Prism
from osape_client.proto import osape_v1_pb2 as pb
from tests.core.tables import some_prisms


def model(planes: int = 0, prisms: Sequence[Prism] = (), directions: int = 1, layers: int = 1) -> FrameModel:
    """With numbers of one to five bytes, clusters below zero too, and floats of both signs."""
    rng = np.random.default_rng(4)

    def floats(*shape: int) -> np.ndarray:
        return rng.normal(0.0, 100.0, shape).astype(np.float32)

    some = np.array([0, 127, 128, 16383, 16384, 2097151, 2097152, 268435456, 2147483647], np.int32)
    corners = floats(planes, 6)
    corners[:, 5] = corners[:, 4] + 1.0
    return FrameModel(
        valid=True,
        cause=InvalidCause.NONE,
        planes=corners,
        support_px=np.resize(some, planes),
        margin_m=np.abs(floats(planes)),
        flags=np.resize(np.arange(256, dtype=np.uint8)[::-1], planes),
        cluster=np.resize(np.append(some, [-1, -2147483648]).astype(np.int32), planes),
        prisms=prism_table(prisms),
        free=FreeProfile(
            azimuth_edges_rad=np.sort(rng.uniform(-3.0, 3.0, directions + 1)).astype(np.float32),
            layer_edges_m=np.sort(floats(layers + 1)),
            free_from_m=floats(directions, layers),
            free_to_m=floats(directions, layers),
            end=rng.integers(0, 5, (directions, layers)).astype(np.uint8),
        ),
        ground=Ground(seen=False),
        stats=FrameStats(flying_px=7, planes=planes),
        ke_per_m=0.00390625,
    )


def check(frame_model: FrameModel) -> None:
    message = pb.PrismsFrame(valid=True)
    set_model(message, frame_model)
    read = model_from_message(pb.PrismsFrame.FromString(message.SerializeToString()))
    assert read is not None
    for name in ("planes", "margin_m", "support_px", "flags", "cluster"):
        np.testing.assert_array_equal(getattr(read, name), getattr(frame_model, name))
    for name in ("azimuth_edges_rad", "layer_edges_m", "free_from_m", "free_to_m", "end"):
        np.testing.assert_array_equal(getattr(read.free, name), getattr(frame_model.free, name))
    assert len(read.prisms) == len(frame_model.prisms)
    for decoded, sent in zip(read.prisms, frame_model.prisms, strict=True):
        for field in fields(Prism):
            np.testing.assert_array_equal(getattr(decoded, field.name), getattr(sent, field.name))
    for field in fields(Ground):
        np.testing.assert_array_equal(getattr(read.ground, field.name), getattr(frame_model.ground, field.name))
    assert (read.stats, read.ke_per_m) == (frame_model.stats, frame_model.ke_per_m)


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


@pytest.mark.parametrize(
    "prisms", [[], some_prisms(1), some_prisms(60), odd_prisms()], ids=["none", "one", "many", "odd"]
)
def test_prisms(prisms: list[Prism]) -> None:
    check(model(prisms=prisms))


@pytest.mark.parametrize("count", [0, 1, 9, 300])
def test_planes(count: int) -> None:
    """More of them than a byte can count, too."""
    check(model(planes=count))


@pytest.mark.parametrize(("directions", "layers"), [(1, 1), (31, 1), (32, 8), (150, 40)])
def test_free_ranges(directions: int, layers: int) -> None:
    check(model(planes=3, prisms=some_prisms(2), directions=directions, layers=layers))
