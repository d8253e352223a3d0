"""The messages of a ROS 2 recording: one MCAP file, or a bag (folder with metadata.yaml, .db3), read by rosbags.

MCAP files are read by this software's own scanner, which keeps what is readable of a damaged file. A folder of MCAP files is
read in the order of their names."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol

from drivers.base import BadData
from drivers.logs.reader import open_scan
from drivers.logs.record_scanner import Damage, Logged
from drivers.optional_library import optional_module

from .report import Report
from .ros2_decode import DECODE_ERRORS, Ros2Decoder, complete, type_of
from .ros2_px4 import DEFINITIONS

METADATA: Final = "metadata.yaml"
BAG_SUFFIXES: Final = (".db3", ".mcap")
_SQLITE: Final = b"SQLite format 3\0"
"""The first bytes of a database."""


@dataclass(frozen=True, slots=True, eq=False)
class RosItem:
    """One message, not yet decoded."""

    topic: str
    kind: str  # type without `msg/`
    log_ns: int
    decode: Callable[[], Any]  # gives the message, None where it does not fit its definition


class RosRecording(Protocol):
    """A recording that can be read several times."""

    def items(self) -> Iterator[RosItem]:
        """All messages in the order of the recording."""
        ...


def is_bag(path: Path) -> bool:
    """Whether a folder is a ROS 2 bag; a log of this software may lie beside frames.csv."""
    if (path / "frames.csv").exists():
        return False
    return (path / METADATA).is_file() or any(f.suffix in BAG_SUFFIXES for f in path.iterdir())


def open_ros(path: Path, report: Report) -> RosRecording:
    """The reader of a file or folder. Raises DriverError."""
    if path.is_dir():
        mcaps = sorted(path.glob("*.mcap"), key=_natural)
        if mcaps:
            return McapFiles(mcaps, report)
        if (path / METADATA).is_file():
            return RosBag([path])
        return RosBag(sorted(path.glob("*.db3"), key=_natural))
    return RosBag([path]) if path.suffix.lower() == ".db3" else McapFiles([path], report)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorts flight_2 before flight_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


class McapFiles:
    """MCAP files, one after the other; damage is reported once."""

    def __init__(self, paths: list[Path], report: Report) -> None:
        self._paths, self._report = paths, report
        self._reported: set[str] = set()

    def items(self) -> Iterator[RosItem]:
        """All messages in file order."""
        for path in self._paths:
            scan, decode = open_scan(path), Ros2Decoder()
            try:
                for item in scan.items():
                    if isinstance(item, Damage):
                        text = f"{path}: {item.cause} (byte {item.offset}); the rest was read"
                        if text not in self._reported:
                            self._reported.add(text)
                            self._report.problem("damage", text)
                    elif isinstance(item, Logged) and item.schema is not None:
                        kind, log_ns = type_of(item.schema.name), item.message.log_time
                        yield RosItem(item.channel.topic, kind, log_ns, partial(decode, item))
            finally:
                scan.close()


class RosBag:
    """A bag read by rosbags (extra `recordings`). Raises DeviceNotFound without it, BadData for an unreadable bag.

    Bags that contain no definitions (ROS 2 before Iron) are read with those of ROS 2 Humble and PX4."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = paths
        need = f"{paths[0]}: ROS 2 bags need rosbags", "rosbags>=0.11"
        self._highlevel, self._typesys = (
            optional_module(name, *need, otherwise=", or convert the bag to MCAP (ros2 bag convert)")
            for name in ("rosbags.highlevel", "rosbags.typesys")
        )

    def items(self) -> Iterator[RosItem]:
        """All messages in the order of their log times."""
        store = self._typesys.get_typestore(self._typesys.Stores.ROS2_HUMBLE)
        for name, text in DEFINITIONS.items():
            store.register(self._typesys.get_types_from_msg(text, name))
        try:
            with self._highlevel.AnyReader(self._paths, default_typestore=store) as reader:
                for connection, log_ns, data in reader.messages():
                    if not isinstance(log_ns, int):  # a field of SQLite can hold any type
                        raise sqlite3.DatabaseError(f"{log_ns!r} is no log time")
                    yield self._item(reader, connection, log_ns, data)
        except (self._highlevel.AnyReaderError, OSError, *_database_errors(), *DECODE_ERRORS) as error:
            cause = " ".join(str(error).split()) or type(error).__name__
            raise BadData(f"{self._paths[0]}: not a readable ROS 2 bag ({cause}); {_remedy(self._paths[0])}") from error

    def _item(self, reader: Any, connection: Any, log_ns: int, data: bytes) -> RosItem:
        kind = type_of(connection.msgtype)

        def decode() -> Any:
            try:
                message = reader.deserialize(data, connection.msgtype)
                return message if complete(kind, message) else None
            except (self._highlevel.AnyReaderError, *DECODE_ERRORS):
                return None

        return RosItem(connection.topic, kind, log_ns, decode)


def _database_errors() -> tuple[type[Exception], ...]:
    """Errors of a damaged database: rosbags reads it with sqlite3 before version 0.11.1, with apsw since then."""
    errors: list[type[Exception]] = [sqlite3.Error]
    with suppress(ImportError):
        errors.append(import_module("apsw").Error)
    return tuple(errors)


def _remedy(path: Path) -> str:
    """What to do about an unreadable bag. path: of its directory, or of its first database."""
    if path.is_dir():
        return (
            f"if its {METADATA} is damaged, or names a file that is missing, move {METADATA} to another place: the "
            "databases are then read without it. Otherwise convert the bag to MCAP where it was recorded "
            "(`ros2 bag convert`)"
        )
    with path.open("rb") as stream:
        if stream.read(len(_SQLITE)) != _SQLITE:
            return (
                "it is not a database of SQLite: give a .db3 file that `ros2 bag record` wrote, or another copy of it"
            )
    return "it is damaged, or not the database of a bag: use another copy, or the database of another bag"
