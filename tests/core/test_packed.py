"""What is packed here is what the library reads as the same, and then writes as if it had been told one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from core.packed import packed_bytes, packed_floats, packed_prisms, packed_whole
from core.prism_table import prism_table
from core.types import Prism
from drivers.proto import osape_v1_pb2 as pb

from .tables import some_prisms

FIELD = pb.PrismsFrame.PRISMS_FIELD_NUMBER
FIELDS = tuple(
    pb.Prism.DESCRIPTOR.fields_by_name[name].number
    for name in ("cluster", "top_m", "bottom_m", "closed", "margin_m", "vertices_m", "plane")
)


def told_one_by_one(prisms: Sequence[Prism]) -> pb.PrismsFrame:
    return pb.PrismsFrame(
        prisms=[
            pb.Prism(
                cluster=p.cluster, top_m=p.top_m, bottom_m=p.bottom_m, closed=p.closed, margin_m=p.margin_m,
                vertices_m=p.vertices_m.ravel().tolist(), plane=p.plane.tolist(),
            )
            for p in prisms
        ]
    )  # fmt: skip


def odd_prisms() -> list[Prism]:
    """Zeros, a number below zero, numbers of one to five bytes, more vertices than a byte can count, none but one."""
    square = np.zeros((1, 2), np.float32)
    long = np.linspace(-3.0, 3.0, 600, dtype=np.float32).reshape(300, 2)
    planes = np.array([0, 127, 128, 16383, 16384, 2097152, 2147483647, -1, -2147483648], np.int32)
    return [
        Prism(cluster=0, top_m=-1.0, bottom_m=0.0, closed=False, margin_m=0.0, vertices_m=square, plane=planes[:0]),
        Prism(cluster=-1, top_m=0.0, bottom_m=1e-3, closed=True, margin_m=0.5, vertices_m=square, plane=planes[:1]),
        Prism(
            cluster=2**31 - 1, top_m=-2.5, bottom_m=-0.0, closed=False, margin_m=0.25, vertices_m=long,
            plane=np.resize(planes, 299),
        ),
    ]  # fmt: skip


@pytest.mark.nojit
@pytest.mark.parametrize(
    "prisms", [[], some_prisms(1), some_prisms(60), odd_prisms()], ids=["none", "one", "many", "odd"]
)
def test_prisms(prisms: list[Prism]) -> None:
    read = pb.PrismsFrame.FromString(packed_prisms(FIELD, FIELDS, prism_table(prisms)))
    expected = told_one_by_one(prisms)
    assert read == expected
    assert read.SerializeToString(deterministic=True) == expected.SerializeToString(deterministic=True)


WHOLE = (pb.Planes.SUPPORT_PX_FIELD_NUMBER, pb.Planes.FLAGS_FIELD_NUMBER, pb.Planes.CLUSTER_FIELD_NUMBER)


@pytest.mark.nojit
@pytest.mark.parametrize("count", [0, 1, 9, 300])
def test_whole_numbers_of_planes(count: int) -> None:
    """Of one to five bytes, clusters below zero too; more of them than a byte can count."""
    some = np.array([0, 127, 128, 16383, 16384, 2097151, 2097152, 268435456, 2147483647], np.int32)
    support_px, cluster = np.resize(some, count), np.resize(np.append(some, [-1, -2147483648]).astype(np.int32), count)
    flags = np.resize(np.arange(256, dtype=np.uint8)[::-1], count)
    content = packed_whole(WHOLE, support_px, flags, cluster)
    read = pb.PrismsFrame.FromString(packed_bytes(pb.PrismsFrame.PLANES_FIELD_NUMBER, content))
    expected = pb.PrismsFrame(
        planes=pb.Planes(support_px=support_px.tolist(), flags=flags.tolist(), cluster=cluster.tolist())
    )
    assert read == expected
    assert read.SerializeToString(deterministic=True) == expected.SerializeToString(deterministic=True)


@pytest.mark.parametrize("count", [0, 1, 31, 32, 5000])
def test_floats(count: int) -> None:
    values = np.random.default_rng(4).normal(0.0, 100.0, (count, 1)).astype(np.float32)
    read = pb.FreeProfile.FromString(packed_floats(pb.FreeProfile.FREE_TO_M_FIELD_NUMBER, values))
    assert read == pb.FreeProfile(free_to_m=values.ravel().tolist())
