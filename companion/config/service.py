"""The sections of the configuration that only a live service reads: autopilot, streams, recording, supervision."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from core.param_field import check, choice, critical, number, switch, text
from drivers.mavlink.address import parse_address

from .endpoints import RUN, forms_text, is_endpoint


def check_line(key: str, address: str) -> None:
    """Raises ValueError that names the key for an address of a line that cannot be used. Empty: no line."""
    try:
        if address:
            parse_address(address)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotConfig:
    """The line to the autopilot and what is asked of it."""

    address: str = text(
        "",
        "serial:/dev/serial/by-id/NAME:BAUD (without BAUD: 921600), udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT "
        "(IPv6 in brackets); empty: none",
    )
    system_id: int = number(
        0,
        0,
        255,
        "",
        "system id of the vehicle; 0: taken from its heartbeat, and all cameras are blind while several vehicles are received",
    )
    component_id: int = number(
        196, 2, 255, "", "component id of the service; 196 is obstacle avoidance, 1 is the autopilot itself"
    )
    attitude_hz: float = number(
        100.0,
        5.0,
        400.0,
        "Hz",
        "requested rate of the attitude; larger: smaller errors in turns, more load on the line",
    )
    position_hz: float = number(30.0, 1.0, 200.0, "Hz", "rate of the position that is requested")
    signing_key: str = text("", "key file of MAVLink 2 signing (`companion keys --signing FILE`); empty: no signing")

    computer_status: bool = switch(False, "send ONBOARD_COMPUTER_STATUS (load, temperature, memory) once per second")

    def __post_init__(self) -> None:
        check("autopilot", self)
        check_line("[autopilot] address", self.address)


STREAMS = ("prisms", "health", "surround", "tracks")
WORLD_STREAMS = ("world", "world_requests")
"""Neither or both: changes of the merged world, and snapshots on request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishConfig:
    """Where the streams are. {run} stands for the service's run folder, which `address` inserts."""

    prisms: str = text(
        "ipc://{run}/prisms",
        "address of the obstacle stream: ipc://PATH, or tcp://HOST:PORT (IPv6 in brackets); empty: none",
    )
    health: str = text("ipc://{run}/health", "address of the health reports")
    surround: str = text(
        "ipc://{run}/surround", "address of the joint model of all cameras, where several are configured"
    )
    tracks: str = text("ipc://{run}/tracks", "address of the tracked obstacles, where [tracking] is enabled")
    world: str = text(
        "", "address of the changes of the merged world, such as ipc://{run}/world; empty: no merged world"
    )
    world_requests: str = text(
        "", "address at which snapshots of the merged world are requested, such as ipc://{run}/world-snapshot"
    )
    neighbours: str = text(
        "ipc://{run}/neighbours", "address of the obstacles that other vehicles have reported, where [share] is enabled"
    )
    depth: str = text(
        "ipc://{run}/depth",
        "address of small depth images for `companion view --live`, five a second of each camera, made only while a client listens; empty: none",
    )
    keys: str = text("", "directory of the CURVE keys (`companion keys`), needed for tcp:// addresses")

    def __post_init__(self) -> None:
        check("publish", self)
        places: dict[str, str] = {}
        if bool(self.world) != bool(self.world_requests):
            raise ValueError("[publish] world and world_requests: give both addresses, or neither")
        for name in (*STREAMS, *WORLD_STREAMS, "neighbours", "depth"):
            address = getattr(self, name)
            if address and not is_endpoint(address):
                raise ValueError(f'[publish] {name} = "{address}": expected {forms_text(address)}')
            if address and address in places:
                other = places[address]
                raise ValueError(f'[publish] {other} and {name} have the same address "{address}"; give each its own')
            places[address] = name

    def address(self, stream: str, run: Path) -> str:
        """The address of a stream; empty: none. run: the service's run folder."""
        return str(getattr(self, stream)).replace(RUN, str(run))


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordParams:
    """Where, when and how much is recorded."""

    record: str = choice("always", ("always", "armed", "off"), "always, only while the vehicle is armed, or off")
    folder: str = text("", "directory of the logs; empty: below the state directory of the service")
    file_mb: float = number(512.0, 1.0, 4096.0, "MB", "a new file is begun at this size")
    file_s: float = number(600.0, 5.0, 7200.0, "s", "a new file is begun at this age")
    budget_mb: float = number(
        16384.0,
        10.0,
        1e6,
        "MB",
        "greatest size of all logs; files from before arming, then the oldest flights, are deleted",
    )
    least_free_mb: float = number(
        256.0,
        1.0,
        1e5,
        "MB",
        "kept free: recording stops before less is left, and begins where queue_mb and 9 MB more are free",
    )
    queue_mb: float = number(64.0, 4.0, 1024.0, "MB", "greatest amount of data waiting for the disk")
    queue_items: int = number(5000, 100, 100_000, "", "greatest number of items waiting for the disk")
    zstd_level: int = number(-1, -20, 9, "", "compression level; a lower level is faster and gives larger files")
    depth: bool = switch(True, "record depth images; without them a log cannot be replayed")
    depth_hz: float = number(
        0.0,
        0.0,
        60.0,
        "Hz",
        "greatest rate of the recorded depth images of each camera; 0: every image. Images between cannot be replayed",
    )
    mavlink: bool = switch(True, "record the MAVLink messages of the autopilot")

    def __post_init__(self) -> None:
        check("record", self)
        if self.file_mb >= self.budget_mb:
            raise ValueError(f"[record] file_mb = {self.file_mb:g} must be less than budget_mb = {self.budget_mb:g}")

    def place(self, state: Path) -> Path:
        """The directory of the logs. state: that of the service's state."""
        return Path(os.path.expanduser(self.folder)) if self.folder else state / "logs"


@dataclass(frozen=True, slots=True, kw_only=True)
class SupervisorParams:
    """When a camera is reported as faulty and when its process is restarted."""

    silent_s: float = critical(0.5, 0.05, 10.0, "s", "a camera without a frame for this time counts as silent")
    restart_s: float = critical(
        3.0, 0.5, 60.0, "s", "the process of a camera silent or frozen for this time is started again"
    )
    open_s: float = number(
        30.0, 1.0, 300.0, "s", "the process of a camera without a first frame after this time is started again"
    )
    frozen_frames: int = critical(
        4, 2, 1000, "", "repetitions of one image after which a camera counts as frozen; below 14 Hz fewer"
    )
    first_backoff_s: float = number(
        0.5, 0.0, 60.0, "s", "wait before a restart; doubled while the camera gives no frames"
    )
    longest_backoff_s: float = number(5.0, 0.1, 600.0, "s", "longest wait before a restart")

    def __post_init__(self) -> None:
        check("supervision", self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceParams:
    """The service itself."""

    timeout_s: float = critical(
        0.3,
        0.05,
        2.0,
        "s",
        "a camera is blind when its newest valid exposure is older; larger: blindness is reported later",
    )
    hang_s: float = critical(
        2.0,
        0.5,
        30.0,
        "s",
        "a loop without a cycle for this time counts as stalled, and the watchdog ends the service",
    )
    metrics_port: int = number(0, 0, 65535, "", "port of the Prometheus metrics on 127.0.0.1; 0: none")

    def __post_init__(self) -> None:
        check("service", self)
