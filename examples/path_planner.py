"""Path planning with RRT, RRT-Connect and PRM of OMPL in one frame (osape_client.Space) or in the merged world
(osape_client.WorldSpace); both have the same queries.

Occupied space is never entered. Unknown space is avoided, or allowed at a price. Needs the extra `planner` (ompl).
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osape_client.query.space import Occupancy, Space
from osape_client.world.space import WorldSpace

try:
    from ompl import base, geometric, util
except ImportError as error:
    raise ImportError(f"path planning needs ompl ({error}): run {sys.executable} -m pip install 'ompl>=2.0'") from error

Floats = NDArray[np.float64]
PLANNERS = {"rrt": geometric.RRT, "rrt-connect": geometric.RRTConnect, "prm": geometric.PRM}
BLOCKED = np.inf
SECONDS_OF_A_QUESTION = 0.001


class Unknown(StrEnum):
    """What to do with space that no camera observed."""

    AVOID = "avoid"
    ALLOW = "allow"


class NoPath(Exception):
    """No path exists or none was found; the message says why and what to do."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Room:
    """The space in which a vehicle may fly. All positions are in the frame of `space`.

    space: the model of one frame, in `level` or `ned`, or the merged world, in `ned`. radius_m: of the vehicle, with its
    rotors and the room that the controller needs. unknown_price: a metre through unknown space costs as much as
    1 + unknown_price metres through free space. start: (3,) position of the vehicle; been_m: within this distance of it
    unknown space counts as free, because the vehicle came from there and no camera observes the space close before it.
    Occupied space stays occupied there."""

    space: Space | WorldSpace
    radius_m: float
    start: Floats
    been_m: float = 0.0
    unknown: Unknown = Unknown.AVOID
    unknown_price: float = 4.0

    def price(self, a: ArrayLike, b: ArrayLike) -> Floats:
        """(M,) costs of straight segments from a (M, 3) to b (M, 3): metres, more through unknown space; BLOCKED where a
        segment is not allowed."""
        a, b = np.atleast_2d(np.asarray(a, float)), np.atleast_2d(np.asarray(b, float))
        length = np.linalg.norm(b - a, axis=1)
        price: Floats = length.copy()
        answers = self.space.segments(a, b, self.radius_m)
        price[answers == Occupancy.OCCUPIED] = BLOCKED
        for i in np.flatnonzero(answers == Occupancy.UNKNOWN):
            unseen = self._unseen(a[i], b[i])
            if unseen and self.unknown is Unknown.AVOID:
                price[i] = BLOCKED
            else:
                price[i] += self.unknown_price * sum(float(np.linalg.norm(q - p)) for p, q in unseen)
        return price

    def _unseen(self, a: Floats, b: Floats) -> list[tuple[Floats, Floats]]:
        """The pieces of a segment that are not free, outside of the ball around the start; a point is a segment of length 0."""
        pieces = outside(a, b, self.start, self.been_m)
        if self.unknown is Unknown.ALLOW:  # only the price needs to know how much of it
            pieces = [short for p, q in pieces for short in cut(p, q, 0.5)]
        if not pieces:
            return []
        begin, end = (np.array(ends) for ends in zip(*pieces, strict=True))
        free = self.space.segments(begin, end, self.radius_m) == Occupancy.FREE
        return [piece for piece, seen in zip(pieces, free, strict=True) if not seen]


def outside(a: Floats, b: Floats, centre: Floats, radius_m: float) -> list[tuple[Floats, Floats]]:
    """The pieces of a segment that lie outside of a ball: none, one or two."""
    along, beside = b - a, a - centre
    aa, ab, bb = float(along @ along), float(along @ beside), float(beside @ beside) - radius_m**2
    if aa == 0.0:
        return [] if bb <= 0.0 and radius_m > 0.0 else [(a, b)]
    inner = ab * ab - aa * bb
    if radius_m <= 0.0 or inner <= 0.0:
        return [(a, b)]
    enter, leave = (-ab - math.sqrt(inner)) / aa, (-ab + math.sqrt(inner)) / aa
    pieces = []
    if enter >= 1.0 or leave <= 0.0:
        return [(a, b)]
    if enter > 0.0:
        pieces.append((a, a + enter * along))
    if leave < 1.0:
        pieces.append((a + leave * along, b))
    return pieces


def cut(a: Floats, b: Floats, longest_m: float) -> list[tuple[Floats, Floats]]:
    """A segment in equal pieces, none longer than longest_m."""
    count = max(1, math.ceil(float(np.linalg.norm(b - a)) / longest_m))
    points = a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a)
    return list(pairwise(points))


class _Flyable(base.MotionValidator):
    """Checks each straight piece as a whole; OMPL's default checks points along it."""

    def __init__(self, information: base.SpaceInformation, room: Room) -> None:
        super().__init__(information)
        self.room, self.asked = room, 0

    def checkMotion(self, a: base.State, b: base.State, *_: object) -> bool:
        self.asked += 1
        return bool(self.room.price(point(a), point(b))[0] < BLOCKED)


def point(state: base.State) -> Floats:
    """(3,) position of a state."""
    return np.array([state[0], state[1], state[2]])


def plan(
    room: Room,
    goal: ArrayLike,
    bounds_m: ArrayLike,
    *,
    planner: str = "rrt-connect",
    tries: int = 10,
    questions: int = 1000,
    seed: int = 1,
) -> Floats:
    """(K, 3) corners of a path from room.start to the goal, within bounds (2, 3: least, greatest): the cheapest of several
    tries, shortened and smoothed. Every piece of it is checked again at the end.

    questions: checked pieces of each try, after which it ends without a path. seed: of OMPL's random numbers, 1 or more. The
    same seed gives the same path, except with prm, which ends after a time. Raises NoPath."""
    goal = np.asarray(goal, float)
    for name, place in (("start", room.start), ("goal", goal)):
        if not room.price(place, place)[0] < BLOCKED:
            answer = Occupancy(int(room.space.points(place, room.radius_m)[0])).name.lower()
            raise NoPath(
                f"the {name} {np.round(place, 2).tolist()} is {answer} for a radius of {room.radius_m:g} m: choose another"
            )
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(
        seed
    )  # OMPL reports an error where numbers were drawn before; all generators of a try are made after this
    util.setLogLevel(util.LogLevel.LOG_ERROR)
    best, least = None, BLOCKED
    for _ in range(tries):
        path = _one(room, goal, np.asarray(bounds_m, float), planner, questions)
        if path is not None and (price := float(room.price(path[:-1], path[1:]).sum())) < least:
            best, least = path, price
    if best is None:
        raise NoPath(
            f"{planner}: no path to {np.round(goal, 2).tolist()} in {tries} tries of {questions} checks: observed space has none, or "
            "it is narrow; take more tries or another seed, observe from elsewhere, or allow unknown space"
        )
    return best


def _one(room: Room, goal: Floats, bounds_m: Floats, planner: str, questions: int) -> Floats | None:
    space = base.RealVectorStateSpace(3)
    bounds = base.RealVectorBounds(3)
    for axis in range(3):
        bounds.setLow(axis, float(bounds_m[0, axis]))
        bounds.setHigh(axis, float(bounds_m[1, axis]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    ways = _Flyable(information, room)
    information.setMotionValidator(ways)
    # fast, and sufficient: the check of the pieces decides about unknown space
    occupied = Occupancy.OCCUPIED
    setup.setStateValidityChecker(lambda state: bool(room.space.points(point(state), room.radius_m)[0] != occupied))
    begin, end = space.allocState(), space.allocState()
    for axis in range(3):
        begin[axis], end[axis] = float(room.start[axis]), float(goal[axis])
    setup.setStartAndGoalStates(begin, end)
    setup.setPlanner(PLANNERS[planner](information))
    if planner == "prm":  # its second thread evaluates the condition too, and would wait for ever for a Python function
        setup.solve(questions * SECONDS_OF_A_QUESTION)
    else:
        setup.solve(base.PlannerTerminationCondition(lambda: ways.asked > questions))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    simplify = geometric.PathSimplifier(information)
    simplify.reduceVertices(path, 100, 100)
    simplify.partialShortcutPath(path, 100, 100)
    simplify.smoothBSpline(path, 3)
    return np.array([point(state) for state in path.getStates()])
