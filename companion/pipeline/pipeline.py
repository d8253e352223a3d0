"""The pipeline of the live service and of replay: it turns events, in order of arrival, into decisions and prisms.

It uses no clock, file or socket. Its output depends on the events and its initial state only, so the same input gives
the same output bit for bit."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.frames import level_cam_at, rotation_from_quaternion
from core.invalid_model import invalid_model
from core.open_sky_params import OpenSkyParams
from core.self_check.mount_check import MountState, MountVerdict, checked, confirmed_by_ground, due
from core.self_check.mount_cues import MountCues, cues_of
from core.self_check.mount_params import MountCheckParams
from core.tracking.params import TrackingParams
from core.types import (
    NOTHING_OPEN,
    AttitudeSample,
    CameraInfo,
    DepthFrame,
    ExtractorState,
    FrameModel,
    InvalidCause,
    PoseSample,
)
from drivers.base import Event

from ..cameras.masks import Mask, apply_mask
from ..config.sync import SyncParams
from .events import SupersededFrame
from .results import FrameDecision, Output, PrismsResult
from .sample_buffer import RESTART_STEP_NS
from .state import CameraState, PipelineState
from .sync import AttitudeAt, DropCause, PoseAt, Source, Synchroniser
from .tracking import CameraTracks, TracksResult
from .transform import seed_ground_height, transform_from_level_cam, transform_model

UNPUBLISHED_DROPS = frozenset({DropCause.DUPLICATE_FRAME, DropCause.LATE_FRAME})
"""Drop causes without a published message: the same or a newer exposure has been published already."""


class FrameExtractor(Protocol):
    """The interface of core.extractor.Extractor that the pipeline uses. open_sky: is read for models with open ranges."""

    open_sky: OpenSkyParams

    def extract(
        self,
        depth: NDArray[np.uint16],
        info: CameraInfo,
        R_level_optical: NDArray[np.float64],
        state: ExtractorState | None = ...,
        *,
        keep_strips: bool = ...,
    ) -> tuple[FrameModel, ExtractorState]: ...


class Pipeline:
    """Turns depth, attitude and position into decisions and prisms. It has one extractor per camera, made by
    `make_extractor`."""

    def __init__(
        self,
        cameras: Sequence[CameraInfo],
        make_extractor: Callable[[CameraInfo], FrameExtractor],
        sync: SyncParams | None = None,
        state: PipelineState | None = None,
        mask: Callable[[CameraInfo], Mask | None] = lambda info: None,
        mount_check: MountCheckParams | None = None,
        tracking: TrackingParams | None = None,
    ) -> None:
        """mask: returns the (H, W) mask of a camera's pixels that are always unknown, None: no mask. tracking: None, or
        not enabled: obstacles are not tracked. Raises ValueError for a state that does not fit these parameters."""
        self._mount_check = mount_check or MountCheckParams()
        self._infos = {info.camera: info for info in cameras}
        if len(self._infos) != len(cameras):
            raise ValueError("pipeline: two cameras have the same name; give each camera another name")
        self._make_extractor = make_extractor
        self._extractors = {info.camera: make_extractor(info) for info in cameras}
        self._mask = mask
        self._masks = {info.camera: mask(info) for info in cameras}
        self._sync = Synchroniser(sync or SyncParams())
        self._states = {info.camera: CameraState() for info in cameras}
        self.counts: Counter[str] = Counter()
        self._tracks: CameraTracks | None = None
        if tracking is not None and tracking.enabled:
            self._tracks = CameraTracks(tracking, () if state is None else state.trackers)
        if state is not None:
            self.resume(state)

    def resume(self, state: PipelineState) -> None:
        """Continues with the cameras of this state; its samples are added."""
        for name, camera in state.cameras:
            if name in self._states:
                self._states[name] = camera
        for attitude in state.attitudes:
            self._sync.add(attitude)
        for pose in state.poses:
            self._sync.add(pose)
        if state.headings is not None:
            self._sync.headings.resume(state.headings)
        if state.sections is not None:
            self._sync.sections.resume(state.sections)
        if self._tracks is not None:
            self._tracks.resume(state.trackers)

    def state(self) -> PipelineState:
        """A snapshot of the state to start another pipeline with."""
        trackers = () if self._tracks is None else self._tracks.states()
        samples = self._sync.attitudes.samples, self._sync.poses.samples
        jumps = self._sync.headings.state(), self._sync.sections.state()
        return PipelineState(tuple(self._states.items()), *samples, trackers, *jumps)

    def camera_state(self, camera: str) -> PipelineState:
        """The part of `state` that belongs to one camera."""
        trackers = () if self._tracks is None else self._tracks.states()
        return PipelineState(
            tuple((name, state) for name, state in self._states.items() if name == camera),
            trackers=tuple((name, state) for name, state in trackers if name == camera),
        )

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The announced cameras."""
        return tuple(self._infos.values())

    def announce(self, info: CameraInfo) -> None:
        """Adds an opened camera. A camera with a changed description starts with a new state, except for a verdict against its
        mount where that is the same."""
        known = self._infos.get(info.camera)
        if known == info:
            return
        same_mount = known is not None and known.mount == info.mount
        mount = self._states[info.camera].mount.restarted() if same_mount else MountState()
        self._infos[info.camera] = info
        self._extractors[info.camera] = self._make_extractor(info)
        self._masks[info.camera] = self._mask(info)
        self._states[info.camera] = CameraState(mount=mount)
        if self._tracks is not None:
            self._tracks.forget(info.camera)

    def track(self, output: Output) -> TracksResult | None:
        """The tracked obstacles after an output of `handle`; None where obstacles are not tracked, and for a decision. To be
        called once for each output, in their order, after it is published."""
        if self._tracks is None or isinstance(output, FrameDecision):
            return None
        return self._tracks.add(output)

    def superseded(self, frame: DepthFrame | SupersededFrame) -> FrameDecision:
        """The decision on a frame that a newer frame replaced before it reached the pipeline. It changes no state."""
        return self._decision(frame, DropCause.BUSY)

    def _decision(self, frame: DepthFrame | SupersededFrame, cause: DropCause) -> FrameDecision:
        return FrameDecision(
            camera=frame.camera,
            sequence=frame.sequence,
            t_exposure_ns=frame.t_exposure_ns,
            t_arrival_ns=frame.t_arrival_ns,
            cause=cause,
            attitude_cutoff_ns=self._sync.attitudes.newest_ns,
        )

    @property
    def newest_attitude_ns(self) -> int | None:
        """Stamp of the newest attitude."""
        return self._sync.attitudes.newest_ns

    def sample_anomalies(self) -> dict[str, int]:
        """Numbers of duplicate attitudes and positions, of those out of order, and of restarts of their sender."""
        kinds = (("attitude", self._sync.attitudes.counts), ("pose", self._sync.poses.counts))
        return {f"{kind}_{anomaly}": n for kind, counts in kinds for anomaly, n in sorted(counts.items())}

    def handle(self, event: Event) -> tuple[Output, ...]:
        """The outputs of one event: none for a sample; for a frame its decision and its prisms, unless the same or a
        newer exposure has been handled. Raises ValueError for a camera that was not announced."""
        if isinstance(event, AttitudeSample | PoseSample):
            self._sync.add(event)
            return ()
        return self._frame(event)

    def _frame(self, frame: DepthFrame) -> tuple[Output, ...]:
        info = self._infos.get(frame.camera)
        if info is None:
            raise ValueError(
                f"pipeline: a frame of camera {frame.camera!r}, which was not announced; announced: "
                f"{', '.join(self._infos)}"
            )
        cause = self._check_order(frame, info)
        attitude = self._sync.attitude_at(frame.t_exposure_ns) if cause is DropCause.NONE else cause
        if isinstance(attitude, DropCause):
            return self._drop(frame, attitude)
        pose = self._sync.pose_at(frame.t_exposure_ns) if self._sync.params.use_pose else "switched off"
        result = self._extract(frame, info, attitude, pose if isinstance(pose, PoseAt) else None)
        decision = dataclasses.replace(
            self._decision(frame, DropCause.NONE),
            attitude=attitude.source,
            pose=pose.source if isinstance(pose, PoseAt) else Source.NONE,
            pose_text="" if isinstance(pose, PoseAt) else pose,
        )
        return decision, result

    def _check_order(self, frame: DepthFrame, info: CameraInfo) -> DropCause:
        """The drop cause by the frame's order and size, NONE if it can be used. Where the frames have stepped far back for
        RESTART_STEP_NS, the camera restarted: its state is reset, except for a verdict against its mount."""
        state, t_ns = self._states[frame.camera], frame.t_exposure_ns
        last = state.last_t_exposure_ns
        if last is not None and t_ns <= last - RESTART_STEP_NS:
            first_ns = t_ns if state.back_since_ns is None else min(t_ns, state.back_since_ns)
            # late frames, or wrong stamps: the attitude of that time is not theirs
            if t_ns - first_ns < RESTART_STEP_NS:
                self._states[frame.camera] = dataclasses.replace(state, back_since_ns=first_ns)
                return DropCause.LATE_FRAME
            state, last = CameraState(mount=state.mount.restarted()), None
            self.counts["camera_restarts"] += 1
        if last is not None and t_ns <= last:
            self._states[frame.camera] = dataclasses.replace(state, back_since_ns=None)
            return DropCause.DUPLICATE_FRAME if t_ns == last else DropCause.LATE_FRAME
        self._states[frame.camera] = dataclasses.replace(state, last_t_exposure_ns=t_ns, back_since_ns=None)
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
        if not model.ground.seen:  # a ground height that comes from the position is not kept as a measured one
            after = dataclasses.replace(after, ground_height_m=state.extractor.ground_height_m)
        mount = state.mount
        if model.valid and due(mount, frame.t_exposure_ns, self._mount_check, attitude.tilt_rad_s):
            cues = _mount_cues(depth_mm, info, R_level_optical, model.ke_per_m)
            R_ned_frd = rotation_from_quaternion(attitude.q_ned_frd_wxyz)
            t_ns, jump_ns = frame.t_exposure_ns, attitude.jump_ns
            mount = checked(mount, t_ns, cues, R_ned_frd, camera_rad, self._mount_check, jump_ns)
        model = invalidate_if_mount_wrong(model, mount)
        if model.free.has_open and not self._mount_supports_open(frame.camera, mount, attitude, camera_rad):
            model = without_open(model)
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

    def _mount_supports_open(self, camera: str, mount: MountState, attitude: AttitudeAt, camera_rad: float) -> bool:
        """Whether the mount is known well enough to presume open space: its error moves the horizon, which is the evidence.

        It is verified, or was measured beforehand and the ground that it shows is level. While the check is off, or has not
        measured enough, nothing is open. camera_rad: heading of the camera."""
        if mount.verdict is MountVerdict.VERIFIED:
            return True
        if not self._extractors[camera].open_sky.mount_measured or not self._mount_check.enabled:
            return False
        R_ned_frd = rotation_from_quaternion(attitude.q_ned_frd_wxyz)
        return confirmed_by_ground(mount, R_ned_frd, camera_rad, self._mount_check, attitude.jump_ns)

    def _drop(self, frame: DepthFrame, cause: DropCause) -> tuple[Output, ...]:
        decision = self._decision(frame, cause)
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


def _mount_cues(
    depth_mm: NDArray[np.uint16], info: CameraInfo, R_level_optical: NDArray[np.float64], ke_per_m: float
) -> MountCues:
    """What the frame shows of the mount."""
    # late: compiled code, which commands that only read results do not need
    from core.self_check.surfaces import find_surfaces

    return cues_of(find_surfaces(depth_mm, info, R_level_optical, ke_per_m))


def without_open(model: FrameModel) -> FrameModel:
    """The model without open ranges. What is free was measured and stays."""
    free = dataclasses.replace(model.free, open_from_dm=NOTHING_OPEN, open_to_dm=NOTHING_OPEN)
    return dataclasses.replace(model, free=free)


def invalidate_if_mount_wrong(model: FrameModel, mount: MountState) -> FrameModel:
    """The model; an empty invalid model where the verdict on the mount invalidates frames."""
    if not model.valid or not mount.verdict.invalid:
        return model
    wrong = mount.verdict is MountVerdict.ERROR
    return invalid_model(model, InvalidCause.MOUNT_ERROR if wrong else InvalidCause.MOUNT_UNVERIFIED)
