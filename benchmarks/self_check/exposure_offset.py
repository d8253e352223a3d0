"""How well the offset of exposure stamps is measured: `python -m benchmarks.self_check.exposure_offset`.

Simulated flights turn left and right for 20 s; the stamps of their frames are late or early by a known offset. The
companion's own monitor measures it. Prints a table of true and measured offsets, when each was first measured, and the
processor time per frame. With a recorded log (`--log`) the stamps of the log are shifted in the same way."""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.self_check.exposure_monitor import ExposureOffsetMonitor
from companion.self_check.exposure_offset import ExposureOffset
from core.types import AttitudeSample, CameraInfo, DepthFrame
from drivers.base import Event
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import Rates, SimulatedFlight
from drivers.simulation.flight_path import FlightPath
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scene_library import make_scene
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info

NS = 1_000_000_000
OFFSETS_MS = (0.0, 5.0, 10.0, 20.0, 40.0, 80.0, -20.0, -60.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One flight. noise: factor on the sensor's noise; mount_error_deg: of the yaw that is configured; jitter_s: of the
    exposure stamps, standard deviation."""

    name: str
    scene: str
    turn_rad: float = 0.5
    turn_hz: float = 0.25
    sway: bool = True
    speed_m_s: float = 0.0
    hz: float = 12.0
    width_px: int = 640
    noise: float = 1.0
    mount_error_deg: float = 0.0
    jitter_s: float = 0.0
    seconds: float = 20.0


CASES = (
    Case(name="street, turning", scene="street"),
    Case(name="street, turning, 20 Hz", scene="street", hz=20.0, width_px=320),
    Case(name="street, turning, 30 Hz", scene="street", hz=30.0, width_px=320),
    Case(name="street, yaw alone", scene="street", sway=False),
    Case(name="street, sway alone", scene="street", turn_rad=0.0),
    Case(name="street, noise x3", scene="street", noise=3.0),
    Case(name="street, mount yaw 3 deg wrong", scene="street", mount_error_deg=3.0),
    Case(name="street, stamps jitter 3 ms", scene="street", jitter_s=0.003),
    Case(name="trees, turning", scene="trees"),
    Case(name="trees, yaw alone", scene="trees", sway=False),
    Case(name="trees, turning in flight", scene="trees", speed_m_s=0.5),
    Case(name="mixture, fast turns", scene="mixture", turn_rad=0.4, turn_hz=0.5),
    Case(name="alley, turning in flight", scene="alley", speed_m_s=0.5),
    Case(name="window, turning", scene="window"),
    Case(name="street, forward alone", scene="street", turn_rad=0.0, sway=False, speed_m_s=1.0),
    Case(name="street, at rest", scene="street", turn_rad=0.0, sway=False),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """first_s: of the flight, when it was first measured (inf: never); worst_ms: the largest error of any estimate on
    the way; cpu_ms: a frame."""

    offset: ExposureOffset
    first_s: float
    worst_ms: float
    cpu_ms: float
    warned: bool


def flight_events(case: Case) -> tuple[CameraInfo, list[Event]]:
    """The camera as it is configured, and all events."""
    rows: list[list[float]] = []
    for i in range(round(case.seconds * 8) + 1):
        t = i / 8
        x = -2.0 + case.speed_m_s * min(t, case.seconds - t)
        yaw = case.turn_rad * math.sin(math.tau * case.turn_hz * t)
        rows.append([t, x, 0.0, -2.0, 0.0, 0.0, yaw])
    path = FlightPath(rows, sway_rad=(0.03, 0.04, 0.02) if case.sway else (0.0, 0.0, 0.0))
    sensor = replace(TYPICAL, ke_per_m=TYPICAL.ke_per_m * case.noise)
    plan = FlightPlan(name=case.scene, scene=make_scene(case.scene, 0), path=path, sensor=sensor)
    info = camera_info(case.width_px, case.width_px * 3 // 4, ke_per_m=sensor.ke_per_m)
    flight = SimulatedFlight(plan, cameras=(info,), rates=Rates(depth_hz=case.hz), duration_s=case.seconds)
    wrong = replace(info.mount, yaw_rad=info.mount.yaw_rad + math.radians(case.mount_error_deg))
    return replace(info, mount=wrong), list(flight.events())


def measure(info: CameraInfo, events: Iterable[Event], offset_ms: float, jitter_s: float = 0.0) -> Outcome:
    """The monitor's estimate for events whose exposure stamps are shifted by offset_ms."""
    rng = np.random.default_rng(7)
    monitor = ExposureOffsetMonitor()
    monitor.announce(info)
    first_s, worst_ms, cpu_s, frames, begun_ns, warned = math.inf, 0.0, 0.0, 0, None, False
    for event in events:
        item = event
        if isinstance(event, DepthFrame):
            shift_ns = round(offset_ms * 1e6 + jitter_s * NS * rng.standard_normal())
            item = dataclasses.replace(event, t_exposure_ns=event.t_exposure_ns + shift_ns)
            begun_ns = event.t_exposure_ns if begun_ns is None else begun_ns
            frames += 1
        elif not isinstance(event, AttitudeSample):
            continue
        before_s = time.process_time()
        monitor.event(item)
        cpu_s += time.process_time() - before_s
        (said,) = monitor.offsets()
        if said.offset_s is not None and isinstance(event, DepthFrame) and begun_ns is not None:
            first_s = min(first_s, (event.t_exposure_ns - begun_ns) / NS)
            worst_ms = max(worst_ms, abs(1000.0 * said.offset_s - offset_ms))
            warned = warned or said.warns
    (offset,) = monitor.offsets()
    return Outcome(
        offset=offset, first_s=first_s, worst_ms=worst_ms, cpu_ms=1000.0 * cpu_s / max(1, frames), warned=warned
    )


def row(name: str, offset_ms: float, outcome: Outcome) -> str:
    """A line of the table."""
    said = outcome.offset
    value = "-" if said.offset_s is None else f"{1000.0 * said.offset_s:.1f}"
    sigma = "-" if said.sigma_s is None else f"{1000.0 * said.sigma_s:.1f}"
    first = f"{outcome.first_s:.1f}" if math.isfinite(outcome.first_s) else "-"
    worst = f"{outcome.worst_ms:.1f}" if math.isfinite(outcome.first_s) else "-"
    return (
        f"| {name} | {offset_ms:g} | {value} | {sigma} | {worst} | {first} | {said.state} "
        f"| {'yes' if outcome.warned else 'no'} | {outcome.cpu_ms:.2f} |"
    )


def log_events(path: Path) -> tuple[CameraInfo, list[Event]]:
    """The first camera of a log and its events."""
    with McapRecording(path) as source:
        info = source.cameras[0]
        events = [e for e in source.events() if not isinstance(e, DepthFrame) or e.camera == info.camera]
    return info, events


def main(argv: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--log", type=Path, help="a recorded log instead of simulated flights")
    parser.add_argument("--offsets-ms", type=float, nargs="+", default=list(OFFSETS_MS))
    args = parser.parse_args(argv)
    print("| flight | true ms | measured ms | sigma ms | worst ms | first after s | state | warned | cpu ms a frame |")
    print("|---|---:|---:|---:|---:|---:|---|---|---:|")
    if args.log is not None:
        info, events = log_events(args.log)
        for offset_ms in args.offsets_ms:
            print(row(args.log.name, offset_ms, measure(info, events, offset_ms)), flush=True)
        return
    measure(*flight_events(Case(name="warm up", scene="street", width_px=320, seconds=4.0)), 0.0)
    for case in CASES:
        info, events = flight_events(case)
        for offset_ms in args.offsets_ms:
            print(row(case.name, offset_ms, measure(info, events, offset_ms, case.jitter_s)), flush=True)


if __name__ == "__main__":
    main()
