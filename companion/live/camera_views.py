"""The state of each camera as the health report shows it."""

from __future__ import annotations

from collections.abc import Mapping

from ..cameras.supervisor import CameraSupervisor
from ..self_check.exposure_offset import ExposureOffset
from ..self_check.mount_watch import MountWatch
from ..self_check.mount_yaw import MountYaw, add_yaw
from .counts import FrameRates
from .health import CameraView
from .pipeline_thread import PipelineThread
from .staleness import StalenessMonitor


def camera_views(
    cameras: Mapping[str, CameraSupervisor],
    loop: PipelineThread,
    staleness: StalenessMonitor,
    mounts: MountWatch,
    rates: FrameRates,
    now_ns: int,
) -> list[CameraView]:
    """The views of all cameras at one instant. `loop.lock` guards staleness, mounts and the loop's self-checks."""
    views = []
    with loop.lock:
        offsets: dict[str, ExposureOffset] = {offset.camera: offset for offset in loop.exposure_offsets}
        yaws: dict[str, MountYaw] = {yaw.camera: yaw for yaw in loop.mount_yaws}
    for name, camera in cameras.items():
        status = camera.status
        with loop.lock:
            blind = staleness.cause(name, now_ns, status)
            age_ns = staleness.age_ns(name, now_ns)
            mount = mounts.health(name, status.info)
        if mount is not None and name in yaws:
            add_yaw(mount, yaws[name])
        views.append(
            CameraView(
                status=status,
                required=camera.section.required,
                blind=blind,
                age_ns=age_ns,
                hz=rates.hz(name, status.frames, now_ns),
                last_loss_age_ns=None if status.last_loss_ns is None else max(0, now_ns - status.last_loss_ns),
                exposure_offset=offsets.get(name),
                mount=mount,
            )
        )
    return views
