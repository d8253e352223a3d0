"""Small simulated fleets: flights with results and health reports of a vehicle, in the folders of two vehicles."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

from benchmarks.batch import fleet
from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import Event
from drivers.simulation.flight import SimulatedFlight

SMALL = CameraInfo("front", Intrinsics(96, 72, 67.5, 67.5, 47.5, 35.5), ke_per_m=0.0015)
NS = fleet.NS


def flight_events(seed: int, seconds: float = 1.0, plan: str = "demo") -> list[Event]:
    return list(SimulatedFlight(plan, cameras=(SMALL,), duration_s=seconds, seed=seed).events())


def write_parts(folder: Path, name: str, events: list[Event], parts: int = 1, busy: int = -1) -> list[Path]:
    """The log files of a flight with a health report every 0.2 s. busy: a frame that the service skipped."""
    return fleet.write_parts(folder, name, events, SMALL, parts=parts, health_s=0.2, busy=busy)


def blinded(events: Iterable[Event], frames: range) -> list[Event]:
    """The events; the frames with these numbers measure nothing."""
    return [
        dataclasses.replace(e, depth_mm=e.depth_mm * 0) if isinstance(e, DepthFrame) and e.sequence in frames else e
        for e in events
    ]


def write_fleet(folder: Path) -> Path:
    """Three flights of two vehicles: rotated files, frames without a measurement, a truncated file."""
    write_parts(folder / "alpha", "20261101-100000", flight_events(1), parts=2)
    write_parts(folder / "beta", "20261102-110000", blinded(flight_events(2), range(4, 7)))
    (cut,) = write_parts(folder / "beta", "20261103-120000", flight_events(3))
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 2 // 3])
    return folder
