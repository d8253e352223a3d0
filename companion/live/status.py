"""`companion status`: prints the health report of the running service."""

from __future__ import annotations

import argparse
from typing import Any

from core.codes import text_of, texts_of
from drivers.logs.codec import camera_from_message
from drivers.mavlink.anomalies import LinkAnomaly
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.run_folder import run_folder

from ..argument_types import number_in
from ..common_options import add_service
from ..config.loader import load_config
from ..config.obstacle_range import obstacle_range_m
from ..config.service import PublishConfig
from ..console import print_json, print_line
from ..pipeline.mount_messages import mount_text
from ..pipeline.sync import DropCause
from .health import STATES
from .health_stream import newest_health
from .load_text import load_text
from .message_json import message_json

MS, S = 1e6, 1e9
HEARTBEAT_OLD_NS = 3_000_000_000
"""Heartbeats come once a second. An older one does not say what mode the vehicle is in now."""


def _range_text(message: pb.CameraInfo) -> str:
    """Up to where a camera detects obstacles, as text."""
    try:
        info = camera_from_message(message)
    except ValueError as error:
        return f"its description is damaged: {error}"
    return f"obstacles are detected up to {obstacle_range_m(info):.1f} m (depth noise ke_per_m = {info.ke_per_m:g})"


def status_lines(h: pb.Health) -> list[str]:
    """The report as text for people."""
    lines = [f"{STATES.get(h.state, 'unknown').upper()}, service running for {_span(h.uptime_ns)}"]
    lines += [f"  ! {d.code}: {d.text}" for d in h.diagnostics] or ["  OK"]
    if load := load_text(h):
        lines.append(f"  {load}")
    lines += [f"  safety key changed: {key}" for key in h.changed_safety_keys]
    for c in h.cameras:
        lines += _camera_lines(c)
    if h.HasField("autopilot"):
        lines += _autopilot_lines(h.autopilot)
    if h.HasField("team"):
        lines += _team_lines(h.team)
    lines += _log_lines(h.recording)
    lines += _frame_lines(h)
    temperatures = ", ".join(f"{t.sensor} {t.celsius:.0f} C" for t in h.temperatures)
    lines.append(
        f"service: {100.0 * h.cpu_share:.0f} % of a core, {h.memory_bytes / 1e6:.0f} MB"
        + (f", {temperatures}" if temperatures else "")
    )
    return lines


def _camera_lines(c: pb.CameraHealth) -> list[str]:
    age = f"frame age {c.age_ns / MS:.0f} ms" if c.HasField("age_ns") else "no valid frame yet"
    kind = "" if c.required else ", not required"
    lines = [f"camera {c.camera}: {c.condition}{kind}, {c.hz:.1f} Hz, {age}, {c.dropped} superseded{_restarts(c)}"]
    if c.HasField("exposure_offset"):
        lines.append(f"  exposure time offset: {c.exposure_offset.text}")
    if c.HasField("mount"):
        lines.append(f"  mount: {mount_text(c.mount)}")
    if c.HasField("info"):
        lines.append(f"  {_range_text(c.info)}")
    return lines


def _log_lines(r: pb.RecordingHealth) -> list[str]:
    if r.recording:
        lines = [f"log: {r.file}, {r.bytes / 1e6:.1f} MB, {r.dropped} items dropped"]
    else:
        lines = [f"log: not recording{', ' + r.trouble if r.trouble else ''}"]
    if r.repairing:
        lines.append(f"log: repairing {r.repairing}, left unfinished by an earlier run")
    return lines


def _frame_lines(h: pb.Health) -> list[str]:
    """Used and dropped frames, lost samples, and the latency of each stage."""
    dropped = ", ".join(
        f"{count} {code} ({text_of(code, DropCause)})" for code, count in sorted(h.frames_dropped.items())
    )
    lines = [f"frames: {h.frames_used} used" + (f"; dropped: {dropped}" if dropped else ", none dropped")]
    if h.samples_lost:
        lines.append(f"attitude and position samples lost: {h.samples_lost}")
    for latency in h.latencies:
        lines.append(
            f"  {latency.text or latency.stage}: {latency.p50_ms:.1f} / {latency.p95_ms:.1f} / {latency.p99_ms:.1f} ms (p50/p95/p99)"
        )
    return lines


def health_json(h: pb.Health) -> dict[str, Any]:
    """The object of `--json`: the report with enum values as codes, and the texts of codes that are keys."""
    found = message_json(h)
    found["texts"] = texts_of(h.frames_dropped, DropCause) | texts_of(h.autopilot.counts, LinkAnomaly)
    return found


def _restarts(c: pb.CameraHealth) -> str:
    """How often the process of a camera was restarted, when last and why, as text; empty: never."""
    if c.starts <= 1:
        return ""
    count = "once" if c.starts == 2 else f"{c.starts - 1} times"
    last = f"last {_span(c.last_loss_age_ns)} ago: " if c.HasField("last_loss_age_ns") else "last cause: "
    return f", process restarted {count}, {last}{c.last_loss.removeprefix(f'camera {c.camera}: ')}"


def _autopilot_lines(a: pb.AutopilotHealth) -> list[str]:
    if not a.line_open:
        return [f"autopilot: {a.address} is not open: {a.line_error.removeprefix(f'{a.address}: ')}"]
    if not a.autopilot:
        return [f"autopilot: no heartbeat on {a.address}"]
    source = {1: "not synchronised (arrival times only)", 2: "synchronised"}.get(a.clock.source, "unknown")
    bound = f" within {a.clock.bound_ns / MS:.2f} ms" if a.clock.HasField("bound_ns") else ""
    lines = [
        f"autopilot: {a.autopilot}, system {a.system_id}, {a.flight_mode + ', ' if a.flight_mode else ''}{'armed' if a.armed else 'disarmed'}"
        f"{_silence(a)}, attitude {a.attitude_hz:.0f} Hz, position {a.position_hz:.0f} Hz, clock {source}{bound}, clock restarts "
        f"{a.clock.restarts}"
    ]
    anomalies = ", ".join(f"{count} {code} ({text_of(code, LinkAnomaly)})" for code, count in sorted(a.counts.items()))
    return [*lines, f"  {anomalies}"] if anomalies else lines


def _silence(a: pb.AutopilotHealth) -> str:
    """That mode and armed are those of an old heartbeat, as text."""
    if a.heartbeat_age_ns <= HEARTBEAT_OLD_NS:
        return ""
    return f" when its last heartbeat arrived, {a.heartbeat_age_ns / S:.0f} s ago"


def _team_lines(t: pb.TeamHealth) -> list[str]:
    links = "; ".join(
        (f"{k.name} {k.fault}" if k.fault else f"{k.name} {k.sent_bytes_per_s:.0f} B/s sent")
        + (f", {k.unencodable} x out of the packets' range and not sent" if k.unencodable else "")
        for k in t.links
    )
    place = "" if t.frame_known else ", own place on Earth unknown"
    refused = ", ".join(f"{count} {code}" for code, count in sorted(t.received.items()) if code != "accepted")
    lines = [f"team: vehicle {t.vehicle}{place}; {links}" + (f"; refused: {refused}" if refused else "")]
    for n in t.neighbours:
        fit = f", fit {n.fit}" if n.fit and n.placement != "aligned" else ""
        lines.append(
            f"  vehicle {n.vehicle}: {n.planes} planes, {n.movers} moving, {n.withheld} withheld, newest packet "
            f"{n.silent_s:.1f} s ago, frame {n.placement} within {n.sigma_m:.1f} m{fit}"
        )
    return lines


def _span(ns: int) -> str:
    seconds = ns / S
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def add_parser(subparsers: Any) -> None:
    """The command line of `companion status`."""
    parser = subparsers.add_parser("status")
    add_service(parser)
    parser.add_argument(
        "--timeout",
        type=number_in(float, 0.1, 3600.0),
        default=3.0,
        metavar="S",
        help="time limit for a report (default: 3 s)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: the service detects obstacles; 1: it is blind or starting, or sends no report."""
    publish = PublishConfig() if args.config is None else load_config(args.config).publish
    report = newest_health(publish.address("health", run_folder()), args.timeout)
    if args.json:
        print_json(health_json(report))
    else:
        for line in status_lines(report):
            print_line(line)
    return 0 if report.state in (pb.Health.STATE_ACTIVE, pb.Health.STATE_DEGRADED) else 1
