"""The merged world: planes and free space of all frames of a flight, in ned by the autopilot's position estimate.

A jump of the estimate begins a new section. Of the previous one the planes are kept apart, because its place in the new
frame is not known. Without a position there is no merged world; clients then use the newest frame and a short memory
(osape_client/world/level_memory.py)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..free_view import FreeView, free_view
from ..types import FrameModel, Ground
from .association import OBSERVATION
from .free_grid import empty_free, held_blocks, see_free, seen_blocks
from .free_removal import arrived_in_free, remove_free
from .ground import see_ground
from .params import WorldParams
from .plane_index import BOX, columns, empty_tables
from .section import RecentFrame, Section, planes_to_load, saved_section
from .serialize import SavedSection, fitting
from .snapshot import WorldSnapshot
from .update import add_frame, observations_of, put_saved, rules_of

NS = 1_000_000_000
RESTART_S = 1.0
"""Timestamps that step back by more than this, for as long, mean a restart: a new section begins."""
_GAP_S = 5.0
"""After a longer time without a position, too."""
FARTHEST_M = 1e6
"""Greatest distance from the origin: beyond it float32 does not resolve decimetres, and the position estimate is
wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """The model of one frame in ned. Raises ValueError if the place is not finite, or beyond FARTHEST_M."""

    model: FrameModel
    place_m: tuple[float, float, float]  # place of the camera
    t_ns: int  # exposure
    reset_counter: int = 0  # of the position estimate
    estimate: tuple[int, ...] = ()  # numbers that change when position or heading jump without that counter

    def __post_init__(self) -> None:
        if not all(abs(c) <= FARTHEST_M for c in self.place_m):
            raise ValueError(
                f"world: the place of the camera at {self.t_ns} ns is {self.place_m}: expected numbers within "
                f"{FARTHEST_M:g} m; is the autopilot's position right?"
            )


@dataclass(slots=True)
class WorldCounts:
    """Counts of a world."""

    frames: int = 0  # frames added
    blind: int = 0  # invalid frames
    # frames of an earlier estimate that arrived after the first one of the present section, and frames far before the
    # newest one
    late: int = 0
    bad_planes: int = 0  # planes that are not finite, or without a length
    sections: int = 0  # sections begun
    sections_dropped: int = 0  # sections removed
    why: dict[str, int] = field(default_factory=dict)  # reasons for new sections, and their number


class World:
    """Merges frames into one world. The same frames in the same order give the same world, bit for bit."""

    def __init__(self, params: WorldParams | None = None, first_section: int = 1) -> None:
        """first_section: number of the first section, 1 or more."""
        self.params, self._first_section = params or WorldParams(), first_section
        self._rules = rules_of(self.params)
        self.section: Section | None = None
        self.past: deque[SavedSection] = deque()
        self.counts = WorldCounts()
        self._epoch_ns = round(0.5 * self.params.free_age_s * NS)
        self._back_since_ns: int | None = None  # first stamp of the frames in a row that lie far before the newest one

    def add(self, observation: Observation) -> None:
        """Adds one frame. An invalid frame changes only the counts."""
        self.counts.frames += 1
        if not observation.model.valid:
            self.counts.blind += 1
            return
        if self._is_late(observation):
            self.counts.late += 1
            return
        section = self._section_for(observation)
        tables, free = section.tables, section.free
        tables.state["frame"] += 1
        free.state["frame"] += 1
        # frames of several cameras may be out of order; an epoch never decreases
        free.state["epoch"] = max(int(free.state["epoch"][0]), observation.t_ns // self._epoch_ns)
        observations = observations_of(observation.model, observation.place_m, self.params)
        self.counts.bad_planes += len(observation.model.planes) - len(observations)
        arrived = arrived_in_free(free, observations)
        view = free_view(observation.model, observation.place_m)
        ground = _ground_ranges(observation.model.ground, view)
        if view.far_m.size:
            see_free(free, view)
        if ground is not None:
            see_ground(free, view, *ground)
        later = [f.observations for f in section.recent if f.t_ns > observation.t_ns]
        newer = np.concatenate(later) if later else observations[:0]
        add_frame(tables, free, observations, arrived, newer, self._rules, observation.t_ns, view)
        self._see_later_again(section, RecentFrame(observation.t_ns, observations, arrived, view, ground))
        if observation.t_ns >= section.newest_ns:  # a late frame's place is an earlier one
            section.newest_ns, section.place_m = observation.t_ns, observation.place_m

    @staticmethod
    def _see_later_again(section: Section, frame: RecentFrame) -> None:
        """Repeats for frames that were exposed after this one and added before it: they take from the free space what
        they took, and their ground replaces that of this frame."""
        for later in sorted(section.recent, key=lambda f: f.t_ns):
            if later.t_ns > frame.t_ns:
                remove_free(section.free, later.observations, later.arrived, later.view.x_m, later.view.y_m)
                if later.ground is not None:
                    see_ground(section.free, later.view, *later.ground)
        oldest_ns = max(section.newest_ns, frame.t_ns) - round(RESTART_S * NS)
        section.recent = [f for f in (*section.recent, frame) if f.t_ns >= oldest_ns]

    def picture(self, now_ns: int) -> WorldSnapshot:
        """Returns the present state. Free space that is too old at now_ns is left out."""
        return self._picture(now_ns, -1)

    def changes(self, now_ns: int, since: int) -> tuple[WorldSnapshot, NDArray[np.int32]]:
        """Returns the changes after frame `since` of this section, and the slots that were emptied since.

        A block is included if its free space changed, but not if it only aged: a complete picture is due at each
        epoch."""
        if self.section is None:
            return WorldSnapshot.empty(), np.zeros(0, np.int32)
        planes = self.section.used_slots
        gone = np.flatnonzero((planes["changed"] > since) & (planes["hits"] == 0)).astype(np.int32)
        return self._picture(now_ns, since), gone

    @property
    def free_blocks(self) -> NDArray[np.int32]:
        """Indices (B, 3) of all blocks of this section's free space."""
        return np.zeros((0, 3), np.int32) if self.section is None else held_blocks(self.section.free)

    @property
    def free_blocks_dropped(self) -> int:
        """Number of blocks of this section that others have replaced."""
        return 0 if self.section is None else int(self.section.free.state["dropped"][0])

    @property
    def frame(self) -> int:
        """Number of frames in this section."""
        return 0 if self.section is None else int(self.section.tables.state["frame"][0])

    def epoch(self, now_ns: int) -> int:
        """Returns the epoch of the free space. At each new epoch the oldest free space becomes unknown."""
        newest_ns = 0 if self.section is None else self.section.newest_ns
        return max(now_ns, newest_ns) // self._epoch_ns

    def _picture(self, now_ns: int, since: int) -> WorldSnapshot:
        if self.section is None:
            return WorldSnapshot.empty()
        table = self.section.used_slots
        slots = np.flatnonzero((table["hits"] > 0) & (table["changed"] > since)).astype(np.int32)
        planes = table[slots]
        blocks, masks, ground = seen_blocks(self.section.free, self.epoch(now_ns), since)
        return WorldSnapshot(
            section=self.section.number,
            slots=slots,
            planes=columns(planes, BOX),
            margin_m=planes["margin_m"],
            flags=planes["plane_flags"].astype(np.uint8),
            hits=planes["hits"],
            seen_ns=planes["seen_ns"],
            blocks=blocks,
            masks=masks,
            ground=ground,
        )

    def saved(self) -> tuple[SavedSection, ...]:
        """Returns all sections, the newest last, for `serialize.bytes_of`."""
        return (*self.past, *([saved_section(self.section)] if self.section is not None else []))

    def load(self, sections: tuple[SavedSection, ...]) -> None:
        """Begins a section with saved planes. Planes of one surface are joined, and no space becomes free.

        The next frame belongs to this section: the caller must have moved the planes into its frame
        (`serialize.moved`).

        Raises:
            ValueError: a plane does not fit in a message; nothing is loaded then."""
        for s in sections:
            for k, cause in fitting(s)[1].items():
                raise ValueError(f"section {s.number}: plane {k} of {len(s.box)} cannot be loaded: {cause}")
        self._begin("begun with saved planes", 0, 0, (0.0, 0.0, 0.0))
        assert self.section is not None
        self.section.vouched, none = True, np.zeros(0, OBSERVATION)
        for k, s in enumerate(sections):
            put_saved(self.section.tables, self.section.free, planes_to_load(s), self._rules, k > 0, none)

    def numbers(self) -> dict[str, int]:
        """Returns counts for the log and the health report."""
        counted = "frames", "blind", "late", "bad_planes", "sections", "sections_dropped"
        found = {name: int(getattr(self.counts, name)) for name in counted}
        if self.section is not None:
            state, free = self.section.tables.state[0], self.section.free.state[0]
            found |= {
                "planes": int(state.live),
                **{name: int(state[name]) for name in ("dropped", "cleared", "joined", "overflow")},
                "free_blocks": int(free.blocks),
                "free_blocks_dropped": int(free.dropped),
            }
        return found

    def _is_late(self, observation: Observation) -> bool:
        """Whether a frame is left out because of its stamp.

        It lies more than RESTART_S before the newest one, and not all frames of the last RESTART_S do: its stamp is wrong,
        or it was read late. Or it is of another estimate and was exposed before the section began: one camera's frame from
        before a jump that arrives after another camera's from after it. Its coordinates are not those of the section."""
        section, restart_ns = self.section, round(RESTART_S * NS)
        if section is None or section.vouched:
            return False
        if section.newest_ns - observation.t_ns > restart_ns:
            first_ns = min(observation.t_ns, observation.t_ns if self._back_since_ns is None else self._back_since_ns)
            self._back_since_ns = first_ns
            if observation.t_ns - first_ns < restart_ns:
                return True
        self._back_since_ns = None
        before_s = (section.begun_ns - observation.t_ns) / NS
        other = (observation.reset_counter, observation.estimate) != (section.reset_counter, section.estimate)
        return other and 0.0 < before_s <= RESTART_S

    def _section_for(self, observation: Observation) -> Section:
        section = self.section
        if section is not None and section.vouched:
            section.vouched = False
            section.begun_ns, section.newest_ns = observation.t_ns, observation.t_ns
            section.reset_counter, section.place_m = observation.reset_counter, observation.place_m
            section.estimate = observation.estimate
            section.used_slots["seen_ns"] += observation.t_ns
            return section
        why = "first" if section is None else self._jump(section, observation)
        if section is not None and not why:
            return section
        del section  # else its tables would be kept until the new ones are made
        begun = self._begin(why, observation.t_ns, observation.reset_counter, observation.place_m)
        begun.estimate = observation.estimate
        return begun

    def _begin(self, why: str, t_ns: int, reset_counter: int, place_m: tuple[float, float, float]) -> Section:
        """Begins a section. Of the one before the planes are kept; its tables are released before new ones are made."""
        if self.section is not None:
            self.past.append(saved_section(self.section))
            self.section = None
            while len(self.past) > self.params.most_sections:
                self.past.popleft()
                self.counts.sections_dropped += 1
        self.counts.sections += 1
        self.counts.why[why] = self.counts.why.get(why, 0) + 1
        self.section = Section(
            number=self._first_section + self.counts.sections - 1,
            tables=empty_tables(self.params.most_planes, self.params.longest_m),
            free=empty_free(self.params.most_free_blocks),
            begun_ns=t_ns,
            reset_counter=reset_counter,
            newest_ns=t_ns,
            place_m=place_m,
        )
        return self.section

    def _jump(self, section: Section, observation: Observation) -> str:
        """Returns why a frame cannot belong to the section, as text; empty: it can."""
        p, dt_s = self.params, (observation.t_ns - section.newest_ns) / NS
        if observation.reset_counter != section.reset_counter:
            return "the estimate of the position was reset"
        if observation.estimate != section.estimate:
            return "the estimate of position or heading jumped"
        if dt_s < -RESTART_S:
            return "the clock went back"
        if dt_s > _GAP_S:
            return "there was no position for too long"
        if math.dist(observation.place_m, section.place_m) > p.jump_m + p.jump_speed_m_s * abs(dt_s):
            return "the position stepped"
        return ""


def _ground_ranges(ground: Ground, view: FreeView) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Returns the ranges, (D,) m, from and to which a frame measured the ground; None: none that are usable."""
    fits = view.far_m.size and len(ground.seen_from_m) == len(ground.seen_to_m) == len(view.edges_rad) - 1
    if not (ground.seen and fits and np.isfinite([*ground.seen_from_m, *ground.seen_to_m]).all()):
        return None
    return np.array(ground.seen_from_m), np.array(ground.seen_to_m)
