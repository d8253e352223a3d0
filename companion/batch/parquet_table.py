"""Writes rows as Parquet, some thousand at a time, so that memory does not grow with the length of a flight."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from drivers.optional_library import optional_module

from .schema import SCHEMA_VERSION, TABLES

ROWS: Final = 4096
"""Rows of a row group."""


def arrow_module(name: str = "pyarrow") -> Any:
    """A module of pyarrow. Raises DeviceNotFound where it is not installed."""
    return optional_module(name, "tables need pyarrow", "pyarrow>=16")


def arrow_schema(table: str) -> Any:
    """The pyarrow schema of a table, with the schema version in its metadata."""
    arrow = arrow_module()
    kinds = {
        "string": arrow.string(),
        "strings": arrow.list_(arrow.string()),
        "bool": arrow.bool_(),
        "int32": arrow.int32(),
        "int64": arrow.int64(),
        "float": arrow.float32(),
        "double": arrow.float64(),
    }
    metadata = {"osape_batch_schema": str(SCHEMA_VERSION)}
    return arrow.schema([(column.name, kinds[column.kind]) for column in TABLES[table]], metadata=metadata)


class TableFile:
    """A Parquet file being written. Rows are mappings from column to value; a missing column is null."""

    def __init__(self, table: str, path: Path) -> None:
        self.rows = 0
        self._schema = arrow_schema(table)
        self._arrow = arrow_module()
        self._writer = arrow_module("pyarrow.parquet").ParquetWriter(path, self._schema, compression="zstd")
        self._waiting: list[Mapping[str, Any]] = []

    def add(self, row: Mapping[str, Any]) -> None:
        """Adds a row. Raises OSError where the disk is full."""
        self._waiting.append(row)
        self.rows += 1
        if len(self._waiting) >= ROWS:
            self._write()

    def close(self) -> None:
        """Writes the rest and the end of the file."""
        if self._waiting:
            self._write()
        self._writer.close()

    def discard(self) -> None:
        """Closes a file that is not needed. Does nothing after `close`."""
        with suppress(OSError, ValueError):  # after a failed write it fails again, with another cause
            self._writer.close()

    def _write(self) -> None:
        self._writer.write_table(self._arrow.Table.from_pylist(self._waiting, schema=self._schema))
        self._waiting.clear()
