"""Our models as mappers: each frame alone, the tracks, and the merged world. Bytes are those of the messages sent."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from benchmarks.peers.sequences.frame_input import FrameInput
from benchmarks.peers.sequences.mapper import MapModel, plane_model
from companion.pipeline.encode import prisms_bytes
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import DropCause
from companion.pipeline.track_messages import tracks_message
from companion.pipeline.tracking import TracksResult
from companion.streams.world_messages import world_message
from core.extractor import Extractor
from core.params import Params
from core.tracking.snapshot import TrackingFrame, TrackSnapshot
from core.tracking.tracker import Tracker
from core.transformed import turned
from core.types import ExtractorState, FrameModel
from core.world.world import Observation, World

FRAME, TRACKS, WORLD = "OSAPE, frame", "OSAPE, tracks", "OSAPE, world"


class _Header(TypedDict):
    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    frame: str


def _header(frame: FrameInput) -> _Header:
    e = frame.exposure
    return _Header(camera="front", sequence=e.k, t_exposure_ns=e.t_ns, t_arrival_ns=e.t_ns, frame="ned")


class Frames:
    """The model of the newest frame alone, in the reported ned."""

    unit = "planes"
    name = FRAME

    def __init__(self) -> None:
        self._extractor, self._state = Extractor(Params()), ExtractorState()
        self._model: FrameModel | None = None

    def add(self, frame: FrameInput) -> None:
        """Extracts the model from the depth image as it was delivered."""
        self._model = self.extract(frame)

    def extract(self, frame: FrameInput) -> FrameModel:
        """The model of a frame in the reported ned."""
        r = frame.exposure.rendered
        model, self._state = self._extractor.extract(r.depth_mm, r.info, r.R_level_optical, self._state)
        return turned(model, frame.heading_rad, frame.position)

    def model(self, frame: FrameInput) -> MapModel:
        """Its planes."""
        if self._model is None:
            raise RuntimeError("no frame was added; call add first")
        sent = PrismsResult(**_header(frame), drop=DropCause.NONE, model=self._model)
        return plane_model(self._model.planes.astype(np.float64), len(prisms_bytes(sent)))


class Tracks:
    """The tracked obstacles."""

    unit = "tracks"
    name = TRACKS

    def __init__(self) -> None:
        self._frames, self._tracker = Frames(), Tracker()
        self._snapshot: TrackSnapshot | None = None

    def add(self, frame: FrameInput) -> None:
        """Extracts and tracks."""
        model, at = self._frames.extract(frame), frame.position
        tracked = TrackingFrame(model=model, camera_m=at, t_ns=frame.exposure.t_ns, positioned=True, origin_m=at)
        self._snapshot = self._tracker.observe(tracked)

    def model(self, frame: FrameInput) -> MapModel:
        """All tracks, detected in this frame or not."""
        if self._snapshot is None:
            raise RuntimeError("no frame was added; call add first")
        sent = TracksResult(**_header(frame), valid=True, cause=DropCause.NONE, tracks=self._snapshot)
        return plane_model(self._snapshot.planes.astype(np.float64), tracks_message(sent).ByteSize())


class Merged:
    """The merged world."""

    unit = "planes"
    name = WORLD

    def __init__(self) -> None:
        self._frames, self._world = Frames(), World()

    def add(self, frame: FrameInput) -> None:
        """Extracts and merges."""
        model = self._frames.extract(frame)
        self._world.add(Observation(model=model, place_m=frame.position, t_ns=frame.exposure.t_ns))

    def model(self, frame: FrameInput) -> MapModel:
        """The planes of a complete snapshot; its free space is in the bytes."""
        picture = self._world.picture(frame.exposure.t_ns)
        sent = world_message(picture, np.zeros(0, np.int32), frame.exposure.t_ns)
        return plane_model(picture.planes.astype(np.float64), sent.ByteSize())
