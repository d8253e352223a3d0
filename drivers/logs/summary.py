"""The summary at the end of a finished MCAP file."""

from __future__ import annotations

import io
from dataclasses import dataclass

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from .chunk_search import FRAME


@dataclass(frozen=True, slots=True)
class Summary:
    """Schemas, channels, and numbers of messages by channel."""

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    counts: dict[int, int]


def summary_of(data: bytes) -> Summary:
    """Reads the records of a summary. Raises one of PARSE_ERRORS."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    counts: dict[int, int] = {}
    at = 0
    while at + FRAME.size <= len(data):
        opcode, length = FRAME.unpack_from(data, at)
        stream = ReadDataStream(io.BytesIO(data[at + FRAME.size : at + FRAME.size + length]))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            counts = dict(Statistics.read(stream).channel_message_counts)
        at += FRAME.size + length
    return Summary(schemas, channels, counts)
