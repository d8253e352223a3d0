"""The configuration in a log."""

from __future__ import annotations

from drivers.logs.reader import McapRecording

from ..config.loader import Config, ConfigError, config_from_text
from ..log.provenance import software


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
