"""Obstacles that other vehicles have reported, for the live page; received in a thread of its own."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any

import numpy as np

from osape_client.neighbours import Neighbour, NeighbourMover, NeighbourObstacles
from osape_client.neighbours_subscriber import NeighboursSubscriber

MAX_PLANES = 1000
"""Largest number of drawn planes, the newest first."""
PERIOD_S = 0.2
SILENT_S = 3.0
"""After this time without a message the stream counts as silent."""


class LiveTeam:
    """`update` may be called from any thread."""

    def __init__(self, address: str, keys: Path | None) -> None:
        self._address, self._keys = address, keys
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="team", daemon=True)
        self._update: dict[str, Any] = {"number": 0, **_nothing(received=False)}

    def open(self) -> None:
        """Starts the thread if an address is given; the service may start later. Raises KeyFileError."""
        if self._address:
            self._subscriber = NeighboursSubscriber(self._address, timeout_s=SILENT_S, keys=self._keys)
            self._thread.start()

    def close(self) -> None:
        """Ends the thread. May be called twice."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)

    def update(self, after: int) -> dict[str, Any]:
        """number: of this state; received: whether the service ever published a team; silent: whether it has stopped; members: the
        vehicles, with text and age; planes: flat whole centimetres of ned, None where the page has them already; sender: the vehicle
        of each; movers: see `_mover`."""
        update = self._update
        return update | {"planes": None} if update["number"] == after else update

    def _run(self) -> None:
        with self._subscriber as subscriber:
            received, shown_ns = False, -1
            while not self._stop.is_set():
                found = subscriber.newest(wait_s=PERIOD_S)
                received |= found.t_ns > 0
                if found.t_ns != shown_ns and received:
                    shown_ns = found.t_ns
                    content = team_data(found) if found.t_ns else _nothing(received=True)
                    self._update = {"number": self._update["number"] + 1, **content}
                self._stop.wait(PERIOD_S)


def team_data(found: NeighbourObstacles, most: int = MAX_PLANES) -> dict[str, Any]:
    """A message as the page draws it."""
    rows = np.argsort(found.age_s, kind="stable")[:most]
    oldest_s = {int(v): float(found.age_s[found.sender == v].max()) for v in np.unique(found.sender)}
    return {
        "received": True,
        "silent": False,
        "members": [_member(n, oldest_s.get(n.vehicle)) for n in found.neighbours],
        "planes": np.rint(100.0 * found.planes[rows].astype(np.float64)).astype(int).ravel().tolist(),
        "sender": found.sender[rows].tolist(),
        "movers": [_mover(m) for m in found.movers],
    }


def _nothing(received: bool) -> dict[str, Any]:
    return {"received": received, "silent": received, "members": [], "planes": [], "sender": [], "movers": []}


def _member(n: Neighbour, oldest_s: float | None) -> dict[str, Any]:
    """vehicle: number; silent_s: since its newest packet; text: what it has contributed, and how its place is known."""
    oldest = "" if oldest_s is None else f", observed up to {oldest_s:.0f} s ago"
    place = {
        "unknown": "place not known",
        "by_position": "placed by its position",
        "aligned": "aligned by common planes",
    }
    parts = [f"{n.planes} planes{oldest}", f"{n.movers} moving", place.get(n.placement, n.placement.replace("_", " "))]
    if math.isfinite(n.sigma_m) and n.placement != "unknown":
        parts[-1] += f" ± {2.0 * n.sigma_m:.1f} m"
    if n.withheld:
        parts.append(f"{n.withheld} planes withheld")
    return {"vehicle": n.vehicle, "silent_s": round(n.silent_s, 1), "text": "; ".join(parts)}


def _mover(m: NeighbourMover) -> dict[str, Any]:
    """sender: vehicle; name: for a label; box: centre and half size in whole centimetres of ned, with the margin; to: where it will
    be in one second."""
    half = [h + m.margin_m for h in m.half_size_m]
    to = (m.centre_m[0] + m.velocity_m_s[0], m.centre_m[1] + m.velocity_m_s[1], m.centre_m[2])
    values = [round(100.0 * v) for v in (*m.centre_m, *half)]
    name = f"vehicle {m.sender}" if m.is_vehicle else f"moving, by vehicle {m.sender}"
    return {"sender": m.sender, "name": name, "box": values, "to": [round(100.0 * v) for v in to]}
