"""Detects a camera that repeats its images while the stamps advance, or whose stamps do not advance."""

from __future__ import annotations

from collections import deque

import numpy as np
from fastcrc.crc32 import iso_hdlc
from numpy.typing import NDArray

from core.types import FAR_MM, DepthFrame, is_measured

NS = 1_000_000_000
FROZEN_HZ = 14.0
"""Frame rate at which the default of `frozen_frames` repetitions takes less than 0.3 s, the limit for stale frames."""
NEW_IMAGES = 2
"""New images since the last long repetition that end the state frozen: one may be left from before."""
KEPT = 64
"""Number of the newest images with which a new one is compared: more than the buffers of a camera's driver."""


class FrozenFrameDetector:
    """Examines the frames of one camera, over the restarts of its process: a device that hangs keeps its image.

    An image is repeated if it is equal to one of the last KEPT, by its CRC-32: a driver may deliver one buffer again, or all
    of them in turn. So is one that the host matched from an earlier pair of images: their depth changes with the alignment of
    their rows, which begins again with each start of the process. The camera is frozen after `frames` repetitions in a row, or
    after two in the time of as many at FROZEN_HZ: at a low frame rate the image would otherwise be older than the limit for stale
    frames. It is frozen until NEW_IMAGES new ones arrived. The noise changes every image of a live camera that measures enough.
    Images of which a share of at most `least_share` is measured do not count: a covered lens, darkness or a cloudless sky repeats
    them. Their frames are invalid with [extractor] min_measured_share of that size."""

    def __init__(self, frames: int, least_share: float = 0.0) -> None:
        self._frames = frames
        self._least_share = least_share
        self._images: deque[int] = deque(maxlen=KEPT)  # checksums, the newest last
        self._pairs: deque[int] = deque(maxlen=KEPT)  # of the images that they were matched from
        self._last_ns: int | None = None  # exposure of the newest frame
        self._same_images = self._unchanged_stamps = 0
        self._longest_ns = round(frames / FROZEN_HZ * NS)
        self._first_ns = 0  # exposure of the first of the same images
        self._frozen, self._new_images = False, 0

    def check(self, frame: DepthFrame) -> str:
        """Returns why the camera is frozen, as text; empty if it is not."""
        cause = self._repetition(frame)
        if cause:
            self._frozen, self._new_images = True, 0
        elif self._frozen:
            self._new_images += 0 if self._same_images or self._unchanged_stamps else 1
            if self._new_images < NEW_IMAGES:
                return f"fewer than {NEW_IMAGES} new images after repeated ones"
            self._frozen = False
        return cause

    def _repetition(self, frame: DepthFrame) -> str:
        """What repeats, as text; empty: nothing, or not often enough."""
        image, last_ns = int(iso_hdlc(frame.depth_mm.tobytes())), self._last_ns
        same_pair = frame.images_crc != 0 and frame.images_crc in self._pairs
        same_image = (same_pair or image in self._images) and self._measures(frame.depth_mm)
        same_stamp = last_ns is not None and frame.t_exposure_ns <= last_ns
        in_a_row = same_image and (image == self._images[-1] or (same_pair and frame.images_crc == self._pairs[-1]))
        self._images.append(image)
        self._pairs.append(frame.images_crc)
        self._last_ns = frame.t_exposure_ns
        self._same_images = self._same_images + 1 if same_image else 0
        self._unchanged_stamps = self._unchanged_stamps + 1 if same_stamp else 0
        if not self._same_images:
            self._first_ns = frame.t_exposure_ns
        too_long = self._same_images >= 2 and frame.t_exposure_ns - self._first_ns > self._longest_ns
        if self._same_images >= self._frames or too_long:
            if not in_a_row:
                return f"its images are those of before, {self._same_images} in a row"
            return f"the same image {self._same_images + 1} times in a row"
        if self._unchanged_stamps >= self._frames:
            return f"its stamps have not moved for {self._unchanged_stamps} frames"
        return ""

    @property
    def repeats(self) -> bool:
        """Whether the last image is that of an earlier frame. Its stamp is not that of its exposure: it must not be used with the
        attitude of that time, whether the camera counts as frozen or not yet."""
        return self._same_images > 0

    def _measures(self, depth_mm: NDArray[np.uint16]) -> bool:
        """Whether more pixels (H, W) than the least share are measured, or far, which counts as free."""
        known = is_measured(depth_mm) | (depth_mm == FAR_MM)
        return bool(np.count_nonzero(known) > self._least_share * depth_mm.size)
