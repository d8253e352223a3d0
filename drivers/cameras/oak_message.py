"""The images in the messages of a Luxonis OAK, checked: of the requested streams, of one exposure, of one size, and new."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import Intrinsics

from ..base import BadData
from .oak_images import decoded
from .oak_pipeline import DEPTH, LEFT, RIGHT, OakSettings, first_line
from .stereo import Gray
from .torn_images import one_repeats

RESTART = "Restart the device"
_UNTESTED = (
    f"{RESTART}; to fly by the device's own confidence alone, set match_correlation = 0, match_texture = 0 "
    "and match_period = 1"
)


class OakMessages:
    """Reads the messages of a device. A message is a group of images, or the image of the only stream."""

    def __init__(self, settings: OakSettings) -> None:
        self._settings = settings
        self._before: tuple[Gray, Gray] | None = None

    @property
    def newest_pair(self) -> tuple[Gray, Gray] | None:
        """The pair that was read last; None: none was read."""
        return self._before

    def part(self, message: Any, name: str) -> Any:
        """The image of a name in a group; with one stream the message is its image. Raises BadData."""
        import depthai as dai

        if len(self._settings.streams) > 1:
            if not isinstance(message, dai.MessageGroup) or name not in message.getMessageNames():
                raise BadData(
                    f"camera {self._settings.camera}: a frame without its {name} image, which the stereo matching needs. "
                    f"{self._remedy}"
                )
            message = message[name]
        if not isinstance(message, dai.ImgFrame):
            raise BadData(
                f"camera {self._settings.camera}: a {name} image of type {type(message).__name__}; expected ImgFrame. "
                f"{self._remedy}"
            )
        return message

    @property
    def _remedy(self) -> str:
        return RESTART if self._settings.host_matching else _UNTESTED

    def apart_s(self, message: Any) -> float:
        """Time between the exposures of the left and the right image, 0 without images, and for images of different frames,
        which `pair` refuses. Raises BadData."""
        parts = {name: self.part(message, name) for name in self._settings.streams}
        if len(parts) == 1:
            return 0.0
        apart_s = abs(float((parts[LEFT].getTimestamp() - parts[RIGHT].getTimestamp()).total_seconds()))
        return apart_s if apart_s <= self._settings.same_exposure_s else 0.0

    def size(self, message: Any) -> tuple[int, ...]:
        """(H, W) of the images of a frame. Raises BadData."""
        first = self.part(message, self._settings.streams[0])
        return self._decoded(first, LEFT).shape if self._settings.host_matching else self.pixels(first).shape

    def _decoded(self, message: Any, name: str) -> NDArray[Any]:
        """The pixels of an image. Raises BadData."""
        try:
            return decoded(message)
        except (RuntimeError, ValueError) as error:  # fewer bytes than the size needs, or an unknown type
            raise BadData(
                f"camera {self._settings.camera}: a {name} image cannot be read ({first_line(error)}). {self._remedy}"
            ) from error

    def pixels(self, message: Any) -> NDArray[np.uint16]:
        import depthai as dai

        pixels = self._decoded(message, DEPTH)
        if message.getType() != dai.ImgFrame.Type.RAW16 or pixels.dtype != np.uint16 or pixels.ndim != 2:
            raise BadData(
                f"camera {self._settings.camera}: a frame of type {message.getType()}; expected RAW16, millimetres"
            )
        return np.ascontiguousarray(pixels)

    def intrinsics(self, message: Any) -> Intrinsics:
        """Of the images of a frame. Raises BadData."""
        height, width = self.size(message)
        first = self.part(message, self._settings.streams[0])
        transformation = first.getTransformation()
        if tuple(transformation.getSize()) != (width, height):
            stated = "x".join(str(side) for side in transformation.getSize())
            raise BadData(
                f"camera {self._settings.camera}: a frame has the intrinsics of an image of {stated}, its pixels are "
                f"{width}x{height}. {RESTART}"
            )
        matrix = np.array(transformation.getIntrinsicMatrix(), np.float64)
        try:
            return Intrinsics(
                width, height, float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])
            )
        except ValueError as error:
            raise BadData(
                f"camera {self._settings.camera}: {error}; check that the device has its factory calibration"
            ) from error

    def pair(self, group: Any) -> tuple[Gray, Gray]:
        """The rectified left and right image (H, W) uint8. Raises BadData where they are not of the size and the exposure of
        the frame, not rectified, or where one of both repeats."""
        shape = self.size(group)
        stamp = self.part(group, self._settings.streams[0]).getTimestamp()
        pair = []
        for name in (LEFT, RIGHT):
            message = self.part(group, name)
            apart_s = abs((message.getTimestamp() - stamp).total_seconds())
            image = self._decoded(message, name)
            if image.dtype != np.uint8 or image.shape != shape:
                raise BadData(
                    f"camera {self._settings.camera}: a {name} image of {image.dtype}, rows and columns {image.shape}, for "
                    f"a frame of {shape}; expected RAW8 of the same size. {self._remedy}"
                )
            if apart_s > self._settings.same_exposure_s:
                raise BadData(
                    f"camera {self._settings.camera}: a {name} image is stamped {apart_s:.3f} s from its frame. {self._remedy}"
                )
            pair.append(np.asarray(image, np.uint8))
        before, self._before = self._before, (pair[0], pair[1])
        if before is not None and one_repeats(self._before, before):
            raise BadData(
                f"camera {self._settings.camera}: one of both images is that of an earlier frame, while the other one changed. {RESTART}"
            )
        return pair[0], pair[1]
