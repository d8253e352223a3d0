"""Small simulated fleets: flights with results and health reports of a vehicle, in the folders of two vehicles."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

from companion.config.loader import Config
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.replay.replay import make_pipeline
from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import Event
from drivers.simulation.flight import SimulatedFlight
from osape_client.proto import osape_v1_pb2 as pb

SMALL = CameraInfo("front", Intrinsics(96, 72, 67.5, 67.5, 47.5, 35.5), ke_per_m=0.0015)
NS = 1_000_000_000


def flight_events(seed: int, seconds: float = 1.0, plan: str = "demo") -> list[Event]:
    return list(SimulatedFlight(plan, cameras=(SMALL,), duration_s=seconds, seed=seed).events())


def health(t_ns: int, armed: bool, nearest_cm: int = 800) -> pb.Health:
    """A report in which the vehicle sent one sector with an obstacle."""
    sent = pb.ObstacleSectors(cm=[65535, nearest_cm, 2001], t_ns=t_ns, clear_cm=2001, step_deg=5.0)
    latency = pb.Latency(stage="exposure_to_publish", stage_enum="STAGE_EXPOSURE_TO_PUBLISH", p95_ms=31.5)
    return pb.Health(
        schema_version=1, t_ns=t_ns, latencies=[latency], autopilot=pb.AutopilotHealth(armed=armed, obstacles_sent=sent)
    )


def write_parts(folder: Path, name: str, events: list[Event], parts: int = 1, armed: bool = True) -> list[Path]:
    """A flight as the service records it: results, decisions, a health report every 0.2 s, and rotated files that begin
    with their state."""
    config = Config()
    pipeline = make_pipeline(config, (SMALL,))
    folder.mkdir(parents=True, exist_ok=True)
    bounds = [events[k * len(events) // parts].t_arrival_ns for k in range(parts)]
    log: LogWriter | None = None
    health_ns = 0
    paths: list[Path] = []
    for event in events:
        if bounds and event.t_arrival_ns >= bounds[0]:
            bounds.pop(0)
            if log is not None:
                log.finish()
            paths.append(folder / f"{name}.{len(paths):03d}.mcap")
            log = LogWriter(paths[-1])
            log.begin(run_info("live", config), (SMALL,), pipeline.state(), event.t_arrival_ns)
        assert log is not None
        if event.t_arrival_ns >= health_ns:
            health_ns = event.t_arrival_ns + NS // 5
            log.write("health", health(event.t_arrival_ns, armed), event.t_arrival_ns)
        log.event(event)
        for output in pipeline.handle(event):
            log.output(output, scene=False, transforms=False)
    assert log is not None
    log.finish()
    return paths


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
