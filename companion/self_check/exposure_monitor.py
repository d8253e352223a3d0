"""Measures the offset between a camera's exposure stamps and the attitude while the vehicle turns.

The rotation between two depth images (core/self_check/depth_registration.py) is compared with the rotation of the
attitude between their stamps, shifted by each lag of a grid (exposure_fit.py). The result is used for diagnostics only
and affects no frame. Equal events in equal order give equal estimates, live and in replay."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical, rotation_from_quaternion
from core.self_check.depth_registration import Pyramid, depth_pyramid, motion_between
from core.types import AttitudeSample, CameraInfo, DepthFrame
from drivers.base import Event

from ..cameras.masks import Mask, apply_mask
from .attitude_history import AttitudeHistory
from .exposure_fit import LAGS_S, LagFit, fit_lag
from .exposure_offset import ExposureOffset, OffsetState

NS = 1_000_000_000
MAX_SIGMA_S = 0.0015
"""Largest standard deviation of a reported offset."""
MIN_EXPLAINED = 0.8
"""Least share of the images' rotation that the attitude explains: a smaller one has another cause than a lag."""
MIN_PAIRS, MAX_PAIRS, EVERY_PAIRS = 48, 180, 12
"""Pairs for a report, pairs kept (about 25 s of motion), and pairs between two fits."""
GUESS_PAIRS, GUESS_S = 24, 0.004
"""Pairs for a first estimate, and the largest distance of the registration's initial lag from the estimate."""
RESTART_S, MAX_AWAY_S = 0.006, 0.012
"""Distances of the estimate from the lag of the grid at which the registrations began: beyond the first, a little more than
half a step of the grid, they begin again there; from the second on no offset is reported."""
PAIR_NS, PAIR_MAX_NS = 110_000_000, 300_000_000
"""Time between the images of a pair: longer gives more rotation for the same noise and fewer computations; the upper
limit ensures overlap."""
MAX_WAITING = 8
"""Number of images that wait for attitudes."""
MIN_SPREAD_RAD = 1e-3
"""Pairs whose predicted rotation varies less than this over all lags do not determine the lag and are not registered.
"""
LAGS_NS = np.round(LAGS_S * NS).astype(np.int64)


class ExposureOffsetMonitor:
    """Monitors all cameras. `event` takes everything that the pipeline handles, in the same order."""

    def __init__(self, mask: Callable[[CameraInfo], Mask | None] = lambda info: None) -> None:
        """mask: pixels that show the vehicle, which do not move with its rotation."""
        self._mask = mask
        self._cameras: dict[str, _Camera] = {}
        self._attitudes = AttitudeHistory()

    def announce(self, info: CameraInfo) -> None:
        """Adds an opened camera. A camera with a changed description starts again."""
        known = self._cameras.get(info.camera)
        if known is None or known.info != info:
            self._cameras[info.camera] = _Camera(info, self._mask(info))

    def event(self, event: Event) -> None:
        """Adds an attitude or a frame; positions and frames of unknown cameras are not used."""
        if isinstance(event, AttitudeSample):
            if not self._attitudes.add(event):
                for name, camera in self._cameras.items():
                    self._cameras[name] = _Camera(camera.info, camera.mask)
        elif isinstance(event, DepthFrame) and event.camera in self._cameras:
            self._cameras[event.camera].frame(event, self._attitudes)

    def offsets(self) -> tuple[ExposureOffset, ...]:
        """The present estimates."""
        return tuple(camera.offset for camera in self._cameras.values())


@dataclass(frozen=True, slots=True, eq=False)
class _Image:
    """A reduced image, its stamp, and the camera's attitude at each lag (L, 3, 3), R_ned_optical."""

    pyramid: Pyramid
    t_ns: int
    R_ned_optical: NDArray[np.float64] | None = None


class _Camera:
    """One camera: images that wait for attitudes, and pairs."""

    def __init__(self, info: CameraInfo, mask: Mask | None) -> None:
        self.info, self.mask = info, mask
        self.offset = ExposureOffset(camera=info.camera, state=OffsetState.NO_ATTITUDE)
        self._R_frd_optical = rotation_frd_optical(info.mount)
        self._waiting: deque[_Image] = deque()
        self._last: _Image | None = None
        self._guess_s = 0.0
        self._fresh = 0
        self._measured: deque[NDArray[np.float64]] = deque(maxlen=MAX_PAIRS)
        self._sigma: deque[NDArray[np.float64]] = deque(maxlen=MAX_PAIRS)
        self._predicted: deque[NDArray[np.float64]] = deque(maxlen=MAX_PAIRS)

    def frame(self, frame: DepthFrame, attitudes: AttitudeHistory) -> None:
        """Keeps the image if it is due; registers one pair whose attitudes are complete."""
        k = self.info.intrinsics
        newest = self._waiting[-1] if self._waiting else self._last
        if newest is not None and frame.t_exposure_ns < newest.t_ns - NS:  # the camera restarted
            self._waiting.clear()
            self._last = newest = None
        if frame.depth_mm.shape == (k.height, k.width) and (
            newest is None or frame.t_exposure_ns - newest.t_ns >= PAIR_NS
        ):
            pyramid = depth_pyramid(apply_mask(frame.depth_mm, self.mask), self.info)
            self._waiting.append(_Image(pyramid, frame.t_exposure_ns))
        if self._waiting and attitudes.newest_ns is not None:
            if attitudes.newest_ns > self._waiting[0].t_ns - int(LAGS_NS[0]):
                self._take(self._waiting.popleft(), attitudes)
            elif len(self._waiting) > MAX_WAITING:
                self._waiting.popleft()

    def _take(self, image: _Image, attitudes: AttitudeHistory) -> None:
        before = self._last
        self._last = None
        q = attitudes.at((image.t_ns - LAGS_NS)[::-1])
        if q is None:
            return
        turned = np.array([rotation_from_quaternion(tuple(row)) for row in q[::-1]]) @ self._R_frd_optical
        image = self._last = _Image(image.pyramid, image.t_ns, turned)
        if before is not None and before.R_ned_optical is not None and image.t_ns - before.t_ns <= PAIR_MAX_NS:
            self._pair(before, image, before.R_ned_optical, turned)

    def _pair(self, a: _Image, b: _Image, R_a: NDArray[np.float64], R_b: NDArray[np.float64]) -> None:
        R_b_a = R_b.transpose(0, 2, 1) @ R_a
        predicted = _rotation_vectors(R_b_a)
        if float(np.max(np.ptp(predicted, axis=0))) < MIN_SPREAD_RAD:
            if self.offset.state is OffsetState.NO_ATTITUDE:
                self.offset = ExposureOffset(camera=self.info.camera, state=OffsetState.NOT_ENOUGH_MOTION)
            return
        if np.array_equal(a.pyramid.fine.cells, b.pyramid.fine.cells, equal_nan=True):
            return  # a frozen image
        guess = int(np.argmin(np.abs(LAGS_S - self._guess_s)))
        motion = motion_between(a.pyramid, b.pyramid, np.ascontiguousarray(R_b_a[guess]))
        if motion is None:
            return
        self._measured.append(motion.rotation_rad)
        self._sigma.append(motion.rotation_sd_rad)
        self._predicted.append(predicted)
        self._fresh += 1
        if self.offset.state in (OffsetState.NO_ATTITUDE, OffsetState.NOT_ENOUGH_MOTION):
            self._report(OffsetState.COLLECTING)
        if self._fresh >= EVERY_PAIRS and len(self._measured) >= GUESS_PAIRS:
            self._fresh = 0
            self._fit()

    def _fit(self) -> None:
        fit = fit_lag(np.array(self._measured), np.array(self._sigma), np.array(self._predicted))
        away_s = abs(fit.lag_s - float(LAGS_S[np.argmin(np.abs(LAGS_S - self._guess_s))]))
        # a registration is biased towards its initial value: it starts again from here
        if fit.inside and abs(fit.lag_s - self._guess_s) > max(GUESS_S, 3.0 * fit.sigma_s) and away_s > RESTART_S:
            self._guess_s = fit.lag_s
            for kept in (self._measured, self._sigma, self._predicted):
                kept.clear()
            self._report(OffsetState.COLLECTING)
            return
        if len(self._measured) < MIN_PAIRS:
            self._report(OffsetState.COLLECTING)
        elif fit.inside and fit.sigma_s <= MAX_SIGMA_S and fit.explained >= MIN_EXPLAINED and away_s < MAX_AWAY_S:
            self._report(OffsetState.MEASURED, fit)
        else:
            self._report(OffsetState.UNCERTAIN)

    def _report(self, state: OffsetState, fit: LagFit | None = None) -> None:
        self.offset = ExposureOffset(
            camera=self.info.camera,
            state=state,
            offset_s=None if fit is None else fit.lag_s,
            sigma_s=None if fit is None else fit.sigma_s,
            pairs=len(self._measured),
        )


def _rotation_vectors(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(L, 3) rotation vectors of rotations (L, 3, 3) of less than a quarter turn."""
    axis = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine = np.sqrt(np.sum(axis**2, axis=1, keepdims=True))
    return np.asarray(axis * np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-9), 1.0))
