"""Encodes and decodes the state of the pipeline (osape.v1), without loss: with it a log is replayed from any of its frames.

Decoding raises ValueError for an inconsistent message."""

from __future__ import annotations

import math

from core.self_check.mount_check import MountState
from core.types import ExtractorState
from drivers.logs.codec import attitude_from_message, attitude_message, pose_from_message, pose_message
from osape_client.proto import osape_v1_pb2 as pb

from .jump_messages import heading_from_message, heading_message, position_from_message, position_message
from .mount_messages import mount_state_from_message, mount_state_message
from .state import CameraState, PipelineState
from .track_messages import tracker_messages, trackers_from_message


def _known(value: float) -> float | None:
    """The value; None for nan, so that the field is absent."""
    return None if math.isnan(value) else value


def state_message(state: PipelineState) -> pb.StateSnapshot:
    """Encodes the state that later frames depend on."""
    return pb.StateSnapshot(
        cameras=[
            pb.CameraState(
                camera=name,
                ground_height_m=camera.extractor.ground_height_m,
                ke_per_m=camera.extractor.ke_per_m,
                still_ke_per_m=_known(camera.extractor.still_ke_per_m),
                samples_mm=camera.extractor.samples_mm,
                samples_age=camera.extractor.samples_age,
                edge_ramps=camera.extractor.edge_ramps,
                edge_steps=camera.extractor.edge_steps,
                last_t_exposure_ns=camera.last_t_exposure_ns,
                back_since_ns=camera.back_since_ns,
                mount=mount_state_message(camera.mount),
            )
            for name, camera in state.cameras
        ],
        attitudes=[attitude_message(sample) for sample in state.attitudes],
        poses=[pose_message(sample) for sample in state.poses],
        trackers=tracker_messages(state.trackers),
        headings=None if state.headings is None else heading_message(state.headings),
        sections=None if state.sections is None else position_message(state.sections),
    )


def state_from_message(message: pb.StateSnapshot) -> PipelineState:
    """Decodes a state snapshot."""
    cameras = tuple(
        (
            camera.camera,
            CameraState(
                ExtractorState(
                    camera.ground_height_m,
                    camera.ke_per_m,
                    camera.still_ke_per_m if camera.HasField("still_ke_per_m") else math.nan,
                    camera.samples_mm,
                    camera.samples_age,
                    camera.edge_ramps,
                    camera.edge_steps,
                ),
                camera.last_t_exposure_ns if camera.HasField("last_t_exposure_ns") else None,
                mount_state_from_message(camera.mount) if camera.HasField("mount") else MountState(),
                camera.back_since_ns if camera.HasField("back_since_ns") else None,
            ),
        )
        for camera in message.cameras
    )
    return PipelineState(
        cameras,
        tuple(attitude_from_message(sample) for sample in message.attitudes),
        tuple(pose_from_message(sample) for sample in message.poses),
        trackers_from_message(message),
        heading_from_message(message.headings) if message.HasField("headings") else None,
        position_from_message(message.sections) if message.HasField("sections") else None,
    )
