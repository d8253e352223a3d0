"""The systemd unit and the udev rules that `companion install` writes."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from companion.packaged import packaged_file

MOST_EXPOSURE = 2.5
NEEDS_ANALYZE = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze not there: no systemd on this machine"
)


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The unit as it is installed, with a command that every machine has."""
    text = packaged_file("systemd", "osape-companion.service").read_text()
    file = tmp_path / "osape-companion.service"
    file.write_text(text.replace("@COMPANION@", "/bin/true").replace("@DOCS@", "/etc/hostname"))
    return file


@NEEDS_ANALYZE
def test_the_unit_is_clean(unit: Path) -> None:
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False)
    words = [line for line in done.stderr.splitlines() if unit.name in line]  # other units have their own defects
    assert words == []
    assert done.returncode == 0


@NEEDS_ANALYZE
def test_the_unit_exposes_little(unit: Path) -> None:
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", str(unit)], capture_output=True, text=True, check=False
    )
    found = re.search(r"Overall exposure level for \S+: (\d+\.\d+)", done.stdout)
    assert found is not None, done.stderr
    assert float(found[1]) <= MOST_EXPOSURE


def test_the_unit_never_gives_up_and_is_watched(unit: Path) -> None:
    lines = unit.read_text().splitlines()
    for line in ("Type=notify", "Restart=always", "StartLimitIntervalSec=0", "WatchdogSec=2s", "User=osape-companion"):
        assert line in lines


RULE = re.compile(r'^[A-Z_]+(\{[\w./]+\})?\s*(==|!=|\+=|=)\s*"[^"]*"$')


def test_each_rule_is_one_that_udev_can_read() -> None:
    rules = packaged_file("systemd", "60-osape-companion.rules").read_text().splitlines()
    lines_of = [line for line in rules if line and not line.startswith("#")]
    for line in lines_of:
        for part in re.split(r",\s*(?=[A-Z])", line):
            assert RULE.match(part), part
    devices = [line for line in lines_of if 'GROUP="osape-companion"' in line]
    assert {v for line in devices for v in re.findall(r'idVendor\}=="(\w+)"', line)} == {"03e7", "2b03"}
