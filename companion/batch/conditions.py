"""What `companion find` searches for: a named condition, a filter of pyarrow, or a Parquet file of rows."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from drivers.base import DeviceNotFound

from ..usage_error import UsageError
from .dataset import check_files, open_table
from .parquet_table import arrow_module

SEARCHED: Final = ("frames", "events")
_TYPES: Final = {"vehicle": str, "flight": str, "file": int}
_OPTIONAL: Final[dict[str, Any]] = {"end_ns": int, "duration_s": int | float}


@dataclass(frozen=True, slots=True)
class Condition:
    """Rows of a table."""

    table: str
    filters: tuple[tuple[str, str, Any], ...]  # (column, operator, value), all of which hold
    doc: str


NAMED: Final[dict[str, Condition]] = {
    "blind": Condition("events", (("kind", "=", "blind"),), "frames without information"),
    "blind_while_armed": Condition(
        "events", (("kind", "=", "blind"), ("armed", "=", True)), "the same, in an armed vehicle"
    ),
    "near_pass": Condition("events", (("kind", "=", "near_pass"),), "a plane nearer than --near of `companion batch`"),
    "nearest_under_2m": Condition("frames", (("nearest_m", "<", 2.0),), "a plane nearer than 2 m"),
    "obstacle_report": Condition(
        "events", (("kind", "=", "obstacle_report"), ("distance_m", ">=", 0.0)), "an obstacle sent to the autopilot"
    ),
    "ground_lost": Condition("frames", (("valid", "=", True), ("ground_seen", "=", False)), "valid, no ground found"),
    "differs_from_onboard": Condition("frames", (("equals_onboard", "=", False),), "another result than on board"),
}


@dataclass(frozen=True, slots=True, order=True)
class Hit:
    """A time span of a log file that fulfils the condition."""

    vehicle: str
    flight: str
    file: int  # its number in the flight
    begin_ns: int
    end_ns: int


def find_hits(dataset: str, condition: str, table: str | None = None) -> list[Hit]:
    """The rows of a dataset that fulfil a condition, in order. condition: a name in NAMED, a filter as a JSON list
    [[COLUMN, OPERATOR, VALUE], ...], or the path of a Parquet file with rows of the tables. table: of a filter, one of
    SEARCHED; None: the first.

    Raises ValueError for another condition, DeviceNotFound without the table, BadData for a damaged file of it."""
    is_file, named = condition.endswith(".parquet"), NAMED.get(condition)
    if table is not None and (is_file or named is not None):
        raise UsageError(
            f"--table is for a filter [[COLUMN, OPERATOR, VALUE], ...], and {condition} is none; leave it out"
        )
    if is_file:
        return _hits(condition, _rows_of_file(Path(condition)))
    if named is not None:
        table, filters = named.table, list(named.filters)
    else:
        table, filters = table or SEARCHED[0], parsed_filters(condition)
    source = open_table(dataset, table)
    for column, _, _ in filters:
        if column not in source.schema.names:
            raise ValueError(f"{column}: the table {table} has no such column; it has {', '.join(source.schema.names)}")
    arrow, parquet = arrow_module(), arrow_module("pyarrow.parquet")
    try:
        found = source.to_table(filter=parquet.filters_to_expression(filters))
    except (ValueError, arrow.ArrowNotImplementedError, TypeError, OSError) as error:
        check_files(source, f"{dataset}/{table}")
        raise ValueError(f"{condition}: not a filter of the table {table}: {error}") from error
    except Exception:  # of the library of an address
        check_files(source, f"{dataset}/{table}")
        raise
    return _hits(f"the table {table}", found.to_pylist())


def parsed_filters(text: str) -> list[tuple[str, str, Any]]:
    """The filters of a JSON list, as pyarrow takes them. Raises UsageError."""
    try:
        content = json.loads(text)
    except ValueError:
        content = None
    if not isinstance(content, list) or not content or not all(isinstance(f, list) and len(f) == 3 for f in content):
        raise UsageError(
            f"{text}: not a condition. Give one of {', '.join(NAMED)}; a filter such as "
            '\'[["nearest_m", "<", 1.5], ["armed", "=", true]]\'; or the path of a Parquet file with rows'
        )
    return [(str(column), str(operator), value) for column, operator, value in content]


def _rows_of_file(path: Path) -> list[dict[str, Any]]:
    arrow, parquet = arrow_module(), arrow_module("pyarrow.parquet")
    try:
        rows: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    except OSError as error:
        cause = error if path.exists() else "no such file"  # the error of pyarrow is the path alone
        raise DeviceNotFound(f"{path}: cannot be read ({cause}); check the path and its permissions") from error
    except arrow.ArrowInvalid as error:
        raise ValueError(f"{path}: cannot be read ({error}); write it with DuckDB, Polars or pandas") from error
    missing = [name for name in _TYPES if rows and name not in rows[0]]
    if rows and not {"t_ns", "t_exposure_ns"} & rows[0].keys():
        missing.append("t_ns (or t_exposure_ns)")
    if missing:
        raise ValueError(f"{path}: lacks the columns {', '.join(missing)}; select them from `frames` or `events`")
    return rows


def _hits(source: str, rows: Iterable[dict[str, Any]]) -> list[Hit]:
    """The hits of rows. source: where they come from. Raises ValueError for a row with a missing value or another type."""
    hits = []
    for number, row in enumerate(rows, start=1):
        begin = "t_ns" if "t_ns" in row else "t_exposure_ns"
        wrong = [name for name, kind in (*_TYPES.items(), (begin, int)) if not isinstance(row[name], kind)]
        wrong += [name for name in _OPTIONAL if not isinstance(row.get(name), _OPTIONAL[name] | None)]
        if wrong:
            values = ", ".join(f"{name} = {row[name]!r}" for name in wrong)
            raise ValueError(
                f"{source}: row {number}: {values} cannot be used; select the columns as `companion batch` wrote them"
            )
        begin_ns, end_ns = row[begin], row.get("end_ns")
        if end_ns is None:
            end_ns = begin_ns + round(1e9 * (row.get("duration_s") or 0.0))
        hits.append(Hit(row["vehicle"], row["flight"], row["file"], begin_ns, max(begin_ns, end_ns)))
    return sorted(hits)
