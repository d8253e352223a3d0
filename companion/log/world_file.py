"""The merged world in a file: replaced atomically, and readable up to the first damage."""

from __future__ import annotations

import logging
from pathlib import Path

from core.world.serialize import SavedSection, bytes_of, fitting, sections_of

from ..whole_file import write_whole

log = logging.getLogger("companion")


def write_world(path: Path, sections: tuple[SavedSection, ...]) -> str:
    """Replaces the file atomically: after a power failure it is either the old or the new one. Raises OSError.

    Returns which planes were left out because their numbers do not fit in the file, as text, which is also logged; "": all
    planes were written."""
    fit, left_out = [], []
    for section in sections:
        kept, causes = fitting(section)
        fit.append(kept)
        if causes:
            k, cause = next(iter(causes.items()))
            left_out.append(
                f"{len(causes)} of {len(section.box)} planes of section {section.number} (plane {k}: {cause})"
            )
    fault = f"{path}: left out: {'; '.join(left_out)}; what is loaded from it lacks them" if left_out else ""
    if fault:
        log.warning("%s", fault)
    write_whole(path, bytes_of(tuple(fit)))
    return fault


def read_world(path: Path) -> tuple[tuple[SavedSection, ...], str]:
    """(sections, fault): the readable sections of a file, and the damage as text, "" if complete.

    Raises ValueError for a file that is not a world, OSError where it cannot be read."""
    try:
        sections, fault = sections_of(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: {error}; expected a file of write_world") from error
    return sections, f"{path}: {fault}; the part before the damage was read" if fault else ""
