"""The sessions of the first hour: what counts as expected, and that their commands exist."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.first_hour.personas import PERSONAS
from benchmarks.first_hour.steps import Session, Step
from companion.command_list import COMMANDS

pytestmark = pytest.mark.process


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    session = Session(tmp_path, dict(os.environ))
    yield session
    session.close()


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        (Step("echo one two", shows=("one t",)), ""),
        (Step("echo one", shows=("two",)), "the output lacks two"),
        (Step("exit 3", status=3), ""),
        (Step("exit 3"), "exit status 3, expected 0"),
        (Step("echo 'Traceback (most recent call last):' >&2"), "the output contains a traceback"),
    ],
)
def test_what_differs_is_named(session: Session, step: Step, problem: str) -> None:
    done = session.run(step)
    assert done is not None
    assert done.problem == problem


def test_a_background_command_ends_with_ctrl_c(session: Session) -> None:
    command = "sleep 60"
    assert session.run(Step(command, starts=True)) is None
    process, _, _ = session._running[command]
    name = Path(f"/proc/{process.pid}/comm")
    while name.read_text() != "sleep\n":  # the shell that starts it may lose a signal
        time.sleep(0.01)
    done = session.run(Step(stop=command, status=-2))
    assert done is not None
    assert done.problem == ""


def test_what_still_runs_is_stopped_at_the_end(session: Session) -> None:
    session.run(Step("sleep 60", starts=True))
    process = session._running["sleep 60"][0]
    session.close()
    assert process.returncode is not None


def test_each_command_exists() -> None:
    texts = [step.text for persona in PERSONAS for step in persona.steps]
    named = {name for text in texts for name in re.findall(r"companion ([a-z][a-z0-9-]*)", text)}
    assert named <= COMMANDS.keys()
    assert len(named) > 8


def test_each_background_command_that_is_stopped_was_started() -> None:
    for persona in PERSONAS:
        started = {step.text for step in persona.steps if step.starts}
        assert {step.stop for step in persona.steps if step.stop} <= started, persona.name
