"""The tables of docs/reference that are made from the code are those of the code."""

from __future__ import annotations

from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto

from companion.command_list import GROUPS
from osape_client.proto import osape_v1_pb2 as pb

from ..reference_tables import BLOCK, PAGES, PROTO, Schema, schema, with_tables

REPLAY_ONLY = {"StateSnapshot", "CameraState", "MountState", "HeadingState", "PositionState", "TrackerState"}
"""Messages that only a replay reads: their fields are described in the schema alone."""
MARK = ": made by `make reference-tables` -->"


@pytest.fixture(autouse=True)
def _compiler() -> None:
    pytest.importorskip("grpc_tools", reason="the extra `dev` is not installed")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_tables_are_those_of_the_code(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(BLOCK.findall(text)) == text.count(MARK) == text.count("<!-- end -->")
    assert text == with_tables(text), "run `make reference-tables`"


def test_another_table_is_found() -> None:
    page = f"Text.\n\n<!-- enum Tracks.State{MARK}\n\n| `new` | 7 |\n\n<!-- end -->\n\nMore.\n"
    assert "| `new` | 1 | detected in this frame, in fewer" in with_tables(page)
    assert with_tables(with_tables(page)) == with_tables(page) != page
    assert with_tables(page).startswith("Text.\n")
    assert with_tables(page).endswith("<!-- end -->\n\nMore.\n")


def test_every_message_has_a_table() -> None:
    page = PAGES[0].read_text(encoding="utf-8")
    shown = {
        name for _, kind, names, _ in BLOCK.findall(page) if kind in ("fields", "messages") for name in names.split()
    }
    expected = set(pb.DESCRIPTOR.message_types_by_name) - REPLAY_ONLY - {"Vector3", "Quaternion"}
    assert shown == expected


def test_every_group_of_commands_has_a_table() -> None:
    page = PAGES[2].read_text(encoding="utf-8")
    assert [names for _, kind, names, _ in BLOCK.findall(page) if kind == "commands"] == list(GROUPS)


def test_every_message_has_a_comment() -> None:
    names = set(pb.DESCRIPTOR.message_types_by_name) - {"Vector3", "Quaternion"}
    assert [name for name in names if not schema().message(name)[0]] == []


def test_the_python_code_is_that_of_the_schema() -> None:
    compiled, written = FileDescriptorProto(), Schema().file
    pb.DESCRIPTOR.CopyToProto(compiled)
    written.ClearField("source_code_info")
    for message in written.message_type:
        _without_json_names(message)
    assert compiled == written, f"{PROTO.name} has changed: run `make proto`"


def _without_json_names(message: DescriptorProto) -> None:
    """Removes what the compiler adds to a file of descriptors and not to Python code."""
    for field in message.field:
        field.ClearField("json_name")
    for inner in message.nested_type:
        _without_json_names(inner)
