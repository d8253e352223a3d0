"""`companion recover`: writes the readable part of a damaged or unfinished MCAP file into a new file."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import Writer

from drivers.base import BadData
from drivers.logs.reader import BORROWED, LOST, open_scan
from drivers.logs.record_scanner import Damage, Item, Logged
from drivers.logs.written import seems_written

from ..common_options import add_replace
from ..console import counted, first_damages, print_json, print_line
from ..usage_error import UsageError
from .descriptions import Descriptions, lost_descriptions
from .log_file import (
    ACTIVE,
    DAMAGED,
    RECOVERED,
    RECOVERING,
    finish_file,
    open_locked,
    refuse_target,
    start_writer,
)


@dataclass(slots=True)
class RecoverResult:
    """The result of a recovery. output None: the file is complete and nothing was written."""

    output: Path | None
    messages: int = 0
    others: int = 0
    damages: list[Damage] = field(default_factory=list)


def recover(
    path: Path, output: Path | None = None, replace: bool = False, cameras_from: Path | None = None
) -> RecoverResult:
    """Writes the readable part of an MCAP file of any origin into `output` (default: `default_output`). Raises
    DriverError when nothing is readable, ValueError where the output is no file, or exists without `replace`. cameras_from: a log
    from which descriptions that the file has lost are taken."""
    target = output or default_output(path)
    if os.path.realpath(target) == os.path.realpath(path):
        raise UsageError(f"{path}: input and output are the same file; give -o another name")
    if seems_written(path):
        raise ValueError(
            f"{path}: a process is writing it, and completes it at its end; `companion replay` reads it as it is"
        )
    refuse_target(target, replace=replace)
    return copy_readable(path, target, lost_descriptions(path, cameras_from) if cameras_from is not None else None)


def default_output(path: Path) -> Path:
    """FILE.mcap for FILE.mcap.active, otherwise FILE.recovered.mcap, also for FILE.mcap.damaged."""
    if path.name.endswith(ACTIVE):
        return path.with_name(path.name.removesuffix(ACTIVE))
    return path.with_name(path.name.removesuffix(DAMAGED).removesuffix(".mcap") + RECOVERED)


def copy_readable(path: Path, target: Path, first: Descriptions | None = None) -> RecoverResult:
    """Copies message by message, and replaces the target by the copy when it contains a message and the original is
    damaged, or the copy has more. first: to begin with; the copy states where they are from. Raises as `recover`, and FileInUseError where another process
    makes this copy."""
    result = RecoverResult(target)
    scan = open_scan(path)
    active = target.with_name(target.name + ACTIVE + RECOVERING)
    stream = None
    try:
        stream = open_locked(active, replace=True)
        writer = start_writer(stream)
        if first is not None:
            _begin_with(writer, first)
        copy = _Copy(writer)
        for item in scan.items():
            copy.take(item, result)
        if result.messages == 0:
            cause = f" (byte {result.damages[0].offset}: {result.damages[0].cause})" if result.damages else ""
            raise BadData(f"{path}: no message is readable{cause}; nothing was written. Use another copy of the file")
        if result.damages or first is not None:
            finish_file(writer, stream, active, target)
        else:
            result.output = None
    finally:
        scan.close()
        if stream is not None and not stream.closed:
            active.unlink(missing_ok=True)  # before the lock ends: it is the copy of this process
            stream.close()
    return result


def _begin_with(writer: Any, first: Descriptions) -> None:
    writer.add_metadata(BORROWED, first.origins)
    copy = _Copy(writer)
    for message in first.messages:
        copy.take(message, RecoverResult(None))


class _Copy:
    """Writes channels and schemas when first used, under new numbers."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channels: dict[int, int] = {}
        self._schemas: dict[int, int] = {}

    def take(self, item: Item, result: RecoverResult) -> None:
        """Copies one item, or notes a damage."""
        if isinstance(item, Damage):
            result.damages.append(item)
            if not item.end:
                writer: Any = self._writer
                writer.add_metadata(LOST, {str(item.offset): item.cause})
        elif isinstance(item, Logged):
            m = item.message
            channel = self._channel(item.channel, item.schema)
            self._writer.add_message(channel, m.log_time, m.data, m.publish_time, m.sequence)
            result.messages += 1
        else:
            self._other(item)
            result.others += 1

    def _other(self, item: Attachment | Metadata) -> None:
        writer: Any = self._writer
        if isinstance(item, Metadata):
            writer.add_metadata(item.name, item.metadata)
        else:
            writer.add_attachment(item.create_time, item.log_time, item.name, item.media_type, item.data)

    def _channel(self, channel: Channel, schema: Schema | None) -> int:
        if channel.id not in self._channels:
            schema_id = self._schema(schema) if schema is not None else 0
            self._channels[channel.id] = self._writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
        return self._channels[channel.id]

    def _schema(self, schema: Schema) -> int:
        if schema.id not in self._schemas:
            writer: Any = self._writer
            self._schemas[schema.id] = int(writer.register_schema(schema.name, schema.encoding, schema.data))
        return self._schemas[schema.id]


def add_parser(subparsers: Any) -> None:
    """The command line of `companion recover`."""
    parser = subparsers.add_parser("recover")
    parser.add_argument("input", type=Path, metavar="FILE", help="an MCAP file of any origin; it is not changed")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="OUT.mcap",
        help="the complete log (default: FILE.recovered.mcap, or FILE.mcap for FILE.mcap.active)",
    )
    add_replace(parser)
    parser.add_argument(
        "--cameras-from",
        type=Path,
        metavar="LOG.mcap",
        help="take the description of the cameras and the configuration, which FILE has lost, from this log of the same vehicle and set-up",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: recovered, or nothing to recover."""
    result = recover(args.input, args.output, args.replace, args.cameras_from)
    if args.json:
        print_json(
            {
                "input": str(args.input),
                "output": str(result.output) if result.output else None,
                "messages": result.messages,
                "damage": [{"offset": d.offset, "cause": d.cause} for d in result.damages],
            }
        )
        return 0
    if result.output is None:
        print_line(
            f"{args.input} is complete ({counted(result.messages, 'message')}): nothing to recover, nothing written"
        )
        return 0
    for text in first_damages([f"damaged at byte {damage.offset}: {damage.cause}" for damage in result.damages]):
        print_line(text)
    print_line(f"{counted(result.messages, 'message')} recovered: {result.output}")
    return 0
