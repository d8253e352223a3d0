"""The own moving obstacles that are offered to other vehicles."""

from __future__ import annotations

from dataclasses import dataclass, field

from core.sharing.records import CUT, MOVER_IDS, SharedMover
from core.tracking.snapshot import MovingObject, TrackSnapshot

NS = 1_000_000_000
LEAST_CAMERAS = 8
"""Shared numbers distinguish at least so many cameras, each of which numbers its obstacles by itself: the numbers do not change
while the cameras start one after the other."""


@dataclass(slots=True)
class OwnMovers:
    """Newest moving obstacles of each camera. `take` and `at` may be called from different threads."""

    _newest: dict[str, tuple[int, tuple[MovingObject, ...], frozenset[int]]] = field(default_factory=dict)

    def take(self, camera: str, tracks: TrackSnapshot, exposure_ns: int) -> None:
        """Replaces those of a camera, whose tracker has moved them to this exposure."""
        cut = tracks.object_id[(tracks.flags & int(CUT)) != 0]
        self._newest = self._newest | {camera: (exposure_ns, tracks.objects, frozenset(cut.tolist()))}

    def at(self, now_ns: int, since_ns: int) -> tuple[SharedMover, ...]:
        """Returns those of all cameras, with their ages at now_ns.

        since_ns: newest jump of the own estimate. Trackers follow it with their next frame: those of earlier frames stand
        in the section before it, and are left out."""
        newest = self._newest
        cameras = max(LEAST_CAMERAS, len(newest))
        return tuple(
            _shared(o, o.id * cameras + camera, (now_ns - exposure_ns) / NS, is_cut=o.id in cut)
            for camera, (exposure_ns, objects, cut) in enumerate(newest.values())
            if exposure_ns >= since_ns
            for o in objects
        )


def _shared(o: MovingObject, number: int, passed_s: float, *, is_cut: bool) -> SharedMover:
    """Returns a moving obstacle at its newest observation: receivers move it by its velocity and age since then.

    number: distinguishes it from those of all cameras. passed_s: time since the exposure of the frame to which the
    tracker has moved it. is_cut: the border of the image cuts one of its planes."""
    unseen_s = o.unseen_ns / NS
    (x, y, z), (vx, vy) = o.centre_m, o.velocity_m_s
    return SharedMover(
        id=number % MOVER_IDS,
        centre_m=(x - vx * unseen_s, y - vy * unseen_s, z),
        half_size_m=o.half_size_m,
        velocity_m_s=o.velocity_m_s,
        sigma_m=o.position_sigma_m,
        sigma_m_s=o.velocity_sigma_m_s,
        age_s=max(0.0, passed_s) + unseen_s,
        partial=is_cut,
    )
