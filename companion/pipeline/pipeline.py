"""The one pipeline, live and in replay: events in the order of their arrival go in, what they say comes out.

It holds no clock, file or socket; what it decides depends on the events alone (and on the state it was started with),
so the same events give the same results, bit for bit.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.frames import Vector, level_cam_at, rotation_from_quaternion
from core.invalid_model import invalid_model
from core.self_check.mount_check import MountState, MountVerdict, checked, due
from core.self_check.mount_params import MountCheckParams
from core.types import AttitudeSample, CameraInfo, DepthFrame, ExtractorState, FrameModel, InvalidCause, PoseSample
from drivers.base import Event

from ..cameras.masks import Mask, apply_mask
from ..config.sync import SyncParams
from .sync import NS, AttitudeAt, DropCause, PoseAt, Source, Synchroniser
from .transform import LevelTransform, transform_model

UNPUBLISHED_DROPS = frozenset({DropCause.DUPLICATE_FRAME, DropCause.LATE_FRAME})
"""Dropped without a message of their own: the same or a newer exposure has been published already."""


class FrameExtractor(Protocol):
    """What the pipeline needs of core.extractor.Extractor."""

    def extract(
        self,
        depth: NDArray[np.uint16],
        info: CameraInfo,
        R_level_optical: NDArray[np.float64],
        state: ExtractorState | None = ...,
        *,
        keep_strips: bool = ...,
    ) -> tuple[FrameModel, ExtractorState]: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameDecision:
    """Whether a frame was used, and if not, why. attitude_cutoff_ns: the newest attitude that had arrived by then."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    cause: DropCause
    attitude: Source = Source.NONE
    attitude_cutoff_ns: int | None = None
    pose: Source = Source.NONE
    pose_text: str = ""

    @property
    def used(self) -> bool:
        """Whether the extractor saw it."""
        return self.cause is DropCause.NONE


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PrismsResult:
    """What one frame says, in `frame` ("level" or "ned"). model None: it was dropped; drop says why."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    frame: str
    drop: DropCause
    model: FrameModel | None
    attitude: AttitudeAt | None = None
    pose: PoseAt | None = None
    transform: LevelTransform | None = None
    mount: MountState | None = None
    """What is known of the camera's mount after this frame; None: the frame was dropped."""

    @property
    def valid(self) -> bool:
        """Whether anything may be read from it; False: blind."""
        return self.model is not None and self.model.valid

    @property
    def cause(self) -> DropCause | InvalidCause:
        """Why it is not valid; NONE when it is."""
        return self.drop if self.model is None else self.model.cause

    @property
    def cause_text(self) -> str:
        """The text of `cause`, for people; empty when it is valid."""
        return self.cause.text


Output = FrameDecision | PrismsResult


@dataclass(frozen=True, slots=True)
class CameraState:
    """What one camera's frames hand on."""

    extractor: ExtractorState = field(default_factory=ExtractorState)
    last_t_exposure_ns: int | None = None
    mount: MountState = field(default_factory=MountState)


@dataclass(frozen=True, slots=True)
class PipelineState:
    """All that later frames depend on; a pipeline started with it goes on as the one it was taken from."""

    cameras: tuple[tuple[str, CameraState], ...] = ()
    attitudes: tuple[AttitudeSample, ...] = ()
    poses: tuple[PoseSample, ...] = ()


class Pipeline:
    """Depth, attitude and position in; decisions and prisms out. One extractor a camera, made by `make_extractor`."""

    def __init__(
        self,
        cameras: Sequence[CameraInfo],
        make_extractor: Callable[[CameraInfo], FrameExtractor],
        sync: SyncParams | None = None,
        state: PipelineState | None = None,
        mask: Callable[[CameraInfo], Mask | None] = lambda info: None,
        mount_check: MountCheckParams | None = None,
    ) -> None:
        """mask: which pixels of a camera's images are unknown whatever they hold."""
        self._mount_check = mount_check or MountCheckParams()
        self._infos = {info.camera: info for info in cameras}
        if len(self._infos) != len(cameras):
            raise ValueError("pipeline: two cameras have the same name; give each its own")
        self._make_extractor = make_extractor
        self._extractors = {info.camera: make_extractor(info) for info in cameras}
        self._mask = mask
        self._masks = {info.camera: mask(info) for info in cameras}
        self._sync = Synchroniser(sync or SyncParams())
        self._states = {info.camera: CameraState() for info in cameras}
        self.counts: Counter[str] = Counter()
        if state is not None:
            self._resume(state)

    def _resume(self, state: PipelineState) -> None:
        for name, camera in state.cameras:
            if name in self._states:
                self._states[name] = camera
        for attitude in state.attitudes:
            self._sync.attitudes.add(attitude)
        for pose in state.poses:
            self._sync.poses.add(pose)

    def state(self) -> PipelineState:
        """A snapshot that another pipeline can be started with."""
        return PipelineState(tuple(self._states.items()), self._sync.attitudes.samples, self._sync.poses.samples)

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """Those announced, as they are used."""
        return tuple(self._infos.values())

    def announce(self, info: CameraInfo) -> None:
        """A camera that was opened. One that is described otherwise than before begins anew."""
        if self._infos.get(info.camera) == info:
            return
        self._infos[info.camera] = info
        self._extractors[info.camera] = self._make_extractor(info)
        self._masks[info.camera] = self._mask(info)
        self._states[info.camera] = CameraState()

    def superseded(self, camera: str, sequence: int, t_exposure_ns: int, t_arrival_ns: int) -> FrameDecision:
        """The decision on a frame that a newer one replaced before it came here; it changes nothing."""
        return FrameDecision(
            camera=camera,
            sequence=sequence,
            t_exposure_ns=t_exposure_ns,
            t_arrival_ns=t_arrival_ns,
            cause=DropCause.BUSY,
            attitude_cutoff_ns=self._sync.attitudes.newest_ns,
        )

    @property
    def newest_attitude_ns(self) -> int | None:
        """Stamp of the newest attitude held."""
        return self._sync.attitudes.newest_ns

    def sample_anomalies(self) -> dict[str, int]:
        """How many attitudes and positions came twice, late or after a restart."""
        kinds = (("attitude", self._sync.attitudes.counts), ("pose", self._sync.poses.counts))
        return {f"{kind}_{anomaly}": n for kind, counts in kinds for anomaly, n in sorted(counts.items())}

    def handle(self, event: Event) -> tuple[Output, ...]:
        """What one event leads to: nothing for a sample; for a frame its decision and, unless the same or a newer
        exposure has been handled, its prisms. Raises ValueError for a camera that was not announced."""
        if isinstance(event, AttitudeSample):
            self._sync.attitudes.add(event)
            return ()
        if isinstance(event, PoseSample):
            self._sync.poses.add(event)
            return ()
        return self._frame(event)

    def _frame(self, frame: DepthFrame) -> tuple[Output, ...]:
        info = self._infos.get(frame.camera)
        if info is None:
            raise ValueError(
                f"pipeline: a frame of the unknown camera {frame.camera!r}; known: {', '.join(self._infos)}"
            )
        cause = self._check_order(frame, info)
        attitude = self._sync.attitude_at(frame.t_exposure_ns) if cause is DropCause.NONE else cause
        if isinstance(attitude, DropCause):
            return self._drop(frame, attitude)
        pose = self._sync.pose_at(frame.t_exposure_ns) if self._sync.params.use_pose else "switched off"
        result = self._extract(frame, info, attitude, pose if isinstance(pose, PoseAt) else None)
        decision = FrameDecision(
            camera=frame.camera,
            sequence=frame.sequence,
            t_exposure_ns=frame.t_exposure_ns,
            t_arrival_ns=frame.t_arrival_ns,
            cause=DropCause.NONE,
            attitude=attitude.source,
            attitude_cutoff_ns=self._sync.attitudes.newest_ns,
            pose=pose.source if isinstance(pose, PoseAt) else Source.NONE,
            pose_text="" if isinstance(pose, PoseAt) else pose,
        )
        return decision, result

    def _check_order(self, frame: DepthFrame, info: CameraInfo) -> DropCause:
        """Whether the frame fits its camera and comes after what was handled; a camera that restarted begins anew."""
        last = self._states[frame.camera].last_t_exposure_ns
        if last is not None and frame.t_exposure_ns <= last - round(self._sync.params.restart_step_s * NS):
            self._states[frame.camera] = CameraState()
            self.counts["camera_restarts"] += 1
            last = None
        if last is not None and frame.t_exposure_ns <= last:
            return DropCause.DUPLICATE_FRAME if frame.t_exposure_ns == last else DropCause.LATE_FRAME
        self._states[frame.camera] = dataclasses.replace(
            self._states[frame.camera], last_t_exposure_ns=frame.t_exposure_ns
        )
        if frame.depth_mm.shape != (info.intrinsics.height, info.intrinsics.width):
            return DropCause.WRONG_SIZE
        return DropCause.NONE

    def _extract(self, frame: DepthFrame, info: CameraInfo, attitude: AttitudeAt, pose: PoseAt | None) -> PrismsResult:
        R_level_optical, camera_rad, vehicle_rad, lever_ned_m = level_cam_at(attitude.q_ned_frd_wxyz, info.mount)
        transform = transform_from_level_cam(camera_rad, vehicle_rad, lever_ned_m, pose)
        state = self._states[frame.camera]
        extractor = self._extractors[frame.camera]
        depth_mm = apply_mask(frame.depth_mm, self._masks[frame.camera])
        model, after = extractor.extract(
            depth_mm,
            info,
            R_level_optical,
            state=seed_ground_height(state.extractor, pose, transform),
            keep_strips=False,
        )
        if not model.ground.seen:  # a height told by the pose is not carried on as one that was seen
            after = dataclasses.replace(after, ground_height_m=state.extractor.ground_height_m)
        mount = state.mount
        if model.valid and due(mount, frame.t_exposure_ns, self._mount_check):
            mount = self._update_mount(frame, depth_mm, info, attitude, R_level_optical, camera_rad, model.ke_per_m)
        model = invalidate_if_mount_wrong(model, mount)
        self._states[frame.camera] = CameraState(after, state.last_t_exposure_ns, mount)
        return PrismsResult(
            camera=frame.camera,
            sequence=frame.sequence,
            t_exposure_ns=frame.t_exposure_ns,
            t_arrival_ns=frame.t_arrival_ns,
            frame="level" if pose is None else "ned",
            drop=DropCause.NONE,
            model=transform_model(model, transform),
            attitude=attitude,
            pose=pose,
            transform=transform,
            mount=mount,
        )

    def _update_mount(
        self, frame: DepthFrame, depth_mm: NDArray[np.uint16], info: CameraInfo, attitude: AttitudeAt,
        R_level_optical: NDArray[np.float64], camera_rad: float, ke_per_m: float,
    ) -> MountState:  # fmt: skip
        """The state of the mount's check after this frame. camera_rad: the camera's heading."""
        from core.self_check.mount_cues import cues_of
        from core.self_check.surfaces import find_surfaces  # compiled: planners, who only read, need no numba

        cues = cues_of(find_surfaces(depth_mm, info, R_level_optical, ke_per_m))
        return checked(
            self._states[frame.camera].mount, frame.t_exposure_ns, cues,
            rotation_from_quaternion(attitude.q_ned_frd_wxyz), camera_rad, self._mount_check,
        )  # fmt: skip

    def _drop(self, frame: DepthFrame, cause: DropCause) -> tuple[Output, ...]:
        decision = FrameDecision(
            camera=frame.camera,
            sequence=frame.sequence,
            t_exposure_ns=frame.t_exposure_ns,
            t_arrival_ns=frame.t_arrival_ns,
            cause=cause,
            attitude_cutoff_ns=self._sync.attitudes.newest_ns,
        )
        if cause in UNPUBLISHED_DROPS:
            return (decision,)
        blind = PrismsResult(
            camera=frame.camera,
            sequence=frame.sequence,
            t_exposure_ns=frame.t_exposure_ns,
            t_arrival_ns=frame.t_arrival_ns,
            frame="level",
            drop=cause,
            model=None,
        )
        return decision, blind


def invalidate_if_mount_wrong(model: FrameModel, mount: MountState) -> FrameModel:
    """The model; an invalid one that reports nothing where the verdict on the mount makes frames invalid."""
    if not model.valid or not mount.verdict.invalid:
        return model
    wrong = mount.verdict is MountVerdict.ERROR
    return invalid_model(model, InvalidCause.MOUNT_ERROR if wrong else InvalidCause.MOUNT_UNVERIFIED)


def seed_ground_height(state: ExtractorState, pose: PoseAt | None, transform: LevelTransform) -> ExtractorState:
    """The state with the camera's height above the origin of ned as its ground seed, where no frame has left one yet.

    A hint only: the ground is still found in the image, or not seen. transform: level_cam to the published frame."""
    height_m = -transform.translation_m[2]
    if pose is None or math.isfinite(state.ground_height_m) or height_m <= 0.0:
        return state
    return dataclasses.replace(state, ground_height_m=height_m)


def transform_from_level_cam(
    camera_rad: float, vehicle_rad: float, lever_ned_m: Vector, pose: PoseAt | None
) -> LevelTransform:
    """level_cam -> level, or with a position level_cam -> ned. By the headings of camera and vehicle and the camera's lever
    arm, see `level_cam_at`."""
    x, y, z = lever_ned_m
    if pose is not None:
        north, east, down = pose.position_ned_m
        return LevelTransform(camera_rad, (x + north, y + east, z + down))
    c, s = math.cos(vehicle_rad), math.sin(vehicle_rad)
    return LevelTransform(math.remainder(camera_rad - vehicle_rad, math.tau), (c * x + s * y, c * y - s * x, z))
