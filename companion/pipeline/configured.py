"""The pipeline of a configuration, for the live service and for replays of its logs."""

from __future__ import annotations

from collections.abc import Iterable

from core.extractor import Extractor
from core.types import CameraInfo

from ..cameras.masks import masks_of
from ..config.loader import Config
from .pipeline import Pipeline
from .state import PipelineState


def make_pipeline(config: Config, cameras: Iterable[CameraInfo] = (), state: PipelineState | None = None) -> Pipeline:
    """The pipeline of a configuration, with its camera settings applied to these cameras. Cameras that open later are
    events. Raises ValueError for a state that does not fit the configuration."""
    return Pipeline(
        effective_cameras(config, cameras),
        lambda info: Extractor(config.extractor, config.open_sky),
        config.sync,
        state,
        mask=masks_of(config),
        mount_check=config.mount_check,
        tracking=config.tracking,
    )


def effective_cameras(config: Config, cameras: Iterable[CameraInfo]) -> tuple[CameraInfo, ...]:
    """The cameras' descriptions with the configured values applied."""
    return tuple(config.camera(info.camera).applied_to(info) for info in cameras)
