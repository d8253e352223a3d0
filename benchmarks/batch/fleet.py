"""Writes a simulated fleet: logs as the service records them, with results, health reports and rotated files.

    python -m benchmarks.batch.fleet OUT --flights 200

A few flights of ten seconds are rendered, each through another scene. Every flight of the fleet is one of them with noise
of its own: 1 mm standard deviation on every measured pixel, from the flight's number. Results are computed, so each log
equals what a vehicle with this version would have recorded."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from companion.config.loader import Config
from companion.kernels.jit_cache import use_own_cache
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import Event
from osape_client.proto import osape_v1_pb2 as pb

NS = 1_000_000_000
SCENES = 10
VEHICLES = ("alpha", "beta", "gamma", "delta")
CAMERA = CameraInfo("front", Intrinsics(320, 240, 225.0, 225.0, 159.5, 119.5), ke_per_m=0.0015)


def health(t_ns: int, armed: bool, nearest_cm: int = 800) -> pb.Health:
    """A report of a vehicle that sent one sector with an obstacle."""
    sent = pb.ObstacleSectors(cm=[65535, nearest_cm, 2001], t_ns=t_ns, clear_cm=2001, step_deg=5.0)
    latency = pb.Latency(
        stage="exposure_to_publish", stage_enum=pb.Latency.STAGE_EXPOSURE_TO_PUBLISH, p50_ms=28.0, p95_ms=31.5
    )
    return pb.Health(
        schema_version=1, t_ns=t_ns, latencies=[latency], autopilot=pb.AutopilotHealth(armed=armed, obstacles_sent=sent)
    )


def write_parts(
    folder: Path,
    name: str,
    events: Sequence[Event],
    camera: CameraInfo,
    *,
    parts: int = 1,
    armed: bool = True,
    health_s: float = 1.0,
    busy: int = -1,
) -> list[Path]:
    """A flight as the service records it, in rotated files that begin with their state; returns the files.

    busy: number of a frame that a newer one replaced before it was handled; -1: none."""
    from companion.pipeline.configured import make_pipeline  # late: it imports the kernels

    pipeline = make_pipeline(Config(), (camera,))
    folder.mkdir(parents=True, exist_ok=True)
    begins_ns = [events[k * len(events) // parts].t_arrival_ns for k in range(parts)]
    paths = [folder / f"{name}.{k:03d}.mcap" for k in range(parts)]
    health_ns = 0
    for path, begin_ns, end_ns in zip(paths, begins_ns, [*begins_ns[1:], 1 << 62], strict=True):
        with LogWriter(path) as log:
            log.begin(run_info("live", Config()), (camera,), pipeline.state(), begin_ns)
            for event in (e for e in events if begin_ns <= e.t_arrival_ns < end_ns):
                if event.t_arrival_ns >= health_ns:
                    health_ns = event.t_arrival_ns + round(health_s * NS)
                    log.write("health", health(event.t_arrival_ns, armed), event.t_arrival_ns)
                log.event(event)
                if isinstance(event, DepthFrame) and event.sequence == busy:
                    log.output(pipeline.superseded(event), scene=False, transforms=False)
                    continue
                for output in pipeline.handle(event):
                    log.output(output, scene=False, transforms=False)
    return paths


def noisy(events: Iterable[Event], seed: int) -> Iterator[Event]:
    """The events; each measured pixel with noise of 1 mm standard deviation."""
    rng = np.random.default_rng(seed)
    for event in events:
        if not isinstance(event, DepthFrame):
            yield event
            continue
        noise_mm = np.round(rng.normal(0.0, 1.0, event.depth_mm.shape)).astype(np.int32)
        measured = (event.depth_mm > 100) & (event.depth_mm < 60_000)
        depth_mm = np.where(measured, event.depth_mm + noise_mm, event.depth_mm).astype(np.uint16)
        yield dataclasses.replace(event, depth_mm=depth_mm)


def write_fleet(folder: Path, flights: int, seconds: float) -> None:
    """Writes the flights that are not there yet; every tenth flight has two files."""
    from drivers.simulation.flight import SimulatedFlight

    for scene in range(min(SCENES, flights)):
        rendered = list(SimulatedFlight("demo", cameras=(CAMERA,), duration_s=seconds, seed=scene).events())
        for number in range(scene, flights, SCENES):
            vehicle, day = VEHICLES[number % len(VEHICLES)], 1 + number % 28
            name = f"202611{day:02d}-{number // 60:02d}{number % 60:02d}00"
            if not (folder / vehicle / f"{name}.000.mcap").exists():
                write_parts(folder / vehicle, name, list(noisy(rendered, number)), CAMERA, parts=1 + (number % 10 == 9))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=10.0)
    args = parser.parse_args()
    use_own_cache()
    write_fleet(args.output, args.flights, args.seconds)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
