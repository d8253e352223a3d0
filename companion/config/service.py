"""The sections of the configuration that only a live service reads: autopilot, streams, recording, supervision."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, choice, critical, number, switch, text


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotConfig:
    """The line to the autopilot and what is asked of it."""

    address: str = text(
        "", "serial:/dev/serial/by-id/NAME:BAUD, udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT; empty: none"
    )
    system_id: int = number(0, 0, 255, "", "of the vehicle; 0: learned from its heartbeat")
    component_id: int = number(196, 1, 255, "", "ours; 196 is obstacle avoidance")
    attitude_hz: float = number(100.0, 5.0, 400.0, "Hz", "wanted rate of the attitude")
    position_hz: float = number(30.0, 1.0, 200.0, "Hz", "wanted rate of the position")
    signing_key: str = text(
        "", "file of the key of MAVLink 2 signatures (`companion keys --signing FILE`); empty: nothing is signed"
    )

    computer_status: bool = switch(False, "tell ground stations how this computer is (ONBOARD_COMPUTER_STATUS, 1 Hz)")

    def __post_init__(self) -> None:
        check("autopilot", self)


STREAMS = ("prisms", "health", "surround")
WORLD_STREAMS = ("world", "world_requests")
"""Neither or both: changes of the merged world, and snapshots on request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishConfig:
    """Where the streams are. {run} stands for the service's run folder."""

    prisms: str = text("ipc://{run}/prisms", "address of the prisms: ipc://PATH, or tcp://HOST:PORT; empty: none")
    health: str = text("ipc://{run}/health", "address of the health reports")
    surround: str = text("ipc://{run}/surround", "address of all cameras as one model, where there are several")
    world: str = text("", "address of the merged world's changes, ipc://{run}/world; empty: nothing is merged")
    world_requests: str = text("", "and where snapshots of it are asked for, ipc://{run}/world-snapshot")
    depth: str = text(
        "ipc://{run}/depth",
        "small depth images for `companion view --live`, made only while somebody listens; empty: none",
    )
    depth_hz: float = number(5.0, 0.5, 15.0, "Hz", "of these of each camera, at most")
    keys: str = text("", "folder of the keys (`companion keys`), needed beyond this machine")

    def __post_init__(self) -> None:
        check("publish", self)
        places: dict[str, str] = {}
        if bool(self.world) != bool(self.world_requests):
            raise ValueError("[publish] world and world_requests: give both addresses, or neither")
        for name in (*STREAMS, *WORLD_STREAMS, "depth"):
            address = getattr(self, name)
            if address and not address.startswith(("ipc://", "tcp://")):
                raise ValueError(f'[publish] {name} = "{address}": expected ipc://PATH or tcp://HOST:PORT')
            if address and address in places:
                other = places[address]
                raise ValueError(f'[publish] {other} and {name} have the same address "{address}"; give each its own')
            places[address] = name


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordParams:
    """Where, when and how much is recorded."""

    record: str = choice("always", ("always", "armed", "off"), "always, while the vehicle is armed, or off")
    folder: str = text("", "of the logs; empty: the service's state folder")
    file_mb: float = number(512.0, 1.0, 4096.0, "MB", "a file is closed and a new one begun at this size")
    file_s: float = number(600.0, 5.0, 7200.0, "s", "or at this age")
    budget_mb: float = number(16384.0, 10.0, 1e6, "MB", "all logs together; the oldest finished flights go first")
    least_free_mb: float = number(256.0, 1.0, 1e5, "MB", "with less free space on the disk nothing is recorded")
    queue_mb: float = number(64.0, 4.0, 1024.0, "MB", "waiting for the disk, at most")
    queue_items: int = number(5000, 100, 100_000, "", "and so many items")
    zstd_level: int = number(-1, -20, 9, "", "compression level; a lower level is faster and gives larger files")
    depth: bool = switch(True, "the depth images too: without them nothing can be replayed")
    mavlink: bool = switch(True, "the autopilot's messages as they came")
    drawings: bool = switch(
        False, "the prisms drawn, for viewers; costs time in flight, `companion replay -o` adds them"
    )

    def __post_init__(self) -> None:
        check("record", self)
        if self.file_mb >= self.budget_mb:
            raise ValueError(f"record: file_mb = {self.file_mb:g} must be less than budget_mb = {self.budget_mb:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SupervisorParams:
    """When a camera is called ill and when its process is started anew."""

    silent_s: float = critical(0.5, 0.05, 10.0, "s", "without a frame for this long a camera is silent")
    restart_s: float = critical(3.0, 0.5, 60.0, "s", "silent or frozen for this long, its process is started anew")
    open_s: float = number(30.0, 1.0, 300.0, "s", "a process without a first frame by then is started anew")
    frozen_frames: int = critical(4, 2, 1000, "", "the same image so many times again is a frozen camera")
    first_backoff_s: float = number(0.5, 0.0, 60.0, "s", "wait before a new start; doubled while it gives no frames")
    longest_backoff_s: float = number(5.0, 0.1, 600.0, "s", "longest wait before a new start")

    def __post_init__(self) -> None:
        check("supervision", self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceParams:
    """The service itself."""

    stale_s: float = critical(0.3, 0.05, 2.0, "s", "a camera whose newest valid exposure is older is blind")
    blind_hz: float = critical(12.5, 10.0, 50.0, "Hz", "rate of the messages that say so")
    hang_s: float = critical(2.0, 0.5, 30.0, "s", "a loop that has not gone round for this long hangs")
    metrics_port: int = number(0, 0, 65535, "", "Prometheus text on 127.0.0.1; 0: none")

    def __post_init__(self) -> None:
        check("service", self)
