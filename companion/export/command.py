"""`companion export`: the results of a log as CSV, NPZ, Parquet or glTF."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any, Final

import numpy as np

from drivers.base import BadData
from drivers.logs.reader import McapRecording
from drivers.optional_library import optional_module
from drivers.shell_word import shell_word

from ..argument_types import number_in
from ..common_options import add_replace
from ..console import counted, fail, print_json, print_line
from ..pipeline.results import PrismsResult
from ..usage_error import UsageError
from ..viewer.log import view_frame
from ..viewer.placement import placed_model
from ..whole_file import refuse_existing, whole_file, write_whole
from .gltf import glb
from .tables import COLUMNS, Table, Tables, read_tables

FORMATS: Final = ("csv", "npz", "parquet", "gltf")


def export(path: Path, out: Path, kind: str, frame: int | None, *, replace: bool) -> tuple[list[Path], int, str]:
    """(written files, frames, damage of the log). frame: for glTF, the sequence of the frame; None: that with most planes.
    replace: existing files.

    csv and parquet: one file per table in the directory `out`; npz and gltf: the file `out`. Raises DriverError, OSError,
    and ValueError for a log without results or without the frame."""
    _check_output(out, kind)
    refuse_existing(*_files(out, kind), replace=replace)
    tables, damage, chosen = Tables(), "", _Chosen(frame)
    with McapRecording(path) as source:
        infos = {info.camera: info for info in source.cameras}
        try:
            for result in read_tables(source, tables):
                chosen.add(result)
        except BadData as error:
            damage = str(error)
        frames = len(tables.rows["frames"])
        if not frames:
            raise ValueError(
                f"{path}: no prisms in this log: compute them with `companion replay {shell_word(path)} -o prisms.mcap`, "
                f"and export prisms.mcap. {damage}".strip()
            )
        if kind == "gltf":
            return [_write_gltf(out, chosen, infos)], frames, damage
    return _write_tables(out, kind, tables.arrays()), frames, damage


def _check_output(out: Path, kind: str) -> None:
    """Raises ValueError for a file without the extension of its format: neither a log nor another file is overwritten."""
    suffix = {"npz": ".npz", "gltf": ".glb"}.get(kind)
    if suffix is not None and out.suffix != suffix:
        raise UsageError(f"{out}: give -o a file with the extension {suffix}")
    if suffix is None and out.exists() and not out.is_dir():
        raise ValueError(f"{out}: is a file; {kind} is written into a directory")


def _files(out: Path, kind: str) -> list[Path]:
    """The files of an export."""
    return [out] if kind in ("npz", "gltf") else [out / f"{table}.{kind}" for table in COLUMNS]


class _Chosen:
    """The frame for glTF, and the positions of the vehicle."""

    def __init__(self, sequence: int | None) -> None:
        self._sequence = sequence
        self.result: PrismsResult | None = None
        self.positions: list[tuple[float, float, float]] = []
        self._valid: list[int] = []

    def add(self, result: PrismsResult) -> None:
        if result.pose is not None:
            self.positions.append(result.pose.position_ned_m)
        if not result.valid or result.model is None:
            return
        self._valid.append(result.sequence)
        if self._sequence is not None:
            self.result = result if result.sequence == self._sequence else self.result
        elif (
            self.result is None or self.result.model is None or len(result.model.planes) > len(self.result.model.planes)
        ):
            self.result = result

    def require(self) -> PrismsResult:
        """The frame. Raises ValueError where there is none."""
        if self.result is None:
            if not self._valid:
                raise ValueError("the log has no valid frame; `companion export -f csv` lists all frames")
            raise ValueError(
                f"the log has no valid frame {self._sequence}; the sequence numbers of valid ones lie between "
                f"{min(self._valid)} and {max(self._valid)}, and `companion export -f csv` lists all frames"
            )
        return self.result


def _write_gltf(out: Path, chosen: _Chosen, infos: dict[str, Any]) -> Path:
    result = chosen.require()
    model = placed_model(view_frame(result, infos[result.camera], None))
    assert model is not None
    name = f"{result.camera} frame {result.sequence}"
    positions = [] if result.pose is None else chosen.positions  # otherwise the obstacles stand around another origin
    write_whole(out, glb(model.prisms, np.array(positions).reshape(-1, 3), name))
    return out


def _write_tables(out: Path, kind: str, tables: dict[str, Table]) -> list[Path]:
    if kind == "npz":
        arrays: dict[str, Any] = {f"{t}.{c}": values for t, table in tables.items() for c, values in table.items()}
        with whole_file(out) as part, part.open("wb") as stream:
            np.savez_compressed(stream, **arrays)
        return [out]
    write = _csv if kind == "csv" else _parquet_writer()
    out.mkdir(parents=True, exist_ok=True)
    paths = _files(out, kind)
    for path, table in zip(paths, tables.values(), strict=True):
        with whole_file(path) as part:
            write(part, table)
    return paths


def _csv(path: Path, table: Table) -> None:
    """Text with the shortest digits that give the same number; NaN is empty."""
    columns = [
        [_text(v) for v in values.tolist()] if values.dtype.kind != "f" else _numbers(values)
        for values in table.values()
    ]
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*columns, strict=True))


def _text(value: Any) -> str:
    return str(int(value)) if isinstance(value, bool) else str(value)


def _numbers(values: Any) -> list[str]:
    return ["" if np.isnan(v) else np.format_float_positional(v, trim="-") for v in values]


def _parquet_writer() -> Any:
    """Raises DeviceNotFound without pyarrow."""
    need = "Parquet needs pyarrow", "pyarrow>=16"
    arrow, parquet = (
        optional_module(name, *need, otherwise=", or export csv or npz") for name in ("pyarrow", "pyarrow.parquet")
    )

    def write(path: Path, table: Table) -> None:
        arrays = {k: v.tolist() if v.dtype.kind == "U" else v for k, v in table.items()}
        schema = arrow.schema([(k, _arrow_type(arrow, v)) for k, v in table.items()])
        parquet.write_table(arrow.table(arrays, schema=schema), path, compression="zstd")

    return write


def _arrow_type(arrow: Any, values: Any) -> Any:
    return arrow.string() if values.dtype.kind == "U" else arrow.from_numpy_dtype(values.dtype)


def add_parser(subparsers: Any) -> None:
    """The command line of `companion export`."""
    parser = subparsers.add_parser("export")
    parser.add_argument("input", type=Path, metavar="FILE.mcap", help="a log with prisms")
    parser.add_argument(
        "-f", "--format", choices=FORMATS, required=True, help="csv and parquet write a directory, npz and gltf a file"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="directory or file to write")
    add_replace(parser)
    parser.add_argument(
        "--frame",
        type=number_in(int, 0, 2**32 - 1),
        metavar="N",
        help="with gltf: sequence number of the frame, as in frames.csv (default: the one with most planes)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: success; 1: the log could not be read to its end. Raises UsageError."""
    if args.frame is not None and args.format != "gltf":
        raise UsageError(f"--frame needs -f gltf: {args.format} contains all frames")
    files, frames, damage = export(args.input, args.output, args.format, args.frame, replace=args.replace)
    if args.json:
        print_json({"frames": frames, "files": [str(f) for f in files], "damage": damage or None})
    else:
        print_line(counted(frames, "frame"))
        for file in files:
            print_line(f"written  {file}")
    if damage:
        fail(damage)
    return 1 if damage else 0
