"""Why the service would refuse a configuration that a replay can use."""

from __future__ import annotations

from .devices import device_problems
from .endpoints import beyond_loopback, opened_streams, without_keys_text
from .loader import Config


def startup_problems(config: Config) -> list[str]:
    """Causes and remedies, for `run`, `check-config`, `doctor` and `install`."""
    return [*device_problems(config.cameras), *stream_problems(config)]


def stream_problems(config: Config) -> list[str]:
    """Streams that the service opens and that other machines could reach without keys."""
    if config.publish.keys:
        return []
    addresses = {name: getattr(config.publish, name) for name in opened_streams(config)}
    return [without_keys_text(name, address) for name, address in addresses.items() if beyond_loopback(address)]
