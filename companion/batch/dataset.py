"""The files of a dataset: OUT/TABLE/vehicle=V/date=D/FLIGHT.parquet.

The file of the table `flights` is published last: a flight with it is complete. A file is written beside the dataset
and renamed, so a killed worker leaves at most files that the next run replaces."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Final

from drivers.base import BadData, DeviceNotFound

from ..whole_file import write_whole
from .flights import Flight
from .parquet_table import arrow_module
from .schema import SCHEMA_VERSION, TABLES
from .storage import LOGS, UNFINISHED, file_system, is_url, publish, reaching

LAST: Final = "flights"
"""The table whose file marks a flight as complete."""
RUN_FILE: Final = "batch.json"


def temporary_folder(output: str, flight: Flight) -> Path:
    """A new folder for the files of a flight, on the file system of a local output."""
    if is_url(output):
        return Path(tempfile.mkdtemp(prefix="osape-batch-"))
    parent = Path(output) / UNFINISHED
    parent.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=f"{flight.vehicle}-{flight.name}-", dir=parent))


def publish_flight(output: str, flight: Flight, folder: Path) -> None:
    """Moves the files of a flight into the dataset, that of `flights` last."""
    for log in sorted(folder.glob("*.mcap")):
        _publish(log, f"{output}/{LOGS}/{flight.partition}", log.name)
    for table in sorted(TABLES, key=lambda name: name == LAST):
        file = folder / f"{table}.parquet"
        if file.exists():
            _publish(file, f"{output}/{table}/{flight.partition}", f"{flight.name}.parquet")


def _publish(file: Path, parent: str, name: str) -> None:
    if not is_url(parent):
        Path(parent).mkdir(parents=True, exist_ok=True)
    publish(file, f"{parent}/{name}")


def begin_run(output: str, run: dict[str, Any]) -> None:
    """Notes in batch.json how the results are made, and deletes unfinished files of an earlier run. Raises ValueError
    where the output holds results that were made otherwise: they would be mixed."""
    text = json.dumps({"schema_version": SCHEMA_VERSION, **run}, indent=1, sort_keys=True)
    before = _read_text(f"{output}/{RUN_FILE}")
    if before is None:
        _write_run(output, text)
    elif before != text:
        was, now = _run_of_text(before, f"{output}/{RUN_FILE}"), json.loads(text)
        changed = [
            f"{k}: {was.get(k)} before, {now.get(k)} now"
            for k in sorted(was.keys() | now.keys())
            if was.get(k) != now.get(k)
        ]
        raise ValueError(
            f"{output}: holds results of other settings or versions ({'; '.join(changed)}); give -o another folder, or delete it"
        )
    delete_unfinished(output)


def _run_of_text(text: str, location: str) -> dict[str, Any]:
    """The content of batch.json. Raises BadData."""
    try:
        content = json.loads(text)
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise BadData(
            f"{location}: damaged, so that it is not known how the results beside it were made; delete the folder, or give -o "
            "another one"
        )
    return content


def delete_unfinished(output: str) -> None:
    """Deletes what killed workers left of flights. To be called while no flight is processed."""
    if not is_url(output):
        shutil.rmtree(Path(output) / UNFINISHED, ignore_errors=True)


def _read_text(location: str) -> str | None:
    try:
        if not is_url(location):
            return Path(location).read_text(encoding="utf-8", errors="replace")
        system, path = file_system(location)
        with reaching(location):
            return str(system.cat_file(path), "utf-8", "replace")
    except FileNotFoundError:
        return None


def _write_run(output: str, text: str) -> None:
    if is_url(output):
        system, path = file_system(f"{output}/{RUN_FILE}")
        with reaching(output):
            system.pipe_file(path, text.encode())
        return
    Path(output).mkdir(parents=True, exist_ok=True)
    write_whole(Path(output) / RUN_FILE, text)


def open_table(output: str, table: str) -> Any:
    """A pyarrow dataset of a table, with the partition columns vehicle and date as texts. Raises DeviceNotFound where the
    dataset or the table does not exist or cannot be read, BadData for a damaged file."""
    arrow, datasets = arrow_module(), arrow_module("pyarrow.dataset")
    fields = arrow.schema([("vehicle", arrow.string()), ("date", arrow.string())])
    partitioning = datasets.partitioning(fields, flavor="hive")
    location = f"{output}/{table}"
    if output.startswith(("http://", "https://")):
        raise DeviceNotFound(
            f"{output}: a dataset cannot be read from a web server, which lists no folders; copy it to this computer, or to an "
            "object store (s3://, gs://)"
        )
    try:
        if is_url(output):
            system, path = file_system(location)
            with reaching(location):
                return datasets.dataset(path, format="parquet", partitioning=partitioning, filesystem=system)
        return datasets.dataset(location, format="parquet", partitioning=partitioning)
    except FileNotFoundError as error:
        raise DeviceNotFound(
            f"{location}: there is no such table; give the output folder of `companion batch`"
            + (" --planes" if table == "planes" else "")
        ) from error
    except arrow.ArrowInvalid as error:
        raise _damaged(location, error) from error
    except OSError as error:
        raise DeviceNotFound(f"{location}: this table cannot be read ({error}); check its permissions") from error


def read_rows(table: Any, location: str, columns: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of a table or of one of its files. Raises BadData for a damaged file, DeviceNotFound where an address cannot be
    reached."""
    with _reading(location):
        rows: list[dict[str, Any]] = table.to_table(columns=list(columns)).to_pylist()
    return rows


def check_files(table: Any, location: str) -> None:
    """Raises BadData where a file of a table is damaged, DeviceNotFound where an address cannot be reached."""
    with _reading(location):
        table.count_rows()


@contextmanager
def _reading(location: str) -> Iterator[None]:
    """Raises the errors of `check_files`."""
    try:
        with reaching(location) if is_url(location) else nullcontext():
            yield
    except (arrow_module().ArrowInvalid, OSError) as error:
        raise _damaged(location, error) from error


def _damaged(location: str, error: Exception) -> BadData:
    return BadData(
        f"{location}: a file of this table is damaged ({error}); delete that file and the one of its flight in the table {LAST}, "
        "and run the same `companion batch` again"
    )


def finished(output: str, flights: Sequence[Flight]) -> dict[Flight, int]:
    """The flights whose results are present, made of files of the same total size, and of how many of these files nothing could
    be read. A flight with more files than before, or with a damaged row in the table `flights`, is processed again."""
    try:
        table = open_table(output, LAST)
        columns = ["vehicle", "flight", "bytes", "unread_files"]
        rows = read_rows(table, f"{output}/{LAST}", [name for name in columns if name in table.schema.names])
    except DeviceNotFound:
        return {}
    except BadData:
        found = {flight: _row_of(output, flight) for flight in flights}
    else:
        by_name = {(row["vehicle"], row["flight"]): row for row in rows}
        found = {flight: by_name.get((flight.vehicle, flight.name)) for flight in flights}
    return {
        flight: row.get("unread_files") or 0  # datasets of earlier versions lack this column
        for flight, row in found.items()
        if row is not None and row["bytes"] == flight.size
    }


def _row_of(output: str, flight: Flight) -> dict[str, Any] | None:
    """The row of a flight in the table `flights`; None: there is none, or it cannot be read."""
    location = f"{output}/{LAST}/{flight.partition}/{flight.name}.parquet"
    system, path = file_system(location) if is_url(output) else (None, location)
    try:
        rows: list[dict[str, Any]] = arrow_module("pyarrow.parquet").read_table(path, filesystem=system).to_pylist()
        (row,) = rows
    except (OSError, ValueError):
        return None
    return row
