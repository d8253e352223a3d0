"""The pages of the guard hold what the code does: states, transitions, texts and times."""

from __future__ import annotations

import ast
import inspect
import random
import re
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import companion.guard.guard
from companion.guard import (
    assessment,
    attempt,
    availability,
    certainty,
    hold_motion,
    machine,
    memory_file,
    speed_limit,
    velocity_hold,
)
from companion.guard.machine import GuardMachine
from companion.guard.states import GuardMemory, GuardState
from drivers.mavlink.commands import DO_CHANGE_SPEED, DO_SET_MODE

from ..guard_machine import BLIND, BLOCKED, FREE, GUARD, MODES, NARROW, Flight

DOCS = Path(__file__).parents[3] / "docs"
NOTES = (DOCS / "research" / "autopilot-measurements.md").read_text()
HOW_TO = (DOCS / "how-to" / "guard-a-mission.md").read_text()
NS = 1_000_000_000


def table(text: str, heading: str) -> list[list[str]]:
    """The rows of the table with this first column."""
    lines = text[text.index(f"| {heading} |") :].splitlines()
    rows = []
    for line in lines[2:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


@dataclass(slots=True)
class Recorded(GuardMachine):
    """A machine that notes each change of its state, also several in one step."""

    states: list[GuardState] = field(default_factory=list)

    def _change(self, now: Any, **changes: Any) -> None:
        GuardMachine._change(self, now, **changes)
        self.states.append(self.memory.state)

    def _begin(self, state: GuardState, now: Any, **changes: Any) -> None:
        GuardMachine._begin(self, state, now, **changes)
        self.states.append(self.memory.state)


def disturb(f: Flight, chance: random.Random) -> None:
    """Changes one thing of the world around the machine."""
    modes, own = MODES[f.kind], f.machine.memory.stop_modes
    event = chance.choices(range(8), (25, 12, 8, 3, 2, 2, 2, 6))[0]
    if event == 0:
        speeds = [replace(verdict, speed_m_s=v) for verdict in (BLOCKED, FREE) for v in (0.1, 6.0)]
        f.verdict = chance.choice([None, FREE, BLOCKED, NARROW, BLIND, *speeds])
    elif event == 1:
        f.mode = chance.choice(modes[:3] if chance.random() < 0.6 else modes)
    elif event == 2:
        f.mode = chance.choice(own) if own else f.mode
    elif event == 3:
        f.doubt = chance.choice(["", "", "two autopilots"])
    elif event == 4:
        f.armed, f.in_air = chance.random() < 0.7, chance.random() < 0.8
    elif event == 5:
        f.connected = chance.random() < 0.7
    elif event == 6:
        f.system_id = chance.choice([7, 7, 9])
    else:
        f.machine.acknowledged(chance.choice([DO_SET_MODE, DO_CHANGE_SPEED]), chance.choice([0, 0, 4]))


def flown_transitions() -> set[tuple[str, str]]:
    """What the machine does in 100 random flights."""
    chance, found = random.Random(26), set()
    for number in range(100):
        kind = ("ArduPilot", "PX4")[number % 2]
        recorded = Recorded(GUARD)
        f = Flight(kind, MODES[kind][0], recorded)
        for _ in range(40):
            disturb(f, chance)
            f.step(chance.choice([1, 1, 1, 5, 40]))
        found |= {(str(a), str(b)) for a, b in pairwise([GuardState.INACTIVE, *recorded.states]) if a is not b}
    return found


def test_the_page_names_the_states_and_transitions_of_the_code() -> None:
    diagram = NOTES[NOTES.index("```mermaid") :].split("```")[1]
    drawn = set(re.findall(r"^  (\w+) --> (\w+): .+$", diagram, re.MULTILINE))
    assert drawn == flown_transitions()
    assert {state for pair in drawn for state in pair} == {str(state) for state in GuardState}


def announced(module: Any) -> set[str]:
    """The texts of a module's announcements; what differs in each is `...`."""
    out = set()
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Announcement"):
            continue
        out.add(plain(node.args[0]))
    out |= set(re.findall(r'"(guard: vehicle [^"]+)"', inspect.getsource(module)))
    failures = re.findall(r'_failure\("([^"]+)"\)', inspect.getsource(module))
    return {text for text in out | set(failures) if text != "..."}


def plain(text: ast.expr) -> str:
    if isinstance(text, ast.Constant):
        return str(text.value)
    if isinstance(text, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "..." for part in text.values)
    return "..."


def test_the_guide_explains_each_text() -> None:
    in_code = announced(machine) | announced(availability) | announced(companion.guard.guard)
    explained = {text for row in table(HOW_TO, "text") for text in re.findall("`([^`]+)`", row[0])}
    assert explained == in_code


TIMES = {
    "a stop command without COMMAND_ACK is repeated": attempt.ACK_NS,
    "an acknowledged one without the stop mode is repeated": attempt.MODE_NS,
    "a heartbeat shows the effect of an attempt": attempt.SETTLE_NS,
    "a stop without effect ends when the path is free for": machine.FREE_NS,
    "longer than the computed braking time, until the next command": machine.SPARE_STOP_NS,
    "an unconfirmed stop is judged again after a gap of": machine.GAP_NS,
    "unseen space stops again when the path was seen for": machine.REARM_NS,
    "doubt is announced after": availability.DOUBT_NS,
    "a vehicle in a stop mode flies again after": hold_motion.RISE_NS,
    "a speed limit without effect is noticed after": speed_limit.EXCESS_NS,
    "oldest heartbeat": certainty.LONGEST_HEARTBEAT_NS,
    "oldest COMMAND_ACK": certainty.REACHED_NS,
    "oldest velocity that is a speed": assessment.LONGEST_UNMEASURED_NS,
    "oldest velocity": velocity_hold.HOLD_NS,
    "oldest decision of the obstacle output": assessment.STALE_NS,
    "oldest state of an earlier run": memory_file.LIFE_NS,
}


def test_the_notes_name_the_times_of_the_code() -> None:
    assert {row[0]: row[1] for row in table(NOTES, "time")} == {what: f"{ns / NS:g} s" for what, ns in TIMES.items()}


def test_the_notes_name_what_survives() -> None:
    """Each field of the memory that the machine starts from again."""
    kept = NOTES.partition("### What the guard keeps over a restart")[2].partition("\n## ")[0]
    named = set(re.findall(r"`(\w+)`", kept))
    assert set(GuardMemory.__dataclass_fields__) <= named
