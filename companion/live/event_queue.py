"""The bounded queue from all threads to the pipeline: one order for all items, and only the newest frame per camera.

A frame that a newer one of its camera replaces before the pipeline takes it is kept in its place as a SupersededFrame,
so that the log records the drop. The newer one has its turn before the frames of other cameras that waited behind it:
otherwise, of cameras that are exposed together, the last one would never be used while a frame takes longer than their
period."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample

from ..pipeline.events import Item, SupersededFrame

WAKE_ITEMS = 64
"""Number of waiting samples at which the pipeline is woken. Samples matter only to the next frame, which wakes it
anyway, and a wake-up costs more than the handling of some dozens of samples."""
MAX_ITEMS = 4096
"""Largest number of waiting items: samples of 20 s at 200 Hz. Older items are dropped."""


class EventQueue:
    """`put` and `put_frame` may be called from any thread, `take` from the pipeline's thread. lost: number of dropped attitudes
    and positions."""

    def __init__(self, max_items: int = MAX_ITEMS) -> None:
        self._items: deque[Item] = deque()
        self._max_items = max_items
        self._changed = threading.Condition()
        self.lost = 0

    def put(self, items: Sequence[Item]) -> None:
        """Adds samples, MAVLink messages or a camera's description."""
        with self._changed:
            self._items.extend(items)
            self._drop_oldest()
            if len(self._items) >= WAKE_ITEMS:
                self._changed.notify()

    def put_frame(self, frame: DepthFrame) -> None:
        """Adds a depth frame. A waiting frame of the same camera is superseded."""
        with self._changed:
            behind = self._supersede(frame.camera)
            self._items.append(frame)
            self._items.extend(behind)
            self._drop_oldest()
            self._changed.notify()

    def _supersede(self, camera: str) -> list[DepthFrame]:
        """Supersedes the waiting frame of a camera. Returns the frames of the others that waited behind it, taken out: later they
        have more attitudes, but each is to be used with the description of its camera before it."""
        items = list(self._items)
        of_camera = (
            (i, item) for i, item in enumerate(items) if isinstance(item, DepthFrame) and item.camera == camera
        )
        place, old = next(of_camera, (0, None))
        if old is None:
            return []
        self._items[place] = SupersededFrame(camera, old.sequence, old.t_exposure_ns, old.t_arrival_ns)
        after = items[place + 1 :]
        if any(isinstance(item, CameraInfo) for item in after):
            return []
        behind = [item for item in after if isinstance(item, DepthFrame)]
        for frame in behind:
            self._items.remove(frame)
        return behind

    def _drop_oldest(self) -> None:
        """Keeps the limit of waiting items."""
        kept: list[Item] = []
        while len(self._items) > self._max_items:
            oldest = self._items.popleft()
            if isinstance(oldest, CameraInfo):
                kept.append(oldest)  # frames of the camera cannot be interpreted without it
            else:
                self.lost += isinstance(oldest, AttitudeSample | PoseSample)
        self._items.extendleft(reversed(kept))

    def take(self, timeout_s: float) -> list[Item]:
        """The waiting items up to and including the first frame; later items stay, since they may still be superseded.
        Waits up to timeout_s for a frame or for WAKE_ITEMS samples."""
        with self._changed:
            if len(self._items) < WAKE_ITEMS and not any(isinstance(item, DepthFrame) for item in self._items):
                self._changed.wait(timeout_s)
            taken: list[Item] = []
            while self._items:
                item = self._items.popleft()
                taken.append(item)
                if isinstance(item, DepthFrame):
                    break
            return taken
