"""Converts messages to JSON objects with enum values as codes."""

from __future__ import annotations

from typing import Any

from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message


def message_json(message: Message) -> dict[str, Any]:
    """All fields by their names in the schema, including those with default values. Enum values are codes:
    `STATE_ACTIVE` of an enum `State` becomes "active"; a number that this version does not know stays a number. Fields
    `..._enum` are left out, since they repeat a code that another field holds as a string."""
    found: dict[str, Any] = MessageToDict(
        message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )
    return _coded(message, found)


def _coded(message: Message, found: dict[str, Any]) -> dict[str, Any]:
    for field in message.DESCRIPTOR.fields:
        name = field.name
        if name not in found:
            continue
        if name.endswith("_enum"):
            del found[name]
        elif field.enum_type is not None:
            found[name] = _code(field.enum_type.name, found[name])
        elif field.message_type is not None and not field.message_type.GetOptions().map_entry:
            value = getattr(message, name)
            if isinstance(found[name], list):
                found[name] = [_coded(m, f) for m, f in zip(value, found[name], strict=True)]
            else:
                found[name] = _coded(value, found[name])
    return found


def _code(enum: str, value: str | int) -> str | int:
    return value.removeprefix(f"{enum.upper()}_").lower() if isinstance(value, str) else value
