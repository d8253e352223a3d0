"""Which keys of a configuration differ from their defaults, and which of these are safety keys (`core.param_field`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import Any

from core.param_field import is_safety_key

from .loader import Config, values_of
from .sections import SECTIONS, fields_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One key whose value is not its default."""

    section: str
    camera: str  # the name of the [[camera]], empty elsewhere
    key: str
    value: Any
    default: Any
    unit: str
    safety: bool

    def text(self) -> str:
        """Section, key, value and default, as they stand in the file."""
        place = f'[[camera]] "{self.camera}"' if self.section == "camera" else f"[{self.section}]"
        if self.default is None:
            return f"{place} {self.key} = {self._shown(self.value)} (default: as the camera or the recording has it)"
        return f"{place} {self.key} = {self._shown(self.value)} (default {self._shown(self.default)})"

    def _shown(self, value: Any) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, str):
            return f'"{value}"'
        return f"{value:g} {self.unit}".rstrip()


def differences(config: Config) -> list[Difference]:
    """All keys of all sections that differ from their defaults, in the order of the sections. A key without a default
    (the name of a camera) is none."""
    found: list[Difference] = []
    for section in SECTIONS:
        if section == "camera":
            for camera in config.cameras:
                found += _of_section(section, camera.name, camera)
        else:
            found += _of_section(section, "", values_of(config, section))
    return found


def safety_lines(config: Config) -> list[str]:
    """The changed safety keys as text, one line each."""
    return [d.text() for d in differences(config) if d.safety]


def expert_lines(config: Config) -> list[str]:
    """The changed expert keys as text, one line each; among them those that are safety keys too."""
    return [d.text() for d in differences(config) if d.section == "expert"]


def _of_section(section: str, camera: str, values: Any) -> Iterator[Difference]:
    for f in fields_of(section):
        value = getattr(values, f.name)
        if f.default is not MISSING and value != f.default:
            yield Difference(
                section=section,
                camera=camera,
                key=f.name,
                value=value,
                default=f.default,
                unit=str(f.metadata["unit"]),
                safety=is_safety_key(f),
            )
