"""Remembers free space that has left the image because the vehicle leans.

In forward flight the vehicle pitches down and the upper part of the near space leaves the image. It was seen a moment
before, from farther away or while level. The cells of a grid in ned hold when they were last seen free. A cell counts
as free only if it lies outside of all views, in a sector of which the cameras see `SEEN_SHARE` now, and for
`remember_free_s`. A cell in which a later frame finds an obstacle stops being free, also after the obstacle has left
the image. Without a position nothing is remembered, and a frame without one ends what was; a camera that becomes blind
ends what it saw free."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ..config.avoidance import AvoidParams
from .obstacle_memory import Here
from .view_free import View, in_image, points_free

NS = 1_000_000_000
LEAST_APART_NS = NS // 10
"""Least time between two frames of a camera that are searched for free space. More frames take time and add nothing."""
SLACK_M = 1.0
"""Distance by which the grid extends beyond the range of the obstacle output, since the vehicle moves and climbs."""
NEVER = -math.inf
OBSTACLE = 0
"""Number that stands for an obstacle in place of a camera that saw a cell free."""
FREE_ONCE = 255
"""Number of a cell that one frame has seen free after an obstacle was found in it."""


class FreeMemory:
    """A grid around the vehicle with the time at which each cell was last seen free or occupied. Not thread-safe."""

    def __init__(self, avoid: AvoidParams, reach_m: float = 0.0) -> None:
        """reach_m: horizontal range to which free space is remembered; at least max_distance_m."""
        self._avoid = avoid
        self._height_m = (avoid.band_above_m + avoid.band_below_m) / avoid.slices
        across = math.ceil(2.0 * (max(avoid.max_distance_m, reach_m) + SLACK_M) / avoid.step_m)
        up = math.ceil((avoid.band_above_m + avoid.band_below_m + 2.0 * SLACK_M) / self._height_m)
        self._cell_m = np.array([self._height_m, avoid.step_m, avoid.step_m])  # z, x, y
        self._seen_s = np.full((up, across, across), NEVER)
        # number of the camera that saw it free, or OBSTACLE, or FREE_ONCE; of cells never seen: OBSTACLE
        self._seen_by = np.zeros(self._seen_s.shape, np.uint8)
        self._numbers: dict[str, int] = {}
        self._low = np.zeros(3, np.int64)  # the cell of ned at [0, 0, 0]
        self._estimate: tuple[int | None, int] | None = None
        self._newest_ns: dict[str, int] = {}
        self._taken_ns: dict[str, int] = {}
        self._saw_free: set[str] = set()

    def forget(self, camera: str) -> None:
        """Forgets what a camera saw free, because it has become blind: what came into its view meanwhile is not known."""
        if camera in self._saw_free:
            self._saw_free.remove(camera)
            of_it = self._seen_by == self._numbers[camera]
            self._seen_s[of_it], self._seen_by[of_it] = NEVER, OBSTACLE

    def see(self, camera: str, t_ns: int, view: View, here: Here, placed: bool = True) -> None:
        """Records the cells that a camera sees free or occupied. A frame frees no cell in which one of the same time or
        a newer one has found an obstacle.

        Open space is presumed free and is not recorded: it counts only as long as its evidence is in view.

        Args:
            camera: name.
            t_ns: exposure of the frame. Several calls with one exposure count once.
            view: the frame, in level, with all of its planes, confirmed or not.
            here: position and heading of the vehicle.
            placed: True if the view is placed by positions of the section of `here`. Otherwise the distance flown
                since the exposure is not known: obstacles are recorded, free space is not."""
        if self._avoid.remember_free_s == 0.0 or not view.model.valid or t_ns == self._newest_ns.get(camera):
            return
        self._newest_ns[camera] = t_ns
        if here.position_ned_m is None:
            self._estimate = None  # its obstacles cannot be recorded, so that the cells do not count any more
            return
        self._move_to(here)
        if placed and t_ns - self._taken_ns.get(camera, -LEAST_APART_NS) >= LEAST_APART_NS:
            self._taken_ns[camera] = t_ns
            self._saw_free.add(camera)
            self._see_free(self._numbers.setdefault(camera, OBSTACLE + 1 + len(self._numbers)), t_ns, view, here)
        occupied = self._occupied(view.model.planes.astype(np.float64), here)
        self._seen_s[occupied] = np.maximum(self._seen_s[occupied], t_ns / NS)
        self._seen_by[occupied] = OBSTACLE

    def _see_free(self, number: int, t_ns: int, view: View, here: Here) -> None:
        """Records the cells that a view shows free. number: of its camera."""
        assert here.position_ned_m is not None
        # middles of the cells in ned
        z_n, x_n, y_n = ((self._low[k] + np.arange(self._seen_s.shape[k]) + 0.5) * self._cell_m[k] for k in range(3))
        east, north = np.meshgrid(y_n, x_n)
        x, y = here.from_world().places(north, east)
        free = points_free(view, x, y, z_n - here.position_ned_m[2], along_rays=True, measured=True)
        free &= self._seen_s < t_ns / NS
        after_obstacle = (self._seen_by[free] == OBSTACLE) & (self._seen_s[free] > NEVER)
        self._seen_by[free] = np.where(after_obstacle, FREE_ONCE, number)
        self._seen_s[free] = t_ns / NS

    def free(
        self,
        views: Sequence[View],
        here: Here,
        now_ns: int,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        z: NDArray[np.float64],
        cameras: Collection[str] | None = None,
    ) -> NDArray[np.bool_]:
        """Returns (N,) bool: True for points that were seen free lately and are in the image of no view now.

        x, y, z: (N,) m in level. cameras: those whose memory counts; None: all. What a blind camera saw does not count."""
        if here.position_ned_m is None or here.estimate != self._estimate:
            return np.zeros(len(x), bool)
        ned = np.stack([z + here.position_ned_m[2], *here.to_world().places(x, y)])
        cell = np.floor(ned / self._cell_m[:, None]).astype(np.int64) - self._low[:, None]
        inside = ((cell >= 0) & (cell < np.array(self._seen_s.shape)[:, None])).all(axis=0)
        out = np.zeros(len(x), bool)
        at = tuple(cell[:, inside])
        out[inside] = now_ns / NS - self._seen_s[at] <= self._avoid.remember_free_s
        out[inside] &= (self._seen_by[at] != OBSTACLE) & (self._seen_by[at] != FREE_ONCE)
        if cameras is not None:
            counts = [number for camera, number in self._numbers.items() if camera in cameras]
            out[inside] &= np.isin(self._seen_by[at], counts)
        for view in views:
            out &= ~in_image(view, x, y, z)
        return out

    def _occupied(self, planes: NDArray[np.float64], here: Here) -> NDArray[np.bool_]:
        """Returns the cells, in the shape of the grid, through which planes pass, and their neighbours. planes: (N,
        6) in level."""
        assert here.position_ned_m is not None
        up, across, _ = self._seen_s.shape
        out = np.zeros(self._seen_s.shape, bool)
        pz = here.position_ned_m[2]
        samples = np.ceil(2.0 * np.hypot(*(planes[:, 2:4] - planes[:, :2]).T) / self._avoid.step_m).astype(int) + 1
        plane = np.repeat(np.arange(len(planes)), samples)
        number = np.arange(len(plane)) - np.repeat(np.cumsum(samples) - samples, samples)
        share = number / np.maximum(1, samples - 1)[plane]
        x, y = (planes[plane, i] + share * (planes[plane, i + 2] - planes[plane, i]) for i in (0, 1))
        north, east = (
            np.floor(place / self._cell_m[k]).astype(np.int64) - self._low[k]
            for k, place in enumerate(here.to_world().places(x, y), start=1)
        )
        top, bottom = (np.floor((planes[plane, i] + pz) / self._cell_m[0]) - self._low[0] for i in (4, 5))
        inside = (north >= 0) & (north < across) & (east >= 0) & (east < across)
        heights = np.arange(up)[None, :]
        which, height = np.nonzero(inside[:, None] & (heights >= top[:, None]) & (heights <= bottom[:, None]))
        out[height, north[which], east[which]] = True
        for axis in (1, 2):  # a ray passes between two cells that touch at a corner
            shifted = out.copy()
            first, last = (
                tuple(slice(*ends) if k == axis else slice(None) for k in range(3)) for ends in ((1, None), (None, -1))
            )
            shifted[first] |= out[last]
            shifted[last] |= out[first]
            out = shifted
        return out

    def _move_to(self, here: Here) -> None:
        """Moves the grid to the vehicle. Another section of the estimate of position or heading empties it."""
        assert here.position_ned_m is not None
        x, y, z = here.position_ned_m
        shape = np.array(self._seen_s.shape)
        low = np.floor(np.array([z, x, y]) / self._cell_m).astype(np.int64) - shape // 2
        shift = low - self._low
        fresh, fresh_by = np.full(tuple(shape), NEVER), np.zeros(tuple(shape), np.uint8)
        if here.estimate == self._estimate and (np.abs(shift) < shape).all():
            to = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(shift, shape, strict=True))
            of = tuple(slice(max(0, d), n - max(0, -d)) for d, n in zip(shift, shape, strict=True))
            fresh[to], fresh_by[to] = self._seen_s[of], self._seen_by[of]
        self._seen_s, self._seen_by, self._low, self._estimate = fresh, fresh_by, low, here.estimate
