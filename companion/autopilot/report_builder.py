"""Decides what is sent to the autopilot, without cameras, pipeline, clock or link.

A decision uses the newest frame of each camera and its age at the moment of sending. If no new frame arrives, the age
of the newest one grows beyond the limit and the failsafe policy decides. A fault of another thread therefore cannot
let an old result go out as a new one."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from core.types import AttitudeSample, CameraInfo, FrameModel, PoseSample

from ..cameras.masks import Mask
from ..config.avoidance import AvoidParams
from ..pipeline.multi_camera import HEADING_LOST
from ..pipeline.results import PrismsResult
from .camera_coverage import Coverage, CoveredSectors, Look, covered_sectors, everywhere, looked_into
from .confirmation import PlaneConfirmation
from .distance_sensor import Overhead, downward_m
from .failsafe import AutopilotNow, BlindPolicy, PolicyInput, Recovery, braking_reach, policy_of
from .free_space_memory import FreeMemory
from .obstacle_distance import for_reader
from .obstacle_distance_3d import other_points
from .obstacle_memory import Here, ObstacleMemory, Remembered, nothing_remembered
from .obstacle_report import RECKONING_ERRORS, CameraUse, ObstacleReport
from .polar_histogram import SECTORS, Recall, SectorScan, scan
from .seen_sectors import SectorSight, SeenSectors
from .surroundings import Surroundings
from .vehicle_motion import VehicleMotion, seen_ns
from .view_free import View, ground_z_m

NS = 1_000_000_000
STANDING_M = 0.8
"""Greatest height of the vehicle's middle above the ground while the vehicle stands on it."""

MOST_WAITING = 1024
"""Most results that wait for the next cycle of the sender. If the sender does not respond, further ones are dropped, and what
waits grows too old to be used."""
MOST_UNDECIDED = 8
"""Most frames of a camera that are kept for the next decision; further ones replace the oldest."""


@dataclass(slots=True, kw_only=True, eq=False)
class _Decision:
    """What one decision is made from."""

    now_ns: int  # instant of the decision
    causes: dict[str, str]  # camera -> why it is blind, as text; empty: it is not
    here: Here | None = None  # the vehicle; None: its attitude is not known
    seeing: list[str] = field(default_factory=list)  # cameras that see
    views: list[View] = field(default_factory=list)  # of these cameras, in level; empty without an attitude
    recall: Recall | None = None  # see `polar_histogram.Recall`; None: nothing is remembered
    found: SectorScan  # sectors by these views
    recalled: Remembered = field(default_factory=nothing_remembered)
    fault: str = ""  # error of the computation, as text; empty: none

    @property
    def blind(self) -> dict[str, str]:
        """Camera -> cause of each blind camera."""
        return {camera: why for camera, why in self.causes.items() if why}


class ObstacleReportBuilder:
    """Decides what to send at an instant. It has no thread, clock or link.

    `samples`, `announce`, `result` and `end` may be called from any thread and never wait for a decision. `catch_up` and
    `decide` are called by one thread at a time; everything else belongs to it."""

    def __init__(self, avoid: AvoidParams, use: CameraUse) -> None:
        """Makes a builder without any frame yet. avoid: parameters of the obstacle output."""
        self._avoid, self._use, self._cameras, self._observer = avoid, use, use.cameras, use.observer
        self._timeout_ns = round(use.timeout_s * NS)
        self._waiting: deque[tuple[CameraInfo, Coverage] | PrismsResult] = deque()
        self._motion = VehicleMotion()
        self._newest: dict[str, PrismsResult] = {}
        self._confirmation: dict[str, PlaneConfirmation] = {}
        self._confirmed: dict[str, PrismsResult] = {}
        self._seen = SeenSectors(avoid)
        self._infos: dict[str, CameraInfo] = {}
        self._coverage: dict[str, Coverage] = {}
        self._everywhere = everywhere(avoid)
        # the seeing cameras, and the sectors for them; None: not computed
        self._covered: tuple[tuple[str, ...], CoveredSectors] | None = None
        self._recovery = Recovery(use.cameras, avoid.recover_frames)
        self._policy = BlindPolicy(avoid)
        self._memory = ObstacleMemory(avoid)
        self._freed = FreeMemory(avoid, use.reach_m)
        self._overhead = Overhead(avoid)
        self._overhead_ns: dict[str, int] = {}
        self._undecided: dict[str, deque[PrismsResult]] = {c: deque(maxlen=MOST_UNDECIDED) for c in use.cameras}
        self._newest_good_ns: int | None = None
        self._ended = ""

    def samples(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Adds attitudes and positions in the order in which they arrive."""
        self._motion.samples(samples)

    def announce(self, info: CameraInfo, hidden: Mask | None = None) -> None:
        """Records the directions that a camera covers, once it is open. hidden: pixels that are never measured."""
        self._waiting.append((info, looked_into(info, self._avoid, hidden)))

    def result(self, result: PrismsResult) -> None:
        """Adds the result of a frame, valid or not."""
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append(result)

    def end(self, cause: str) -> None:
        """Makes all cameras count as blind from now on, for this cause."""
        self._ended = cause

    def catch_up(self) -> None:
        """Takes the cameras and results that have arrived, in order."""
        while self._waiting:
            arrived = self._waiting.popleft()
            if isinstance(arrived, PrismsResult):
                self._take(arrived)
            else:
                info, coverage = arrived
                self._infos[info.camera], self._coverage[info.camera] = info, coverage
                self._covered = None
                self._confirmation[info.camera] = PlaneConfirmation(self._avoid, info.intrinsics)

    def _take(self, result: PrismsResult) -> None:
        self._newest[result.camera] = result
        self._confirmed.pop(result.camera, None)
        self._recovery.frame(result.camera, result.valid)
        if not result.valid:
            return
        if result.camera in self._infos:
            self._confirmed[result.camera] = self._confirmation[result.camera].take(result)
        self._undecided[result.camera].append(result)
        self._newest_good_ns = max(self._newest_good_ns or 0, seen_ns(result))

    def decide(self, autopilot: AutopilotNow, now_ns: int) -> ObstacleReport:
        """Returns what to send now."""
        try:
            self.catch_up()
            return self._decided(autopilot, now_ns)
        except RECKONING_ERRORS as error:
            fault = f"the distances around the vehicle cannot be computed: {type(error).__name__}: {error}"
        causes = dict.fromkeys(self._cameras, "its result cannot be computed with")
        self._recovery.blind(causes)
        return self._report(
            autopilot, _Decision(now_ns=now_ns, causes=causes, found=scan([], self._avoid), fault=fault)
        )

    def _decided(self, autopilot: AutopilotNow, now_ns: int) -> ObstacleReport:
        here = self._motion.catch_up(now_ns)
        d = _Decision(now_ns=now_ns, causes=self._causes(here, now_ns), here=here, found=scan([], self._avoid))
        for camera in d.blind:
            self._freed.forget(camera)
        d.seeing = [camera for camera in self._cameras if not d.causes[camera]]
        if here is not None:
            self._see(d, here)
            d.recall = partial(self._freed.free, d.views, here, now_ns, cameras=d.seeing)
            d.found = self._scan(d, here)
        if self._motion.last_here is not None:  # without an attitude remembered obstacles stay where they were
            d.recalled = self._memory.recall(d.found, d.views, self._motion.last_here, now_ns)
        if self._observer is not None:
            self._observer(self._surroundings(d))
        return self._with_heights(self._report(autopilot, d), d)

    def _causes(self, here: Here | None, now_ns: int) -> dict[str, str]:
        """Returns why each camera is blind; empty: it is not. A camera sees again after some good frames."""
        causes = {camera: self._cause(camera, here, now_ns) for camera in self._cameras}
        self._recovery.blind(causes)
        for camera, cause in causes.items():
            if not cause and not self._recovery.recovered(camera):
                causes[camera] = "too few valid frames in a row"
        return causes

    def _see(self, d: _Decision, here: Here) -> None:
        """Makes the views of the seeing cameras, and remembers what they and the frames before show free or occupied."""
        self._see_undecided(d.seeing, here)
        d.views = [self._view(self._confirmed.get(c, self._newest[c]), here) for c in d.seeing]
        for camera, view in zip(d.seeing, d.views, strict=True):
            newest = self._newest[camera]
            # a plane that is not confirmed yet is an obstacle to the memory of free space
            complete = view if self._confirmed.get(camera, newest) is newest else self._view(newest, here)
            self._freed.see(camera, seen_ns(newest), complete, here, self._motion.placed(newest, here))

    def _see_undecided(self, seeing: list[str], here: Here) -> None:
        """Ends remembered free space where the frames since the last decision show obstacles: those that are not the newest
        ones, and those of a camera that does not count as seeing yet."""
        for camera, results in self._undecided.items():
            for result in results:
                decides = camera in seeing and result is self._newest[camera]
                usable = camera in self._infos and result.model is not None and all_numbers(result.model)
                if usable and not decides:
                    self._freed.see(camera, seen_ns(result), self._view(result, here), here, placed=False)
            results.clear()

    def _scan(self, d: _Decision, here: Here) -> SectorScan:
        """Returns the sectors, completed by what recent frames have shown.

        A sector that the newest frames do not see may keep its earlier value if no camera that covers it is blind."""
        exposed_ns = np.zeros(SECTORS, np.int64)
        for camera in d.seeing:
            covers = (self._coverage[camera].look > Look.NOTHING).any(axis=1)
            exposed_ns[covers] = np.maximum(exposed_ns[covers], seen_ns(self._newest[camera]))
        blind = self._covered_by(d).blind
        velocity_m_s = self._motion.velocity_m_s(d.now_ns)
        speed_m_s = None if velocity_m_s is None else math.hypot(*velocity_m_s)
        found = scan(d.views, self._avoid, d.recall)
        ned_m_s = self._motion.velocity_ned_m_s(d.now_ns)
        down_m_s = None if ned_m_s is None else ned_m_s[2]
        return self._seen.take(found, SectorSight(exposed_ns, blind, here.heading_rad, speed_m_s, d.now_ns, down_m_s))

    def _with_heights(self, report: ObstacleReport, d: _Decision) -> ObstacleReport:
        """Adds the obstacles above and below to a report, where that is switched on."""
        avoid, points_m, up_m, down_m = self._avoid, report.points_m, None, None
        if avoid.points:
            points_m = other_points(d.views, avoid)
        if avoid.upward and d.here is not None:
            for camera, view in zip(d.seeing, d.views, strict=True):
                if seen_ns(self._newest[camera]) != self._overhead_ns.get(camera):
                    self._overhead_ns[camera] = seen_ns(self._newest[camera])
                    self._overhead.see(view, d.here, d.now_ns)
            up_m = self._overhead.upward_m(d.here, d.now_ns)
        if avoid.downward:
            down_m = downward_m(d.views)
        return replace(report, points_m=points_m, up_m=up_m, down_m=down_m)

    def _report(self, autopilot: AutopilotNow, d: _Decision) -> ObstacleReport:
        """Applies the failsafe policy and makes the report."""
        sectors = self._covered_by(d)
        given = PolicyInput(
            scan=d.found,
            recalled=d.recalled,
            blind=sectors.blind,
            seeing=sectors.seeing,
            whole=sectors.whole,
            newest_ns=self._newest_good_ns,
            heights_lost=sectors.heights_lost,
            edge=sectors.edge,
            velocity_m_s=self._motion.velocity_m_s(d.now_ns),
            on_ground=autopilot.on_ground and not _sees_ground_below(d.views),
        )
        policy = policy_of(self._avoid, autopilot)
        values = self._policy.values(given, policy, d.now_ns)
        if values is not None:
            reach, wall_cm = braking_reach(given, self._avoid, policy), policy.wall_cm if policy.name == "stop" else 0
            values = for_reader(values, self._avoid, autopilot.kind, reach, wall_cm)
        return ObstacleReport(d.now_ns, values, d.blind, policy.name, d.fault, exposed_ns=self._exposed_ns(d.seeing))

    def _cause(self, camera: str, here: Here | None, now_ns: int) -> str:
        """Returns why a camera is blind at this instant; empty: it is not."""
        newest = self._newest.get(camera)
        if self._ended:
            return self._ended
        if newest is None:
            return "no frame yet"
        if not newest.valid:
            return newest.cause_text
        if camera not in self._coverage:
            return "its intrinsics and mount are unknown"
        if newest.model is None or not all_numbers(newest.model):
            return "its planes hold values that are not finite"
        frame_fault = self._use.frame_fault(camera)
        if frame_fault:
            return frame_fault
        age_ns = now_ns - seen_ns(newest)
        if age_ns > self._timeout_ns:
            return f"its newest exposure is {age_ns / NS:.1f} s old"
        if here is None:
            return "the attitude is lost"
        return HEADING_LOST if self._motion.heading_lost(newest) else ""

    def _surroundings(self, d: _Decision) -> Surroundings:
        seeing, pose = (d.seeing if d.views else []), self._motion.newest_pose
        return Surroundings(
            t_ns=d.now_ns,
            views=tuple(d.views),
            weak_px=tuple(self._confirmation[c].least_px for c in seeing),
            exposed_ns=self._exposed_ns(seeing),
            recall=d.recall,
            recalled=d.recalled,
            blind=d.blind,
            here=d.here,
            velocity_ned_m_s=self._motion.velocity_ned_m_s(d.now_ns),
            velocity_ns=None if pose is None else pose.t_ns,
            frames=tuple((c, seen_ns(self._newest[c])) for c in seeing),
            moved=d.here is None or all(self._motion.moves(self._newest[c], d.here) for c in seeing),
        )

    def _exposed_ns(self, seeing: list[str]) -> int | None:
        """Returns the oldest of the newest exposures of these cameras; None: there are none."""
        return min((seen_ns(self._newest[c]) for c in seeing), default=None)

    def _covered_by(self, d: _Decision) -> CoveredSectors:
        """Returns the sectors that the blind and the seeing cameras cover. A camera that was never opened may cover any
        direction."""
        seeing = tuple(camera for camera in self._cameras if not d.causes[camera])
        if self._covered is None or self._covered[0] != seeing:
            blind, sees = (
                [self._coverage.get(camera, self._everywhere) for camera in cameras] for cameras in (d.blind, seeing)
            )
            self._covered = seeing, covered_sectors(blind, sees, self._avoid)
        return self._covered[1]

    def _view(self, result: PrismsResult, here: Here) -> View:
        return self._motion.view(
            result, here, self._infos[result.camera], self._use.params.profile_ring_m, self._use.open_counts
        )


def _sees_ground_below(views: list[View]) -> bool:
    """True if any camera sees the ground farther than STANDING_M below the vehicle's middle: then the vehicle flies,
    whatever the autopilot reports."""
    here = np.zeros(1)
    return any(STANDING_M < ground_z_m(view, here, here)[0] < math.inf for view in views)


def all_numbers(model: FrameModel) -> bool:
    """True if all planes are finite. A plane that is not would hide all others."""
    return bool(np.isfinite(model.planes).all() and np.isfinite(model.margin_m).all())
