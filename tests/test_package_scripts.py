"""The maintainer scripts of the Debian package, run below a root directory of their own."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[1] / "packaging" / "deb"
UNIT = "etc/systemd/system/osape-companion.service"
OWN = (
    "etc/osape-companion/config.toml",
    "var/lib/osape-companion/logs/flight.mcap",
    "opt/osape-companion/lib/left-over",
)
ENVIRONMENT = "opt/osape-companion/pyvenv.cfg"

pytestmark = pytest.mark.process


def ran(script: str, root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs a script whose absolute paths lead below `root`, without commands that change users."""
    text = re.sub(r"(?<![\w.])/(?=(?:etc|var|opt|run)\b)", f"{root}/", (SCRIPTS / script).read_text())
    commands = root / "commands"
    commands.mkdir(exist_ok=True)
    for name in ("userdel", "getent", "systemctl", "systemd-sysusers"):
        (commands / name).write_text(f'#!/bin/sh\necho {name} "$@"\n')
        (commands / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{commands}:{os.environ['PATH']}"}
    return subprocess.run(
        ["sh", "-c", text, script, *arguments], env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A root with what an installation leaves."""
    for name in OWN:
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text("")
    return tmp_path


def test_a_purge_deletes_configuration_logs_and_user(root: Path) -> None:
    done = ran("postrm", root, "purge")
    assert done.returncode == 0, done.stderr
    assert [name for name in OWN if (root / name).exists()] == []
    assert "userdel osape-companion" in done.stdout


def test_a_purge_leaves_an_installation_made_by_hand_alone(root: Path) -> None:
    """`companion install` after `apt remove`: the later purge deleted a service that ran, its configuration and logs."""
    (root / UNIT).parent.mkdir(parents=True)
    (root / UNIT).write_text("")
    done = ran("postrm", root, "purge")
    assert done.returncode == 0, done.stderr
    assert [name for name in OWN if (root / name).exists()] == list(OWN)
    assert "userdel" not in done.stdout
    assert "companion uninstall --purge" in done.stderr


def test_a_purge_leaves_an_environment_made_by_hand_alone(root: Path) -> None:
    """The package's own went with its removal."""
    (root / ENVIRONMENT).write_text("")
    assert ran("postrm", root, "purge").returncode == 0
    assert [name for name in (*OWN, ENVIRONMENT) if (root / name).exists()] == [OWN[-1], ENVIRONMENT]


def test_a_purge_deletes_configuration_and_logs_beside_an_edited_unit_of_the_package(root: Path) -> None:
    """`systemctl edit --full` copies the unit; purge took it for that of `companion install`, and kept keys and logs."""
    (root / UNIT).parent.mkdir(parents=True)
    (root / UNIT).write_text(f"[Service]\nExecStart={root}/opt/osape-companion/bin/companion run\n")
    done = ran("postrm", root, "purge")
    assert done.returncode == 0, done.stderr
    assert [name for name in OWN if (root / name).exists()] == []
    (root / ENVIRONMENT).parent.mkdir(parents=True)
    (root / ENVIRONMENT).write_text("")  # an environment made by hand, whose unit has the same command
    (root / OWN[0]).parent.mkdir(parents=True)
    (root / OWN[0]).write_text("")
    assert ran("postrm", root, "purge").returncode == 0
    assert (root / OWN[0]).exists()


def test_a_removal_keeps_configuration_and_logs(root: Path) -> None:
    assert ran("postrm", root, "remove").returncode == 0
    assert [name for name in OWN if (root / name).exists()] == list(OWN)


@pytest.mark.parametrize("present", [UNIT, ENVIRONMENT])
def test_a_first_installation_is_refused_beside_one_made_by_hand(tmp_path: Path, present: str) -> None:
    (tmp_path / present).parent.mkdir(parents=True)
    (tmp_path / present).write_text("")
    done = ran("preinst", tmp_path, "install")
    assert done.returncode == 1
    assert "companion uninstall" in done.stderr
    assert ran("preinst", tmp_path, "upgrade", "0.1.0").returncode == 0
