"""docs/reference/messages.md covers the schema and the table of topics."""

from __future__ import annotations

import re

import pytest

from companion.log.foxglove_scene import FAR_M, LIFETIME_S, NEAR_M
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..conftest import CHECKOUT

TEXT = (CHECKOUT / "docs" / "reference" / "messages.md").read_text(encoding="utf-8")


def test_the_table_is_the_table():
    rows = [line for line in TEXT.splitlines() if line.startswith("| `/")]
    expected = [f"| `{t.name}` | `{t.schema}` | {t.rate} | {t.what} |" for t in TOPICS.values()]
    assert rows == expected


@pytest.mark.parametrize("name", sorted(set(pb.DESCRIPTOR.message_types_by_name) - {"Vector3", "Quaternion"}))
def test_every_field_is_documented(name):
    names = set(re.findall(r"`(?:\w+\.)?(\w+)`", TEXT))
    missing = [f for f in pb.DESCRIPTOR.message_types_by_name[name].fields_by_name if f not in names]
    assert missing == []


def test_every_cause_is_documented_with_its_number():
    page = (CHECKOUT / "docs" / "reference" / "diagnostics.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"^\| `(\w+)` \| (\d+) \|", page, re.MULTILINE))
    causes = {(pb.Cause.Name(n).removeprefix("CAUSE_").lower(), str(n)) for n in pb.Cause.values() if n}
    assert causes - documented == set()


def test_the_colours_are_documented():
    frames = (CHECKOUT / "docs" / "reference" / "frames.md").read_text(encoding="utf-8")
    assert f"red at {NEAR_M:g} m to blue at {FAR_M:g} m, and vanish after a second" in frames
    assert LIFETIME_S == 1
