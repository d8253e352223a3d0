"""The tables of docs/reference that are made from the code: `make reference-tables`.

A page marks the place of a table with `<!-- KIND NAMES: made by make reference-tables -->` and `<!-- end -->`; what stands
between these lines is replaced. KINDS lists the kinds."""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Final

from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

from companion.batch.conditions import NAMED
from companion.batch.schema import TABLES
from companion.cli import parser_of
from companion.command_list import GROUPS
from core.codes import Code
from core.sharing.alignment import FitResult
from core.sharing.obstacles import PlacementState
from drivers.logs.topics import TOPICS

from ..conftest import CHECKOUT
from . import configuration_tables, diagnostic_tables

PAGES: Final = tuple(
    CHECKOUT / "docs" / "reference" / f"{name}.md"
    for name in ("messages", "batch", "commands", "sharing", "configuration", "diagnostics")
)
PROTO: Final = CHECKOUT / "clients" / "python" / "osape_client" / "proto" / "osape_v1.proto"
BLOCK: Final = re.compile(r"(<!-- (\w+) ?([^:\n]*): made by `make reference-tables` -->\n).*?(<!-- end -->)", re.DOTALL)
CODES: Final[dict[str, type[Code]]] = {kind.__name__: kind for kind in (PlacementState, FitResult)}
SCALARS: Final = {
    number: name.removeprefix("TYPE_").lower()
    for name, number in FieldDescriptorProto.Type.items()
    if number not in (FieldDescriptorProto.TYPE_MESSAGE, FieldDescriptorProto.TYPE_ENUM)
}


class Schema:
    """The message schema with its comments, as the compiler of protobuf reads it."""

    def __init__(self) -> None:
        from grpc_tools import protoc  # of the environment of development

        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "schema"
            arguments = ["protoc", f"-I{PROTO.parent}", "--include_source_info", f"--descriptor_set_out={output}"]
            if protoc.main([*arguments, PROTO.name]) != 0:
                raise ValueError(f"{PROTO}: the compiler refuses it, see its message")
            self.file: FileDescriptorProto = FileDescriptorSet.FromString(output.read_bytes()).file[0]
        self._comments = {
            tuple(at.path): " ".join((at.leading_comments or at.trailing_comments).split())
            for at in self.file.source_code_info.location
        }

    def message(self, name: str) -> tuple[str, DescriptorProto, tuple[int, ...]]:
        """(comment, descriptor, path of the descriptor in the file) of a message."""
        (index,) = (i for i, m in enumerate(self.file.message_type) if m.name == name)
        path = (FileDescriptorProto.MESSAGE_TYPE_FIELD_NUMBER, index)
        return self._comments[path], self.file.message_type[index], path

    def fields(self, name: str) -> Iterator[tuple[str, str, str]]:
        """(name, type, comment) of each field of a message."""
        _, message, path = self.message(name)
        for i, f in enumerate(message.field):
            yield f.name, _type_of(f, message), self._comments[*path, DescriptorProto.FIELD_FIELD_NUMBER, i]

    def values(self, name: str) -> Iterator[tuple[str, int, str]]:
        """(code, number, comment) of each value but 0 of an enum in a message, such as Tracks.State."""
        outer, _, inner = name.partition(".")
        _, message, path = self.message(outer)
        (k,) = (k for k, e in enumerate(message.enum_type) if e.name == inner)
        for i, v in enumerate(message.enum_type[k].value):
            comment = self._comments[*path, DescriptorProto.ENUM_TYPE_FIELD_NUMBER, k, 2, i]
            if v.number:
                yield v.name.removeprefix(f"{inner.upper()}_").lower(), v.number, comment


@cache
def schema() -> Schema:
    """The message schema, read once."""
    return Schema()


def _type_of(f: FieldDescriptorProto, message: DescriptorProto) -> str:
    """The type of a field as the schema writes it."""
    for entry in message.nested_type:
        if entry.options.map_entry and f.type_name.endswith(f".{message.name}.{entry.name}"):
            return f"map<{', '.join(_type_of(part, message) for part in entry.field)}>"
    name = SCALARS.get(f.type) or f.type_name.removeprefix(".osape.v1.").removeprefix(f"{message.name}.")
    return f"repeated {name}" if f.label == f.LABEL_REPEATED else f"optional {name}" if f.proto3_optional else name


def _cell(text: str) -> str:
    """A text as the content of a cell, with links to the pages that it names."""

    def link(match: re.Match[str]) -> str:
        folder = "" if match[1] == "reference" else f"../{match[1]}/"
        return f"[{match[2].replace('-', ' ')}]({folder}{match[2]}.md{match[3] or ''})"

    return re.sub(r"docs/([\w-]+)/([\w-]+)\.md(#[\w-]+)?", link, text).replace("|", "\\|")


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|", *(f"| {' | '.join(row)} |" for row in rows)]
    return "\n".join(line.replace("|  |", "| |") for line in lines)


def fields(names: str) -> str:
    """The fields of a message. Fields in sequence that have the same type and comment share a row."""
    rows: list[tuple[str, ...]] = []
    for field, kind, comment in schema().fields(names):
        if rows and rows[-1][1:] == (f"`{kind}`", _cell(comment)):
            rows[-1] = (f"{rows[-1][0]}, `{field}`", *rows[-1][1:])
        else:
            rows.append((f"`{field}`", f"`{kind}`", _cell(comment)))
    return _table(("field", "type", "content"), rows)


def messages(names: str) -> str:
    """Heading, comment and fields of each message."""
    return "\n\n".join(f"### {name}\n\n{_cell(schema().message(name)[0])}\n\n{fields(name)}" for name in names.split())


def enum(names: str) -> str:
    """The values of an enum."""
    return _table(
        ("code", "number", "meaning"), [(f"`{code}`", str(n), text) for code, n, text in schema().values(names)]
    )


def codes(names: str) -> str:
    """The codes of a class of CODES."""
    return _table(("code", "meaning"), [(f"`{code}`", _cell(code.text)) for code in CODES[names]])


def topics(_names: str) -> str:
    """The topics of a log."""
    rows = [(f"`{t.name}`", f"`{t.schema}`", t.rate, t.what) for t in TOPICS.values()]
    return _table(("topic", "schema", "rate", "content"), rows)


def columns(names: str) -> str:
    """The columns of a table of `companion batch`."""
    return _table(("column", "type", "meaning"), [(f"`{c.name}`", c.kind, _cell(c.doc)) for c in TABLES[names]])


def conditions(_names: str) -> str:
    """The named conditions of `companion find`."""
    rows = [(f"`{n}`", c.table, f"`{json.dumps([list(f) for f in c.filters])}`", c.doc) for n, c in NAMED.items()]
    return _table(("name", "table", "filter", "rows"), rows)


def commands(names: str) -> str:
    """The commands of a group: what is required, purpose, options but --help and --json."""
    return _table(
        ("command", "purpose", "options"),
        [(f"`{_cell(usage)}`", _cell(purpose), _cell(options)) for usage, purpose, options in _commands(names)],
    )


def _commands(group: str) -> Iterator[tuple[str, str, str]]:
    for name, command in GROUPS[group].items():
        (choice,) = (a for a in parser_of(name)._actions if a.dest == "command")
        assert isinstance(choice.choices, dict)
        parser = choice.choices[name]
        assert isinstance(parser, argparse.ArgumentParser)
        usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
        options = re.findall(r"\[(-(?:[^\[\]]|\[[^\]]*\])*)\]", usage)
        for option in options:
            usage = usage.replace(f" [{option}]", "")
        yield usage, command.purpose, ", ".join(f"`{o}`" for o in options if o not in ("-h", "--json"))


def settings(_names: str) -> str:
    """The keys of all sections of a configuration."""
    return configuration_tables.settings()


def diagnostics(_names: str) -> str:
    """The diagnostics, by group."""
    head = ("code", "meaning", "likely cause, remedy")
    groups = {group: list(diagnostic_tables.diagnostics(group)) for group in diagnostic_tables.REMEDIES}
    return "\n\n".join(f"### {group}\n\n{_table(head, rows)}" for group, rows in groups.items())


def causes(_names: str) -> str:
    """The causes of an invalid frame."""
    return _table(("code", "number", "meaning"), list(diagnostic_tables.causes()))


def offsets(_names: str) -> str:
    """The states of a measured exposure time offset."""
    return _table(("code", "number", "meaning"), list(diagnostic_tables.offsets()))


def anomalies(_names: str) -> str:
    """The anomalies of the link to the autopilot."""
    return _table(("code", "counts"), list(diagnostic_tables.anomalies()))


def metrics(_names: str) -> str:
    """The metrics for Prometheus."""
    return _table(("metric (prefix `osape_`)", "labels", "meaning"), list(diagnostic_tables.metrics()))


_KINDS = (fields, messages, enum, codes, topics, columns, conditions, commands, settings)
_DIAGNOSTICS = (diagnostics, causes, offsets, anomalies, metrics)
KINDS: Final[dict[str, Callable[[str], str]]] = {kind.__name__: kind for kind in (*_KINDS, *_DIAGNOSTICS)}


def with_tables(page: str) -> str:
    """A page with new tables between its marks."""
    return BLOCK.sub(lambda m: f"{m[1]}\n{KINDS[m[2]](m[3])}\n\n{m[4]}", page)


def words_by_hand(page: str) -> int:
    """Number of words of a page without its tables that are made from the code."""
    return len(BLOCK.sub("", page).split())


if __name__ == "__main__":
    for place in PAGES:
        place.write_text(with_tables(place.read_text(encoding="utf-8")), encoding="utf-8")
        sys.stdout.write(f"{place}: {words_by_hand(place.read_text(encoding='utf-8'))} words beside the tables\n")
