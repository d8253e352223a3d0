"""The live service: makes, starts and stops all parts, and passes data from one to the others.

The main thread calls `tick`: blind cameras, health report and watchdog. docs/research/structure.md lists the other
threads, their locks and queues."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zmq
from google.protobuf.message import Message

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.mavlink.dialect import dialect
from drivers.mavlink.signing import Signing
from osape_client.boot import boot_id

from ..autopilot.session_factory import signing_of
from ..cameras.masks import masks_of, outside_text, unmeasured_mask
from ..cameras.supervisor import CameraSupervisor
from ..config.loader import Config
from ..diagnostic import Diagnostic
from ..log.provenance import run_info
from ..log.recorder import Recorder
from ..paths import Folders
from ..pipeline.configured import make_pipeline
from ..pipeline.events import RawMavlink
from ..pipeline.results import PrismsResult
from ..pipeline.tracking import TracksResult
from ..streams.curve_auth import AllowList, load_keys
from ..streams.publication import PublicationStamps
from ..suspension import Suspension
from .autopilot_parts import AutopilotParts, LinkCallbacks, make_autopilot
from .depth_preview import DepthPreviews
from .event_queue import EventQueue
from .health_reporter import HealthReporter
from .log_feed import ClockCallbacks, LogFeed
from .motion_checks import MotionChecks
from .parts import Parts
from .pipeline_thread import PipelineThread, Receivers
from .staleness import StalenessMonitor
from .stream_output import StreamOutput

if TYPE_CHECKING:
    from ..share.share_service import ShareService
    from .metrics_server import MetricsServer

log = logging.getLogger("companion")

NS = 1_000_000_000


class Service:
    """Call `open`, then `tick` repeatedly, then `close`. `open` raises DriverError, ValueError or OSError where a
    stream's address, a key or the log directory cannot be used."""

    def __init__(
        self,
        config: Config,
        folders: Folders,
        warm_up: Callable[[], None],
        start_text: Callable[[], str] = lambda: "loading kernels",
    ) -> None:
        """warm_up: loads the kernels, in the pipeline's thread; start_text: what it is doing."""
        self.suspension = Suspension()  # before the parts, so that it finds each one that a part finds
        self.config, self._folders, self._start_text = config, folders, start_text
        self._stamps = PublicationStamps(boot_id(), time.monotonic_ns())
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._staleness = StalenessMonitor(tuple(c.name for c in config.cameras), config.service.timeout_s)
        self._raw_mavlink: list[RawMavlink] = []
        self.parts = self._make_parts(warm_up)
        self._output = StreamOutput(config, self._stamps, self._staleness, self.parts.pipeline_thread.lock)
        self.health = HealthReporter(
            config, self.parts, self._output, self._staleness, self._stamps.boot, folders.state
        )

    def _make_parts(self, warm_up: Callable[[], None]) -> Parts:
        """Creates all parts; `open` starts them."""
        config, event_queue = self.config, EventQueue()
        cameras = {c.name: self._supervisor(c.name, event_queue) for c in config.cameras}
        signing = signing_of(config.autopilot, self._folders.state)
        recorder: Recorder | None = None
        if config.record.record != "off":
            place = config.record.place(self._folders.state)
            recorder = Recorder(place, run_info("live", config), config.record, config.output)
        share = self._make_share(recorder)
        autopilot = self._make_autopilot(cameras, signing, share)
        previews = DepthPreviews(self._stamps)
        return Parts(
            cameras=cameras,
            pipeline_thread=self._make_pipeline_thread(event_queue, recorder, autopilot, previews, warm_up),
            event_queue=event_queue,
            previews=previews,
            signing=signing,
            session=autopilot.session,
            link=autopilot.link,
            obstacle_output=autopilot.obstacle_output,
            guard=autopilot.guard,
            share=share,
            recorder=recorder,
            metrics=self._make_metrics(),
        )

    def _make_pipeline_thread(
        self,
        event_queue: EventQueue,
        recorder: Recorder | None,
        autopilot: AutopilotParts,
        previews: DepthPreviews,
        warm_up: Callable[[], None],
    ) -> PipelineThread:
        pipeline = make_pipeline(self.config)
        callbacks = ClockCallbacks(clock=autopilot.clock, armed=autopilot.armed)
        return PipelineThread(
            pipeline,
            event_queue,
            self._staleness,
            Receivers(result=self._publish, tracks=self._publish_tracks, frame=previews.show),
            LogFeed(recorder, self.config.record.record, callbacks, pipeline),
            MotionChecks(masks_of(self.config)),
            warm_up,
        )

    def _supervisor(self, name: str, event_queue: EventQueue) -> CameraSupervisor:
        section = self.config.camera(name)

        def opened(info: CameraInfo) -> None:
            if text := outside_text(section, info):
                log.warning("camera %s: %s", name, text)
            event_queue.put([info])
            with self.parts.pipeline_thread.lock:
                self.health.camera_opened(name)
            if self.parts.obstacle_output is not None:
                self.parts.obstacle_output.announce(info, unmeasured_mask(section, info, least_share))

        least_share = self.config.extractor.min_measured_share
        return CameraSupervisor(section, opened, self._handle_frame, self.config.supervision, least_share=least_share)

    def _make_autopilot(
        self, cameras: Mapping[str, CameraSupervisor], signing: Signing, share: ShareService | None
    ) -> AutopilotParts:
        log_raw = self.config.record.mavlink and self.config.record.record != "off"
        raw = (lambda data, t_ns: self._raw_mavlink.append(RawMavlink(data, t_ns))) if log_raw else None
        callbacks = LinkCallbacks(samples=self._deliver, message=self._handle_mavlink, raw=raw)
        return make_autopilot(self.config, self._folders, cameras, signing, share, callbacks)

    def _make_metrics(self) -> MetricsServer | None:
        """The metrics server, where it is enabled."""
        if self.config.service.metrics_port == 0:
            return None
        from .metrics_server import MetricsServer  # imports a web server: only where it is enabled

        return MetricsServer(self.config.service.metrics_port)

    def _make_share(self, recorder: Recorder | None) -> ShareService | None:
        """The exchange of obstacles with other vehicles, where it is enabled."""
        if not self.config.share.enabled:
            return None
        from ..share.share_service import ShareService  # imported only where it is enabled

        def log(key: str, message: Message, t_ns: int) -> None:
            if recorder is not None:
                recorder.message(key, message, t_ns)  # not by the event queue, where it could displace frames

        return ShareService(self.config, self._folders, self._stamps, log)

    # ---- start and stop -----------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Opens the streams and starts all threads. Cameras and autopilot may be missing; they are retried."""
        parts, publish, run = self.parts, self.config.publish, self._folders.run
        keys = load_keys(Path(publish.keys)) if publish.keys else None
        if keys is not None:
            parts.allow = AllowList(self._context, keys)
        if publish.world:
            from .world_thread import open_world  # imported only where the merged world is enabled

            observer = None if parts.share is None else parts.share.world
            parts.world = open_world(self.config, run, self._context, keys, self._stamps, observer)
        if parts.share is not None:
            parts.share.connect(parts.session, parts.link)
            parts.share.open(self._context, keys)
        self._output.open(run, self._context, keys)
        parts.previews.open(publish.address("depth", run), self._context, keys)
        for part in (
            parts.recorder,
            parts.metrics,
            parts.pipeline_thread,
            parts.link,
            parts.obstacle_output,
            parts.guard,
        ):
            if part is not None:
                part.open()
        for camera in parts.cameras.values():
            camera.open()

    def close(self) -> None:
        """Stops everything and finishes the log. May be called twice. All parts are closed even if one raises; the
        exception is raised at the end.

        In flight the autopilot may depend on the obstacles: blindness is sent to it first, and its link is closed last.
        """
        parts = self.parts
        steps: list[Callable[[], object]] = []
        if parts.guard is not None:  # before the blindness of a stop on purpose could stop the vehicle
            steps.append(parts.guard.close)
        if parts.obstacle_output is not None:
            steps.append(parts.obstacle_output.end)
        if parts.link is not None:
            steps.append(partial(parts.link.set_system_status, dialect.MAV_STATE_CRITICAL))
        steps += [camera.stop for camera in parts.cameras.values()]
        steps += [camera.close for camera in parts.cameras.values()]
        steps.append(parts.pipeline_thread.close)
        rest = (
            parts.recorder,
            parts.share,
            parts.obstacle_output,
            parts.link,
            parts.signing,
            parts.metrics,
            parts.world,
        )
        steps += [part.close for part in rest if part is not None]
        steps += [parts.previews.close, self._output.close, self._close_allow_list]
        steps.append(partial(self._context.destroy, linger=0))
        with ExitStack() as stack:  # makes all calls, even if one raises, in the reverse order
            for step in reversed(steps):
                stack.callback(step)

    def _close_allow_list(self) -> None:
        if self.parts.allow is not None:
            allow, self.parts.allow = self.parts.allow, None
            allow.close()

    # ---- main thread --------------------------------------------------------------------------------------------------

    @property
    def started(self) -> bool:
        """Whether the kernels are loaded and the pipeline runs."""
        return self.parts.pipeline_thread.started.is_set()

    def stalled_part(self) -> str:
        """The first required thread that does not respond within `[service] hang_s`, as text; empty: none."""
        return self.parts.stalled(time.monotonic_ns(), round(self.config.service.hang_s * NS))

    @property
    def diagnostics(self) -> list[Diagnostic]:
        """Those of the newest `tick`."""
        return self.health.diagnostics

    @property
    def diagnostic_texts(self) -> list[str]:
        """The texts of the diagnostics."""
        return [d.text for d in self.diagnostics]

    def tick(self) -> None:
        """Publishes blind frames for blind cameras, and the health report once per second and at each change of state."""
        now_ns = time.monotonic_ns()
        views = self.health.camera_views(now_ns)
        for view in views:
            if view.blind:
                self._output.publish_blind(view, now_ns)
        if any(view.blind for view in views):
            self._output.publish_all_cameras(now_ns, self.parts.camera_statuses())
        autopilot = self.health.autopilot_view(now_ns)
        if self.parts.obstacle_output is not None:
            self.parts.obstacle_output.tick(now_ns, autopilot.status if autopilot is not None else None)
        if self.parts.share is not None:
            self.parts.share.tick(now_ns)
        self.health.update(views, autopilot, None if self.started else self._start_text(), now_ns)

    # ---- other threads ------------------------------------------------------------------------------------------------

    def _handle_frame(self, frame: DepthFrame) -> None:
        """Queues a frame, after the attitudes that arrived before it. Called by the cameras' threads."""
        if self.parts.link is not None:
            self.parts.link.catch_up()
        self.parts.event_queue.put_frame(frame)

    def _deliver(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Queues the samples of one read, its raw messages first. Called from one thread at a time."""
        self.parts.event_queue.put([*self._raw_mavlink, *samples])
        self._raw_mavlink.clear()
        if self.parts.obstacle_output is not None:
            self.parts.obstacle_output.samples(samples)
        if self.parts.share is not None:
            self.parts.share.samples(samples)

    def _handle_mavlink(self, message: Any, arrival_ns: int) -> None:
        if self.parts.obstacle_output is not None:
            self.parts.obstacle_output.message(message, arrival_ns)
        if self.parts.guard is not None:
            self.parts.guard.message(message, arrival_ns)
        if self.parts.share is not None:
            self.parts.share.message(message)

    def _publish(self, result: PrismsResult, prisms: bytes) -> None:
        """Publishes a frame. Called by the pipeline's thread."""
        self._output.publish_prisms(result, prisms)
        if self.parts.obstacle_output is not None:
            self.parts.obstacle_output.result(result)
        if self.parts.world is not None:
            self.parts.world.put(result)
        with self.parts.pipeline_thread.lock:
            self.health.result(result)
            self._output.add_result(result)
        self._output.publish_all_cameras(time.monotonic_ns(), self.parts.camera_statuses())

    def _publish_tracks(self, result: TracksResult, data: bytes) -> None:
        self._output.publish_tracks(result, data)
        if self.parts.share is not None:
            self.parts.share.tracks(result)
