"""What arrives for the pipeline from all threads, in one order: bounded, and of frames the newest only.

A frame that is overtaken by a newer one of its camera before the pipeline takes it stays in its place as a word that it
was dropped, so that the log tells of it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

from core.types import CameraInfo, DepthFrame

from ..pipeline.events import Item, SupersededFrame

WAKE_ITEMS = 64
"""Samples that wait together before the pipeline is woken for them: they matter to the next frame, which wakes it too. To
wake takes more than to handle some dozens."""
MAX_ITEMS = 4096
"""Samples that wait; at 200 Hz those of 20 s. Older ones give way and are counted."""


class EventQueue:
    """put_... from any thread, `take` from the pipeline's."""

    def __init__(self, max_items: int = MAX_ITEMS) -> None:
        self._items: deque[Item] = deque()
        self._max_items = max_items
        self._changed = threading.Condition()
        self.lost = 0

    def put(self, items: Sequence[Item]) -> None:
        """Samples, raw frames or a camera's description."""
        with self._changed:
            self._items.extend(items)
            kept: list[Item] = []
            while len(self._items) > self._max_items:
                oldest = self._items.popleft()
                if isinstance(oldest, CameraInfo):
                    kept.append(oldest)  # without it, no frame of the camera could be understood
                else:
                    self.lost += 1
            self._items.extendleft(reversed(kept))
            if len(self._items) >= WAKE_ITEMS:
                self._changed.notify()

    def put_frame(self, frame: DepthFrame) -> None:
        """A depth frame; one of the same camera that still waits is overtaken."""
        with self._changed:
            for i, item in enumerate(self._items):
                if isinstance(item, DepthFrame) and item.camera == frame.camera:
                    self._items[i] = SupersededFrame(item.camera, item.sequence, item.t_exposure_ns, item.t_arrival_ns)
            self._items.append(frame)
            self._changed.notify()

    def take(self, timeout_s: float) -> list[Item]:
        """All that waits, up to and with the first frame: what comes behind it may still be overtaken. Waits for a frame,
        or for several samples, and takes after timeout_s what there is."""
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
