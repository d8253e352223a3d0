"""docs/reference/messages.md and diagnostics.md state layouts, limits and causes as the code has them."""

from __future__ import annotations

import re

import numpy as np

from companion.config.service import STREAMS, WORLD_STREAMS, PublishConfig
from companion.live.depth_preview import MOST_WAITING
from companion.live.world_thread import CHANGES_NS
from companion.share.sharing_thread import NS, PUBLISH_NS, SOON_NS
from drivers.logs.chunk import MAX_CHUNK_BYTES
from drivers.logs.chunk_search import MAX_RECORD_BYTES
from drivers.logs.record_scanner import _FIRST_RECORDS
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.world.decode import PLANE_RECORD

from ...conftest import CHECKOUT

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


def test_the_streams_are_those_of_the_configuration() -> None:
    rows = re.findall(r"^\| ([\w, ]+) \| (`ipc://\S+`|off) \| \[`(\w+)`\]", TEXT, re.MULTILINE)
    listed = {name.strip().replace(" ", "_"): at.strip("`") for names, at, _ in rows for name in names.split(",")}
    publish = PublishConfig()
    names = (*STREAMS, *WORLD_STREAMS, "neighbours", "depth")
    assert listed == {name: getattr(publish, name) or "off" for name in names}
    assert f"{NS // CHANGES_NS} Hz; answer to each request" in TEXT
    assert f"{NS // PUBLISH_NS} Hz, up to {NS // SOON_NS} Hz while packets arrive" in TEXT
    assert f"of world and {MOST_WAITING} of depth wait" in TEXT


def test_the_limits_of_a_log_are_those_of_the_reader() -> None:
    assert f"a chunk unpacks to {MAX_CHUNK_BYTES >> 20} MiB, a record has {MAX_RECORD_BYTES >> 20} MiB" in TEXT
    assert f"and {_FIRST_RECORDS:,} more" in TEXT


def test_every_cause_is_documented_with_its_number():
    page = (CHECKOUT / "docs" / "reference" / "diagnostics.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"^\| `(\w+)` \| (\d+) \|", page, re.MULTILINE))
    causes = {(pb.Cause.Name(n).removeprefix("CAUSE_").lower(), str(n)) for n in pb.Cause.values() if n}
    assert causes - documented == set()
