"""Collects the tables of one flight during the replay of its files."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from drivers.logs.reader import LoggedMessage, McapRecording
from osape_client.proto import osape_v1_pb2 as pb

from ..config.loader import Config, config_text
from ..log.provenance import software
from ..pipeline.results import FrameDecision, Output
from ..replay.recorded_run import readable_recorded_config
from .events import NS, FlightEvents, FrameSummary
from .flights import Flight
from .frame_rows import FrameRows, plane_rows, result_columns, text_hash
from .parquet_table import TableFile
from .same_run import SameRun
from .schema import TABLES

_HEALTH_GAP_NS: Final = 3 * NS
"""Health reports come once per second; over a longer gap the vehicle's state is not known."""


class FlightTables:
    """The observer of a flight's replays (companion.replay.replay). `begin_file` before and `end_file` after each file,
    then `finish`; `discard` in any case."""

    def __init__(self, flight: Flight, folder: Path, near_m: float, with_planes: bool) -> None:
        """folder: of the files to write, TABLE.parquet. near_m: distance below which a frame is part of a near pass."""
        tables = [name for name in TABLES if name != "planes" or with_planes]
        self.files = {name: TableFile(name, folder / f"{name}.parquet") for name in tables}
        self.damage: list[str] = []
        self._unread_files = 0
        self._flight = flight
        self._rows = FrameRows()
        self._events = FlightEvents(near_m)
        self._file = 0
        self._same_run = SameRun()
        self._armed: bool | None = None
        self._health_ns: int | None = None
        self._publish_ms: float | None = None
        self._armed_ns = 0
        self._first_ns: int | None = None
        self._last_ns = 0
        self._cameras: dict[str, None] = {}
        self._valid = self._planes = self._skipped_live = 0
        self._nearest_m: float | None = None
        self._config_hash = ""
        self._onboard: tuple[str | None, str | None] = (None, None)

    @property
    def keys(self) -> tuple[str, ...]:
        """The kinds of messages to receive."""
        return "prisms", "decision", "health"

    # ---- called by the replay -----------------------------------------------------------------------------------------

    def begin_file(self, number: int) -> None:
        """Called before the replay of a file."""
        self._file = number

    def begin(self, source: McapRecording, config: Config) -> None:
        """config: the configuration in use."""
        self._same_run.begin_file(source)
        self._config_hash = text_hash(config_text(config))
        recorded = readable_recorded_config(source) or Config()
        if source.run is not None:
            config_json = source.run.config_json
            self._onboard = source.run.software, text_hash(config_json) if config_json else None
        every_image = recorded.record.depth and recorded.record.depth_hz <= 0.0
        self._events.gap_s = recorded.service.timeout_s if every_image else math.inf
        self._cameras |= dict.fromkeys(info.camera for info in source.cameras)

    def logged(self, item: LoggedMessage) -> None:
        """A message of the log."""
        if isinstance(item.message, pb.PrismsFrame):
            self._add("frames", self._rows.logged(item.message))
        elif isinstance(item.message, pb.Health):
            self._health(item.message)
        elif isinstance(item.message, pb.FrameDecision):
            self._skipped_live += item.message.cause == pb.CAUSE_BUSY

    def output(self, output: Output) -> None:
        """A result of the pipeline."""
        if isinstance(output, FrameDecision):
            return
        known = {"file": self._file, "armed": self._armed, "publish_latency_ms": self._publish_ms}
        row = known | result_columns(output)
        self._same_run.frame(output.t_exposure_ns)
        self._count(row)
        summary = FrameSummary(
            camera=output.camera,
            t_ns=output.t_exposure_ns,
            file=self._file,
            valid=output.valid,
            cause=output.cause.value,
            armed=self._armed,
            distance_m=row.get("nearest_m"),
        )
        self._add("events", self._events.frame(summary))
        self._add("frames", self._rows.computed(output, row))
        if "planes" in self.files:
            self._add("planes", plane_rows(output))

    def end_file(self, damage: str | None, unread: bool = False) -> None:
        """Called after the replay of a file. damage: of the file, None: none. unread: nothing of it can be read."""
        self._add("frames", self._rows.end_file())
        if damage:
            self.damage.append(damage)
        if difference := self._same_run.end_file():
            self.damage.append(f"{self._flight.files[self._file].location}: {difference}")
        self._unread_files += unread

    def finish(self) -> None:
        """Writes the row of the flight and completes the files."""
        self._add("events", self._events.end())
        self._add("flights", [self.flight_row()])
        for file in self.files.values():
            file.close()

    def discard(self) -> None:
        """Closes files that `finish` did not complete."""
        for file in self.files.values():
            file.discard()

    # ---- rows -----------------------------------------------------------------------------------------------------------

    def _add(self, table: str, rows: Iterable[dict[str, Any]]) -> None:
        for row in rows:
            self.files[table].add(row | {"flight": self._flight.name})

    def _count(self, row: dict[str, Any]) -> None:
        t_ns = row["t_exposure_ns"]
        self._first_ns = t_ns if self._first_ns is None else min(self._first_ns, t_ns)
        self._last_ns = max(self._last_ns, t_ns)
        self._valid += row["valid"]
        self._planes += row["planes"]
        if (nearest_m := row.get("nearest_m")) is not None:
            self._nearest_m = nearest_m if self._nearest_m is None else min(self._nearest_m, nearest_m)

    def flight_row(self) -> dict[str, Any]:
        """The row of the flight in the table `flights`."""
        compared = self._rows.comparison
        return {
            "files": [file.location for file in self._flight.files], "bytes": self._flight.size, "software": software(),
            "config_hash": self._config_hash, "onboard_software": self._onboard[0],
            "onboard_config_hash": self._onboard[1], "cameras": list(self._cameras), "begin_ns": self._first_ns,
            "duration_s": 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) / NS,
            "armed_s": self._armed_ns / NS, "frames": self.files["frames"].rows, "valid": self._valid,
            "blind_s": self._events.blind_s, "planes": self._planes, "nearest_m": self._nearest_m,
            "compared": compared.compared, "different": compared.different,
            "equals_onboard": compared.different == 0 if compared.compared else None,
            "first_difference": str(compared.first) if compared.first else None,
            "missing_onboard": compared.missing_onboard, "without_depth": compared.without_depth,
            "skipped_live": self._skipped_live, "events": self.files["events"].rows,
            "damage": "; ".join(self.damage) or None, "unread_files": self._unread_files,
        }  # fmt: skip

    def _health(self, report: pb.Health) -> None:
        self._same_run.boot(report.boot_id)
        if self._health_ns is not None and self._armed and 0 < report.t_ns - self._health_ns < _HEALTH_GAP_NS:
            self._armed_ns += report.t_ns - self._health_ns
        self._health_ns = report.t_ns
        if report.HasField("autopilot"):
            self._armed = report.autopilot.armed
        for latency in report.latencies:
            if latency.stage_enum == pb.Latency.STAGE_EXPOSURE_TO_PUBLISH:
                self._publish_ms = latency.p95_ms
        self._add("events", self._events.health(report, self._file))
