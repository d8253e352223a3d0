"""The wheels hold everything that an installation without the checkout needs."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from companion.kernels.jit_cache import SHARED

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[1]
BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_wheel(sys.argv[1]))"
PACKAGES = ("core", "drivers", "companion")


def wheel(source: Path, output: Path) -> list[str]:
    """The names of the files in the wheel of a source tree."""
    done = subprocess.run(
        [sys.executable, "-c", BUILD, str(output)], cwd=source, capture_output=True, text=True, check=True
    )
    return zipfile.ZipFile(output / done.stdout.strip().splitlines()[-1]).namelist()


def test_the_service_s_wheel_is_complete(tmp_path: Path) -> None:
    source = tmp_path / "source"
    for part in (*PACKAGES, "systemd", "configs", "docs"):
        shutil.copytree(ROOT / part, source / part, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy2(ROOT / name, source / name)
    held = wheel(source, tmp_path)
    files = [f for part in PACKAGES for f in (ROOT / part).rglob("*") if f.is_file() and "__pycache__" not in f.parts]
    assert {str(f.relative_to(ROOT)) for f in files} - set(held) == set()
    shared = {name.partition("/data/share/osape-companion/")[2] for name in held if "/data/" in name}
    for folder, pattern in (
        ("configs", "*.toml"),
        ("systemd", "*"),
        ("docs/how-to", "*.md"),
        ("docs/reference", "*.md"),
    ):
        assert {str(f.relative_to(ROOT)) for f in (ROOT / folder).glob(pattern)} - shared == set()
    assert any(name.endswith("LICENSE.three") for name in held)


def test_the_client_s_wheel_is_complete(tmp_path: Path) -> None:
    source = shutil.copytree(
        ROOT / "clients" / "python",
        tmp_path / "source",
        ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build"),
    )
    held = wheel(source, tmp_path)
    files = list((source / "osape_client").rglob("*.py*"))
    assert {str(f.relative_to(source)) for f in files} - set(held) == set()


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
