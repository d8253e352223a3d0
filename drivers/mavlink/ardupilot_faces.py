"""The eight faces of 45 degrees around the vehicle in which ArduPilot keeps the nearest obstacle."""

from __future__ import annotations

FACES = 8


def face_of(angle_deg: float) -> int:
    """Returns the face of a direction: 0 ahead, then clockwise."""
    return int(((angle_deg + 22.5) % 360.0) / 45.0)
