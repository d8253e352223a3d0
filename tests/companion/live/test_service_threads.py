"""An exception in any thread of the service has the consequence that docs/reference/service.md names, and is never silent."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.cameras.supervisor import CameraSupervisor
from companion.config.avoidance import AvoidParams
from companion.config.camera import CameraConfig
from companion.config.loader import Config
from companion.config.service import AutopilotConfig, PublishConfig, RecordParams, ServiceParams
from companion.live.depth_preview import DepthPreviews
from companion.live.run import serve
from companion.live.sd_notify import Notifier
from companion.live.service import Service
from companion.paths import Folders
from companion.streams.publication import PublicationStamps
from companion.suspension import Suspension
from drivers.mavlink.dialect import dialect
from tests.ports import free_port
from tests.waiting import until

pytestmark = [
    pytest.mark.process,
    pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning"),
]


def broken(*_: object, **__: object) -> None:
    raise RuntimeError("injected")


def service_in(folder: Path) -> Service:
    """With every thread but that of a camera's process and that of keys."""
    config = Config(
        cameras=(CameraConfig(name="front", kind="simulated"),),
        autopilot=AutopilotConfig(address=f"udpin:127.0.0.1:{free_port()}"),
        avoid=AvoidParams(send=True, stop_hold_s=0.0),
        record=RecordParams(least_free_mb=1.0),
        publish=PublishConfig(world="ipc://{run}/world", world_requests="ipc://{run}/world-snapshot"),
        service=ServiceParams(metrics_port=free_port()),
    )
    service = Service(config, Folders(folder, folder), lambda: None)
    camera = service.parts.cameras["front"]

    def no_process() -> str:
        camera._stop.wait()
        return "the service stops"

    camera._run_process = no_process  # type: ignore[method-assign]
    return service


@contextmanager
def served(service: Service) -> Iterator[list[int]]:
    """Runs the loop of `companion run`; its status, when it has ended."""
    stop, status = threading.Event(), list[int]()
    loop = threading.Thread(target=lambda: status.append(serve(service, Notifier(), stop, 0.02)))
    try:
        service.open()
        loop.start()
        assert until(lambda: service.started and service.diagnostic_texts)
        yield status
    finally:
        stop.set()
        if loop.ident is not None:
            loop.join(60.0)
        service.close()


class Autopilot:
    """An armed ArduPilot on UDP that keeps the messages it receives."""

    def __init__(self, service: Service) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        _, host, port = service.config.autopilot.address.split(":")
        self._service = (host, int(port))

    def send_heartbeat(self) -> None:
        """An autopilot repeats it: a datagram sent before the service has bound its port is lost."""
        encoder = dialect.MAVLink(None, 1, 1)
        heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 128, 0, 4, 3)
        self._socket.sendto(heartbeat.pack(encoder), self._service)

    def received_cm(self) -> list[int]:
        """Ids of the messages that came and were not taken yet."""
        ids, decoder = list[int](), dialect.MAVLink(None)
        while True:
            try:
                data = self._socket.recv(2048)
            except BlockingIOError:
                return ids
            ids += [m.get_msgId() for m in decoder.parse_buffer(bytearray(data)) or []]

    def close(self) -> None:
        self._socket.close()


def of_pipeline(service: Service) -> None:
    service.parts.event_queue.take = broken  # type: ignore[assignment,method-assign]


def of_line(service: Service) -> None:
    assert service.parts.session is not None
    service.parts.session.receive = broken  # type: ignore[assignment,method-assign]


def of_sender(service: Service) -> None:
    assert service.parts.obstacle_output is not None
    ask = service.parts.obstacle_output.sender._ask

    def once() -> object:
        if threading.current_thread().name == "obstacles":
            raise RuntimeError("injected")
        return ask()

    service.parts.obstacle_output.sender._ask = once  # type: ignore[assignment]


def of_camera(service: Service) -> None:
    service.parts.cameras["front"]._set_condition = broken  # type: ignore[method-assign]
    service.parts.cameras["front"]._run_process = broken  # type: ignore[assignment,method-assign]


def wait_for_report(service: Service, autopilot: Autopilot) -> None:
    """Sends heartbeats until obstacles were reported to the autopilot."""

    def reported() -> bool:
        autopilot.send_heartbeat()
        return service.parts.obstacle_output is not None and service.parts.obstacle_output.report is not None

    assert until(reported)


@pytest.mark.parametrize(
    ("inject", "name"),
    [
        (of_pipeline, "the pipeline has ended: RuntimeError: injected"),
        (of_line, "the link to the autopilot has ended: RuntimeError: injected"),
        (of_sender, "the obstacle sender has ended: RuntimeError: injected"),
    ],
)
def test_the_service_ends_with_the_cause_and_the_autopilot_receives_blindness(
    inject: Callable[[Service], None], name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    service = service_in(tmp_path)
    with served(service) as status:
        autopilot = Autopilot(service)
        wait_for_report(service, autopilot)
        inject(service)
        assert until(lambda: status == [1])
        assert name in caplog.text
        service.tick()
        assert service.diagnostics[0].line() == f"thread_stalled: {name}"
        autopilot.received_cm()
        service.close()
        assert 330 in autopilot.received_cm(), "the blind policy's wall is what it hears last"
        autopilot.close()


def test_the_service_ends_when_the_computer_was_suspended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """CLOCK_MONOTONIC stands still meanwhile: what was seen free before it counted as of the last moment."""
    service, clock, suspended_ns = service_in(tmp_path), time.clock_gettime_ns, [0]

    def gettime_ns(which: int) -> int:
        return clock(which) + (suspended_ns[0] if which == time.CLOCK_BOOTTIME else 0)

    monkeypatch.setattr(time, "clock_gettime_ns", gettime_ns)
    with served(service) as status:
        autopilot = Autopilot(service)
        wait_for_report(service, autopilot)
        time.sleep(0.2)
        assert status == []
        suspended_ns[0] = 60_000_000_000
        assert until(lambda: status == [1])
        assert "the computer was suspended for 60.0 s" in caplog.text
        autopilot.received_cm()
        service.close()
        assert 330 in autopilot.received_cm()
        autopilot.close()


def test_a_pause_of_the_process_between_two_clocks_is_no_suspension(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = time.clock_gettime_ns

    def paused(which: int) -> int:
        now_ns = clock(which)
        time.sleep(0.05)
        return now_ns

    monkeypatch.setattr(time, "clock_gettime_ns", paused)
    suspension = Suspension()
    assert [suspension.fault() for _ in range(3)] == [""] * 3
    monkeypatch.setattr(time, "clock_gettime_ns", clock)
    assert suspension.fault() == ""


def test_the_service_ends_when_the_supervision_of_a_camera_does(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    service = service_in(tmp_path)
    of_camera(service)
    with served(service) as status:
        assert until(lambda: status == [1])
        assert "the supervision of camera front has ended: RuntimeError: injected" in caplog.text


def of_recorder(service: Service) -> None:
    assert service.parts.recorder is not None
    service.parts.recorder._queue.take = broken  # type: ignore[method-assign]


def of_world(service: Service) -> None:
    assert service.parts.world is not None
    service.parts.world._take = broken  # type: ignore[method-assign]


def of_metrics(service: Service) -> None:
    assert service.parts.metrics is not None
    assert service.parts.metrics._server is not None
    service.parts.metrics._server.service_actions = broken  # type: ignore[method-assign]


def of_signing(service: Service) -> None:
    clock = type(service.parts.signing._clock)(Path(service._folders.state) / "signing")
    service.parts.signing._clock = clock
    clock._reserve = broken  # type: ignore[method-assign]
    clock._wanted.set()


@pytest.mark.parametrize(
    ("inject", "name"),
    [
        (of_recorder, "recording has ended (RuntimeError: injected)"),
        (of_world, "the merged world has ended (RuntimeError: injected)"),
        (of_metrics, "no metrics: the metrics server has ended (RuntimeError: injected)"),
        (of_signing, "timestamps of signatures are not saved (RuntimeError: injected)"),
    ],
)
def test_the_flight_goes_on_and_what_ended_is_named(
    inject: Callable[[Service], None], name: str, tmp_path: Path
) -> None:
    service = service_in(tmp_path)
    with served(service) as status:
        inject(service)
        assert until(lambda: any(name in fault for fault in service.diagnostic_texts)), service.diagnostic_texts
        time.sleep(0.2)
        assert status == []
        assert service.parts.pipeline_thread.failure == ""


def test_an_error_in_a_viewers_image_ends_its_stream_only(monkeypatch: pytest.MonkeyPatch) -> None:
    previews = DepthPreviews(PublicationStamps("boot"))

    def bad(frame: object) -> None:
        raise ValueError("injected")

    monkeypatch.setattr(previews, "_show", bad)
    previews.show(None)  # type: ignore[arg-type]
    assert previews.fault == "no depth images for viewers any more (ValueError: injected)"


def test_a_part_that_raises_keeps_no_other_from_being_closed(tmp_path: Path) -> None:
    service = service_in(tmp_path)
    with served(service):
        pass
    closed: list[str] = []
    service.parts.cameras["front"].close = broken  # type: ignore[method-assign]
    service.parts.pipeline_thread.close = broken  # type: ignore[method-assign]
    assert service.parts.recorder is not None
    assert service.parts.link is not None
    service.parts.recorder.close = lambda: closed.append("recorder")  # type: ignore[method-assign]
    service.parts.link.close = lambda: closed.append("line")  # type: ignore[method-assign]
    with pytest.raises(RuntimeError, match="injected"):
        service.close()
    assert closed == ["recorder", "line"]
    assert service._context.closed


def test_all_cameras_are_stopped_before_one_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may take seconds where the kernel holds its process, and the unit limits the time of all together."""
    cameras = tuple(CameraConfig(name=name, kind="simulated") for name in ("front", "left", "right"))
    service = Service(
        Config(cameras=cameras, record=RecordParams(record="off")), Folders(tmp_path, tmp_path), lambda: None
    )
    stopping: list[int] = []
    close = CameraSupervisor.close

    def noted(camera: CameraSupervisor) -> None:
        stopping.append(sum(c._stop.is_set() for c in service.parts.cameras.values()))
        close(camera)

    monkeypatch.setattr(CameraSupervisor, "close", noted)
    service.close()
    assert stopping == [3, 3, 3]
