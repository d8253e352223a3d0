"""docs/reference/messages.md and diagnostics.md state layouts, limits and causes as the code has them."""

from __future__ import annotations

import re

import numpy as np

from drivers.logs.chunk import MAX_CHUNK_BYTES
from drivers.logs.record_scanner import _FIRST_RECORDS, _MAX_RECORD_BYTES
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.world.decode import PLANE_RECORD

from ..conftest import CHECKOUT

TEXT = (CHECKOUT / "docs" / "reference" / "messages.md").read_text(encoding="utf-8")


def test_the_layout_of_the_planes_of_the_world_is_that_of_the_code() -> None:
    table = TEXT.partition("`planes`, 35 bytes each")[2].partition("\n\n| field")[0]
    cells = " ".join(re.findall(r"^\| ([^|]*int[^|]*) \|", table, re.MULTILINE))
    listed = [
        f"{sign}int{bits}"
        for count, sign, bits in re.findall(r"(?:(\d) x )?(u?)int(\d+)", cells)
        for _ in range(int(count or 1))
    ]
    fields = PLANE_RECORD.descr
    expected = [np.dtype(kind).name for _, kind, *shape in fields for _ in range(shape[0][0] if shape else 1)]
    assert listed == expected
    assert PLANE_RECORD.itemsize == 35


def test_the_limits_of_a_log_are_those_of_the_reader() -> None:
    assert f"a chunk unpacks to {MAX_CHUNK_BYTES >> 20} MiB, a record has {_MAX_RECORD_BYTES >> 20} MiB" in TEXT
    assert f"and {_FIRST_RECORDS:,} more" in TEXT


def test_every_cause_is_documented_with_its_number():
    page = (CHECKOUT / "docs" / "reference" / "diagnostics.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"^\| `(\w+)` \| (\d+) \|", page, re.MULTILINE))
    causes = {(pb.Cause.Name(n).removeprefix("CAUSE_").lower(), str(n)) for n in pb.Cause.values() if n}
    assert causes - documented == set()
