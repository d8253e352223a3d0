"""`companion batch --compare`: the report of what differs between two datasets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from drivers.shell_word import shell_word

from ..console import counted, print_json, print_line, progress
from ..viewer.png import drawing_library
from ..whole_file import whole_file, write_whole
from .comparison import Dataset, DatasetDifference, FlightDifference, compare_flight, paired_frames
from .comparison_pictures import draw_flight, draw_overview
from .parquet_table import arrow_module

SHOWN: Final = 10
"""Flights to look at."""
LOOK: Final = "look.parquet"
"""Rows for `companion find`. Absent where no answer changed by more than numbers."""
_REPORT: Final = "report.json"
_SUMMED: Final = ("frames", "only_a", "only_b", "changed", "newly_blind", "newly_valid", "missed", "phantom")


def compare_datasets(location_a: str, location_b: str, folder: Path, pictures: bool) -> dict[str, Any]:
    """Compares, and writes the report, tables and pictures into a folder; returns the report. Raises DeviceNotFound for a folder
    without a dataset, ValueError where the datasets have no flight in common."""
    a, b = Dataset(location_a), Dataset(location_b)
    names = sorted(a.names & b.names)
    if not names:
        raise ValueError(
            f"{location_a} and {location_b} have no flight in common; compare two outputs of the same logs"
        )
    found = DatasetDifference(only_a=sorted(a.names - b.names), only_b=sorted(b.names - a.names))
    with progress("compare") as on_progress:
        for number, name in enumerate(names, start=1):
            found.flights.append(compare_flight(a, b, name))
            on_progress(number / len(names))
    folder.mkdir(parents=True, exist_ok=True)
    _delete_earlier_pictures(folder)
    _write_rows(folder / "flights.parquet", [flight.as_row() for flight in found.flights])
    shown = found.worst[:SHOWN]
    _write_look(folder / LOOK, a, b, shown)
    if pictures:
        _draw(folder, a, b, found.flights, shown)
    report = summary(found)
    write_whole(folder / _REPORT, json.dumps(report, indent=2, allow_nan=False) + "\n")
    return report


def summary(found: DatasetDifference) -> dict[str, Any]:
    """The object of `--json`."""
    flights = found.flights
    total: dict[str, Any] = {name: sum(getattr(f, name) for f in flights) for name in _SUMMED}
    for side in "ab":
        valid = sum(getattr(f, f"valid_{side}") for f in flights)
        total[f"planes_per_frame_{side}"] = sum(getattr(f, f"planes_{side}") for f in flights) / max(1, valid)
        total[f"valid_{side}"] = valid
        total[f"blind_s_{side}"] = sum(getattr(f, f"blind_s_{side}") for f in flights)
    for kind in ("missed_planes", "phantom_planes"):
        counts = [getattr(f, kind) for f in flights]
        total[kind] = None if None in counts else sum(counts)
    return {
        "flights": len(flights),
        "flights_changed": sum(f.changed > 0 for f in flights),
        "flights_only_a": ["/".join(name) for name in found.only_a],
        "flights_only_b": ["/".join(name) for name in found.only_b],
        "total": total,
        "look_at": [flight.as_row() for flight in found.worst[:SHOWN]],
    }


def _write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    arrow, parquet = arrow_module(), arrow_module("pyarrow.parquet")
    with whole_file(path) as part:
        parquet.write_table(arrow.Table.from_pylist(rows), part, compression="zstd")


def _write_look(path: Path, a: Dataset, b: Dataset, flights: Sequence[FlightDifference]) -> None:
    """The frames of these flights whose answer changed by more than numbers, for `companion find`."""
    rows = []
    for flight in flights:
        frames, _, _ = paired_frames(a, b, (flight.vehicle, flight.flight))
        for row, kind in zip(frames.b, frames.kinds, strict=True):
            if kind not in ("", "changed"):
                place = {name: row[name] for name in ("file", "camera", "sequence", "t_exposure_ns")}
                rows.append({"vehicle": flight.vehicle, "flight": flight.flight, **place, "kind": kind})
    if rows:
        _write_rows(path, rows)
    else:
        path.unlink(missing_ok=True)


def _draw(
    folder: Path, a: Dataset, b: Dataset, flights: Sequence[FlightDifference], shown: Sequence[FlightDifference]
) -> None:
    datasets = a.location, b.location
    draw_overview(datasets, flights, folder / "overview.png")
    for number, flight in enumerate(shown, start=1):
        frames, _, _ = paired_frames(a, b, (flight.vehicle, flight.flight))
        draw_flight(datasets, flight, frames, folder / _picture(number, flight.vehicle, flight.flight))


def _picture(number: int, vehicle: str, flight: str) -> str:
    """The name of the picture of a flight to look at."""
    return f"{number:02d}_{vehicle}_{flight}.png"


def _delete_earlier_pictures(folder: Path) -> None:
    """Deletes the pictures of flights that an earlier report in the folder lists: their numbers would be those of others."""
    with suppress(OSError, ValueError, LookupError, TypeError):  # there is none, or another file of this name
        shown = json.loads((folder / _REPORT).read_text(encoding="utf-8"))["look_at"]
        for number, row in enumerate(shown, start=1):
            (folder / _picture(number, row["vehicle"], row["flight"])).unlink(missing_ok=True)


def run_comparison(location_a: str, location_b: str, folder: Path, pictures: bool, as_json: bool) -> int:
    """0: compared, also where results differ. Raises DeviceNotFound without matplotlib, before it reads the datasets."""
    if pictures:
        drawing_library(", or give --no-pictures")
    report = compare_datasets(location_a, location_b, folder, pictures)
    if as_json:
        print_json(report)
        return 0
    total = report["total"]
    print_line(f"{counted(report['flights'], 'flight')} in both, {report['flights_changed']} with changed results")
    for side in "ab":
        if only := report[f"flights_only_{side}"]:
            print_line(f"{counted(len(only), 'flight')} only in {side.upper()}: {', '.join(only[:SHOWN])}")
    print_line(f"{total['changed']} of {total['frames']} frames changed")
    print_line(
        f"missed: {counted(total['missed'], 'frame')}; phantom: {counted(total['phantom'], 'frame')} (nearest plane)"
    )
    if total["missed_planes"] is not None:
        print_line(f"planes without counterpart: {total['missed_planes']} missed, {total['phantom_planes']} phantom")
    print_line(
        f"planes per valid frame: {total['planes_per_frame_a']:.2f} in A, {total['planes_per_frame_b']:.2f} in B"
    )
    print_line(
        f"blind: {total['blind_s_a']:.1f} s in A, {total['blind_s_b']:.1f} s in B; {counted(total['newly_blind'], 'frame')} newly blind, "
        f"{total['newly_valid']} newly valid"
    )
    for row in report["look_at"]:
        print_line(
            f"look at {row['vehicle']}/{row['flight']}: {row['missed']} missed, {row['newly_blind']} newly blind, "
            f"{row['phantom']} phantom, {row['changed']} of {row['frames']} changed"
        )
    print_line(f"written: {folder}")
    if (look := folder / LOOK).exists():
        print_line(f"next: companion find {shell_word(location_b)} {shell_word(look)} -o CLIPS")
    return 0
