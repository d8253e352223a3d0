"""The merged world for the live page, received in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from osape_client.world.mirror import WorldMirror
from osape_client.world.snapshot import WorldSnapshot

MAX_PLANES = 3000
"""Largest number of drawn planes, nearest to the vehicle first."""
PERIOD_S = 0.5

VehiclePosition = Callable[[], tuple[float, float, float] | None]


class LiveWorld:
    """`update` may be called from any thread. vehicle: returns its position in ned; None: unknown."""

    def __init__(self, address: str, requests: str, keys: Path | None, vehicle: VehiclePosition) -> None:
        self._addresses, self._keys, self._vehicle = (address, requests), keys, vehicle
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="world", daemon=True)
        self._update: dict[str, Any] = {"number": 0, "received": False, "cause": "", "total": 0, "planes": []}

    def open(self) -> None:
        """Starts the thread if an address is given; the service may start later."""
        if all(self._addresses):
            self._thread.start()

    def close(self) -> None:
        """Ends the thread. May be called twice."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)

    def update(self, after: int) -> dict[str, Any]:
        """number: of this state; received: whether the service publishes a world; cause: why it must not be used, empty:
        it may be used; total: number of planes; planes: those drawn, flat whole centimetres of ned, None where the page
        has them already."""
        update = self._update
        return update | {"planes": None} if update["number"] == after else update

    def _run(self) -> None:
        with WorldMirror(*self._addresses, keys=self._keys) as mirror:
            seen: tuple[Any, ...] = ()
            while not self._stop.wait(PERIOD_S):
                usable = mirror.update()
                now = (usable, mirror.cause if not usable else "", mirror.stats.messages, mirror.section)
                if now != seen and mirror.stats.messages:
                    seen = now
                    self._publish(mirror, usable)

    def _publish(self, mirror: WorldMirror, usable: bool) -> None:
        """An invalid world is not drawn: the age of a snapshot alone is not known."""
        snapshot = mirror.space.snapshot if usable else WorldSnapshot.empty()
        self._update = {
            "number": self._update["number"] + 1,
            "received": True,
            "cause": "" if usable else mirror.cause,
            "total": len(snapshot.planes),
            "planes": nearest_cm(snapshot, self._vehicle()),
        }


def nearest_cm(
    snapshot: WorldSnapshot, vehicle_m: tuple[float, float, float] | None, most: int = MAX_PLANES
) -> list[int]:
    """Planes a_x, a_y, b_x, b_y, top, bottom in whole centimetres of ned, flat: those nearest to the vehicle, or the
    newest without a vehicle position."""
    planes = snapshot.planes.astype(np.float64)
    if len(planes) > most:
        if vehicle_m is None:
            order = np.argsort(-snapshot.seen_ns, kind="stable")
        else:
            middle = 0.5 * (planes[:, 0:2] + planes[:, 2:4]) - np.array(vehicle_m[:2])
            order = np.argsort(np.hypot(*middle.T), kind="stable")
        planes = planes[order[:most]]
    return [int(v) for v in np.rint(100.0 * planes).ravel()]
