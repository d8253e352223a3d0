"""What a log holds of the run that wrote it: its configuration, the states that its frames depend on, and the frames that
it skipped."""

from __future__ import annotations

from pathlib import Path

from drivers.base import BadData
from drivers.logs.reader import McapRecording
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..config.loader import Config, ConfigError, config_from_text
from ..log.provenance import software
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


def recorded_config(source: McapRecording, otherwise: str = ", or give a configuration with -c FILE") -> Config:
    """The configuration with which the frames were recorded; the defaults where the log has none. Raises ConfigError for one
    of another version, or a damaged one. otherwise: another remedy than to use that version."""
    if source.run is None or not source.run.config_json:
        return Config()
    try:
        return config_from_text(source.run.config_json, f"the configuration in {source.path}")
    except ConfigError as error:
        remedy = (
            f"The log was made by {source.run.software or 'an unknown version'}, this is {software()}: use that "
            f"version{otherwise}"
        )
        raise ConfigError(error.source, error.problems, remedy) from error


def readable_recorded_config(source: McapRecording) -> Config | None:
    """`recorded_config`; None where it cannot be read: for a replay with another configuration."""
    try:
        return recorded_config(source)
    except ConfigError:
        return None
