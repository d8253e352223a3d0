"""The recipes of the Debian package and of the container. What the wheels hold: tests/client/test_distribution.py."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from companion.kernels.jit_cache import SHARED

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("core", "drivers", "companion")


@pytest.mark.parametrize("name", ["preinst", "postinst", "prerm", "postrm"])
def test_the_scripts_of_the_debian_package_are_valid(name: str) -> None:
    script = ROOT / "packaging" / "deb" / name
    assert subprocess.run(["sh", "-n", str(script)], check=False).returncode == 0
    assert script.read_text().splitlines()[0] == "#!/bin/sh"


def test_the_container_recipe_copies_what_the_wheel_is_made_of() -> None:
    recipe = (ROOT / "packaging" / "Containerfile").read_text()
    copied = set(re.findall(r"^COPY (\S+)", recipe, re.MULTILINE))
    assert {*PACKAGES, "clients/python", "systemd", "configs", "docs", "requirements.lock"} <= copied


@pytest.mark.parametrize("name", ["build-deb", "Containerfile"])
def test_packages_compile_kernels_where_the_installation_finds_them(name: str) -> None:
    place = f"/opt/osape-companion/{SHARED.relative_to(sys.prefix)}"
    text = (ROOT / "packaging" / name).read_text().replace("\\\n", "")
    assert re.search(rf"NUMBA_CACHE_DIR={place}\s+/opt/osape-companion/bin/companion warmup --levels\n", text)
