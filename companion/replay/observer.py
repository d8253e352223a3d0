"""What a caller may receive during a replay."""

from __future__ import annotations

from typing import Protocol

from drivers.logs.reader import LoggedMessage, McapRecording

from ..config.loader import Config
from ..pipeline.results import Output


class Observer(Protocol):
    """Receives the results of a replay, and messages of the log, in file order."""

    @property
    def keys(self) -> tuple[str, ...]:
        """The kinds of messages (keys of TOPICS) to receive."""

    def begin(self, source: McapRecording, config: Config) -> None:
        """Called first. config: the configuration in use."""

    def logged(self, item: LoggedMessage) -> None:
        """Called for a message of the log."""

    def output(self, output: Output) -> None:
        """Called for an output of the pipeline."""
