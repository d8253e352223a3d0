"""The eight faces of 45 degrees around the vehicle in which ArduPilot keeps the nearest obstacle."""

from __future__ import annotations

FACES = 8
READ_BEFORE = ((6, 7, 0), (7, 0, 1), (0, 1, 2))
"""Faces of which the third is read before the first, with the one between them. ArduPilot lets the border between the second and
the third be the distance of the first, if the second is empty, also where the third is nearer (update_boundary)."""


def face_of(angle_deg: float) -> int:
    """Returns the face of a direction: 0 ahead, then clockwise."""
    return int(((angle_deg + 22.5) % 360.0) / 45.0)
