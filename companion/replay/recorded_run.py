"""What a log holds of the run that wrote it: the states that its frames depend on, and the frames that it skipped."""

from __future__ import annotations

from pathlib import Path

from drivers.base import BadData
from drivers.logs.reader import McapRecording
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.state import PipelineState
from ..pipeline.state_messages import state_from_message
from .compare import Key, key_of


def opening_state(source: McapRecording) -> PipelineState | None:
    """The state at the beginning of the log. Raises BadData when it cannot be used."""
    return None if source.snapshot is None else decoded_state(source, source.snapshot)


def decoded_state(source: McapRecording, state: pb.StateSnapshot) -> PipelineState:
    """A state in the log. Raises BadData when it cannot be used."""
    try:
        return state_from_message(state)
    except ValueError as error:
        raise BadData(
            f"{source.path}: {TOPICS['state'].name}: {error}; the frames depend on it. Use another copy of the file, "
            "or import the recording again"
        ) from error


def skipped_live(path: Path) -> frozenset[Key]:
    """Frames that the live run skipped because newer ones were waiting; they did not change its state."""
    skipped: set[Key] = set()
    try:
        with McapRecording(path) as source:
            for item in source.messages("decision"):
                if isinstance(item.message, pb.FrameDecision) and item.message.cause == pb.CAUSE_BUSY:
                    skipped.add(key_of(item.message))
    except BadData:
        return frozenset(skipped)  # the replay reports the same damage
    return frozenset(skipped)
