"""The health report as Prometheus text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from osape_client.proto import osape_v1_pb2 as pb

from ..cameras.status import CameraCondition
from .health import STATES

NS = 1_000_000_000

Sample = tuple[dict[str, str], float]


def metrics_text(report: pb.Health) -> str:
    """The report in Prometheus' text format. An unknown value has no sample."""
    lines: list[str] = []
    for name, kind, meaning, samples in families(report):
        if samples:
            lines += [f"# HELP osape_{name} {meaning}", f"# TYPE osape_{name} {kind}"]
            lines += [f"osape_{name}{_labels(labels)} {value:.10g}" for labels, value in samples]
    return "\n".join(lines) + "\n"


def families(h: pb.Health) -> Iterator[tuple[str, str, str, list[Sample]]]:
    """Name, type, meaning and samples of each metric; without samples where a value is unknown."""
    states: list[Sample] = [({"state": state}, float(h.state == value)) for value, state in STATES.items()]
    yield "state", "gauge", "1 for the present state", states
    yield "diagnostics", "gauge", "Number of active diagnostics", [({}, float(len(h.diagnostics)))]
    active: dict[tuple[str, str], int] = Counter((d.code, d.camera) for d in h.diagnostics)
    diagnostics: list[Sample] = [
        ({"code": code, "camera": camera}, float(n)) for (code, camera), n in sorted(active.items())
    ]
    yield "diagnostic", "gauge", "Active diagnostics by code and camera", diagnostics
    yield "uptime_seconds", "gauge", "Time since the service started", [({}, h.uptime_ns / NS)]
    yield "frames_used_total", "counter", "Frames with a model", [({}, float(h.frames_used))]
    dropped: list[Sample] = [({"cause": cause}, float(n)) for cause, n in sorted(h.frames_dropped.items())]
    yield "frames_dropped_total", "counter", "Frames not used, by cause", dropped
    lost: list[Sample] = [({}, float(h.samples_lost))]
    yield "samples_lost_total", "counter", "Attitude and position samples lost before the pipeline", lost
    yield from _cameras(h)
    if h.HasField("autopilot"):
        yield from _autopilot(h.autopilot)
    yield "recording", "gauge", "1 while a log is written", [({}, float(h.recording.recording))]
    yield "recording_bytes", "gauge", "Size of the present log", [({}, float(h.recording.bytes))]
    yield "recording_dropped_total", "counter", "Items not recorded: slow disk", [({}, float(h.recording.dropped))]
    latencies: list[Sample] = []
    for latency in h.latencies:
        for quantile, ms in (("0.5", latency.p50_ms), ("0.95", latency.p95_ms), ("0.99", latency.p99_ms)):
            latencies.append(({"stage": latency.stage, "quantile": quantile}, ms / 1e3))
    yield "latency_seconds", "gauge", "Latency of the newest frames, by stage", latencies
    yield "cpu_share", "gauge", "Load in cores since the report before", [({}, h.cpu_share)]
    yield "memory_bytes", "gauge", "Resident memory", [({}, float(h.memory_bytes))]
    temperatures: list[Sample] = [({"sensor": t.sensor}, t.celsius) for t in h.temperatures]
    yield "temperature_celsius", "gauge", "Temperatures of the computer's sensors", temperatures


def _cameras(h: pb.Health) -> Iterator[tuple[str, str, str, list[Sample]]]:
    each = [({"camera": c.camera}, c) for c in h.cameras]
    yield "camera_blind", "gauge", "1 while the camera is blind", [(n, float(c.blind)) for n, c in each]
    conditions: list[Sample] = [
        ({**n, "condition": code}, float(c.condition == code)) for n, c in each for code in map(str, CameraCondition)
    ]
    yield "camera_condition", "gauge", "1 for the present condition", conditions
    yield "camera_frames_total", "counter", "Frames that arrived", [(n, float(c.frames)) for n, c in each]
    superseded = [(n, float(c.dropped)) for n, c in each]
    yield "camera_superseded_total", "counter", "Frames replaced by a newer one before their use", superseded
    yield "camera_starts_total", "counter", "Starts of the camera process", [(n, float(c.starts)) for n, c in each]
    yield "camera_rate_hertz", "gauge", "Frame rate", [(n, c.hz) for n, c in each]
    ages = [(n, c.age_ns / NS) for n, c in each if c.HasField("age_ns")]
    yield "camera_age_seconds", "gauge", "Age of the newest valid exposure", ages
    offsets = [(n, c.exposure_offset) for n, c in each if c.exposure_offset.HasField("offset_ms")]
    measured: list[Sample] = [(n, o.offset_ms / 1e3) for n, o in offsets]
    yield "camera_exposure_offset_seconds", "gauge", "Measured exposure time offset", measured


def _autopilot(a: pb.AutopilotHealth) -> Iterator[tuple[str, str, str, list[Sample]]]:
    yield "autopilot_link_open", "gauge", "1 while the link to the autopilot is open", [({}, float(a.line_open))]
    connected: list[Sample] = [({}, float(bool(a.autopilot)))]
    yield "autopilot_connected", "gauge", "1 while heartbeats of an autopilot arrive", connected
    if not a.autopilot:
        return
    yield "autopilot_armed", "gauge", "1 while the vehicle is armed", [({}, float(a.armed))]
    yield "autopilot_attitude_hertz", "gauge", "Rate of attitudes", [({}, a.attitude_hz)]
    yield "autopilot_position_hertz", "gauge", "Rate of positions", [({}, a.position_hz)]
    age: list[Sample] = [({}, a.attitude_age_ns / NS)] if a.HasField("attitude_age_ns") else []
    yield "autopilot_attitude_age_seconds", "gauge", "Age of the newest attitude", age
    synchronised = a.clock.source == pb.ClockEstimate.SOURCE_TIMESYNC
    yield "clock_synchronised", "gauge", "1 while TIMESYNC is answered", [({}, float(synchronised))]
    bound: list[Sample] = [({}, a.clock.bound_ns / NS)] if a.clock.HasField("bound_ns") else []
    yield "clock_bound_seconds", "gauge", "Error bound of the autopilot's clock", bound
    yield (
        "clock_restarts_total",
        "counter",
        "Reboots and steps of the autopilot's clock",
        [({}, float(a.clock.restarts))],
    )
    anomalies: list[Sample] = [({"code": code}, float(n)) for code, n in sorted(a.counts.items())]
    yield "autopilot_anomalies_total", "counter", "Rejected or irregular messages, by code", anomalies


def _labels(labels: dict[str, str]) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(value: str) -> str:
    return value.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
