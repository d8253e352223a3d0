"""Creates the optional parts of the service that the configuration asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..config.loader import Config
from ..log.provenance import run_info
from ..log.recorder import Recorder
from ..paths import Folders

if TYPE_CHECKING:
    from .prometheus import MetricsServer


def make_recorder(config: Config, folders: Folders) -> Recorder | None:
    """The recorder; None with `[record] record = "off"`."""
    if config.record.record == "off":
        return None
    return Recorder(config.record.place(folders.state), run_info("live", config), config.record, config.output)


def make_metrics(config: Config) -> MetricsServer | None:
    """The metrics server; None without `[service] metrics_port`."""
    if config.service.metrics_port == 0:
        return None
    from .prometheus import MetricsServer  # imports a web server: only where it is needed

    return MetricsServer(config.service.metrics_port)
