"""The commands that the documentation prints are typed as printed, in the order of their page, where they need no device.

Every command line of a code block must be one that the parser accepts. Commands that need a device, a running service or
root run in the tests that TESTED_BY names."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pytest

from companion.cli import main, parser_of
from companion.command_list import COMMANDS

from ...conftest import CHECKOUT
from ...test_docs_links import USER_PAGES, lines_of, name_of
from ..flight_logs import write_ulog
from ..recordings import write_folder
from ..ros2_recording import RosFlight

TESTED_BY: Final = {
    "batch": "test_batch.py",
    "bench": "test_bench.py",
    "demo": "test_demo.py",
    "doctor": "test_doctor.py",
    "find": "test_find.py",
    "install": "test_install.py",
    "keys": "test_publisher.py",
    "recover": "test_log_recover.py",
    "ros2": "test_ros2_bridge.py",
    "run": "test_service_alone.py",
    "setup": "test_setup.py",
    "simulate-autopilot": "test_simulate_autopilot.py",
    "status": "test_status.py",
    "uninstall": "test_install.py",
    "warmup": "test_warmup.py",
}
"""Command -> the test of the service that runs it, since it needs a device, a running service, root or much time."""

TYPED: Final = {"check-config", "configs", "export", "import", "info", "replay", "view"}


@dataclass(frozen=True, slots=True)
class Session:
    """A page whose commands are typed. before: typed first, in place of a command that needs a device; left_out: a line that
    needs more than the material, with the reason."""

    page: str
    before: tuple[str, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)


SESSIONS: Final = (
    Session("README.md"),
    Session("docs/tutorial/first-recording.md"),
    Session("docs/how-to/import-recordings.md"),
    Session(
        "docs/how-to/import-a-ros2-bag.md",
        left_out={
            "companion import bag.mcap -o flight.mcap --depth-topic /camera/depth/image_rect_raw --attitude-topic "
            "/mavros/imu/data --mount=0,-10,0": "an example with the topics of one camera node"
        },
    ),
    Session("docs/how-to/connect-a-camera.md", before=("companion configs oak -o my.toml",)),
    Session("docs/how-to/connect-oak.md"),
    Session("docs/how-to/connect-zed.md"),
    Session("docs/how-to/view-logs.md"),
)


def command_lines(page: Path) -> list[str]:
    """The lines of code blocks that begin with companion, without prompt, path and comment."""
    found = []
    for line, code in lines_of(page):
        match = re.match(r"\s*(?:\$ )?(?:sudo (?:-u \S+ )?)?(?:\S*/)?(companion [a-z-].*)$", line)
        if code and match and "..." not in match[1]:
            found.append(shlex.join(shlex.split(match[1], comments=True)))
    return found


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_command_line_is_accepted_by_the_parser(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused = []
    for line in command_lines(page):
        words = shlex.split(line)[1:]
        try:
            parser_of(words[0]).parse_args(words)
        except SystemExit as end:
            if end.code:
                refused.append(f"{line}: {capsys.readouterr().err}")
    assert refused == []


def test_every_command_is_typed_or_runs_in_a_test() -> None:
    assert TYPED.isdisjoint(TESTED_BY)
    assert TYPED | TESTED_BY.keys() == COMMANDS.keys()
    for command, name in TESTED_BY.items():
        (file,) = (CHECKOUT / "tests" / "companion").rglob(name)
        text = file.read_text(encoding="utf-8")
        assert f'"{command}"' in text or f"{command.replace('-', '_')} import" in text, (command, name)
    typed = {shlex.split(line)[1] for s in SESSIONS for line in command_lines(CHECKOUT / s.page)}
    assert typed >= TYPED


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the pages name: folders of depth images with the autopilot's log, and a ROS 2 bag."""
    folder = tmp_path_factory.mktemp("material")
    for name in ("my-flight", "FOLDER"):
        write_ulog(write_folder(folder / name, 20) / "flight.ulg", 3.0)
    RosFlight(transforms=RosFlight().transforms).write(folder / "bag.mcap")
    assert main(["import", str(folder / "FOLDER"), "-o", str(folder / "flight.mcap")]) == 0
    return folder


@pytest.mark.parametrize("session", SESSIONS, ids=lambda s: s.page)
def test_the_commands_of_a_page_run_as_printed(
    session: Session,
    material: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("pyulog")
    pytest.importorskip("matplotlib")
    # which frames are drawn is the subject of test_view_geometry.py: each page draws one
    monkeypatch.setattr("companion.viewer.view.select_frames", lambda planes, blind: [0])
    for thing in material.iterdir():
        (tmp_path / thing.name).symlink_to(thing)
    monkeypatch.chdir(tmp_path)
    failed = []
    for line in (*session.before, *command_lines(CHECKOUT / session.page)):
        words = shlex.split(line)[1:]
        if words[0] not in TYPED or "--live" in words or line in session.left_out:
            continue
        if words[0] == "import" and Path(words[words.index("-o") + 1]).is_symlink():
            Path(words[words.index("-o") + 1]).unlink()  # the page makes it itself
        if "--rerun" in words:
            pytest.importorskip("rerun")
        status = main(words)
        output = capsys.readouterr()
        if status != 0:
            failed.append(f"{line}: status {status}\n{output.out}{output.err}")
    assert failed == []
