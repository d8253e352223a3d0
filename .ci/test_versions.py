"""Tests the supported versions of Python, each with the lowest and the highest allowed packages: `make test-versions`.

    python .ci/test_versions.py [--folder FOLDER] [--only 3.12] [--only lowest] [-- PYTEST ARGUMENTS]

For each version an environment is made in FOLDER (default: build/versions), once with the lowest and once with the highest
versions that pyproject.toml allows for numba and the other dependencies. In each, all modules are imported, one frame is
extracted, and the golden recordings are compared. The kernels are compiled in each environment, which takes some minutes.

Interpreters are taken from the PATH, from pyenv, or from uv, which downloads them where the network allows it. An
interpreter that cannot be had is reported as skipped. Status 0: all environments passed or were skipped; 1: one failed; 3: no
package index can be reached.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
RESOLUTIONS = {"lowest": "lowest-direct", "highest": "highest"}
"""Name -> strategy of `uv pip install`. lowest-direct: the lowest allowed versions of the dependencies that pyproject.toml
names; the resolver takes the lowest one that has a wheel for the interpreter."""
TOOLS = ("pytest>=8", "hypothesis>=6.100", "setuptools>=77")
EXAMPLE = "examples/planes_from_depth.py"
"""Extracts one frame and prints its planes."""
SUBSET = ("tests/test_golden.py",)
IMPORT_ALL = """
import importlib, pkgutil, sys
optional = {"depthai", "linuxpy", "matplotlib", "foxglove", "ompl"}
for package in ("osape_client", "core", "drivers", "companion"):
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        if module.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            if error.name.partition(".")[0] not in optional:
                raise
import numba, numpy
print(f"numba {numba.__version__}, numpy {numpy.__version__}")
"""


@dataclass(frozen=True)
class Outcome:
    """Of one environment. state: "passed", "failed" or "skipped"; detail: the versions, or the cause."""

    version: str
    resolution: str
    state: str
    detail: str


class UnreachableIndexError(Exception):
    """No package index can be reached."""


def installed_uv(folder: Path) -> Path:
    """The resolver, in an environment of its own. Raises UnreachableIndexError."""
    found = shutil.which("uv")
    if found:
        return Path(found)
    home = folder / "uv"
    uv = home / "bin" / "uv"
    if not uv.exists():
        venv.create(home, with_pip=True, clear=True)
        command = [home / "bin" / "python", "-m", "pip", "install", "--quiet", "uv"]
        if subprocess.run(command, check=False).returncode != 0:
            raise UnreachableIndexError("uv cannot be installed: no package index can be reached")
    return uv


def interpreter(version: str, uv: Path) -> Path | None:
    """A working Python of this version; None where there is none and none can be downloaded."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python"), reverse=True)]
    for candidate in candidates:
        if candidate is not None and _is_version(Path(candidate), version):
            return Path(candidate)
    subprocess.run([uv, "python", "install", "--quiet", version], check=False, capture_output=True)
    command = [uv, "python", "find", "--no-project", "--managed-python", version]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    return Path(found.stdout.strip()) if found.returncode == 0 else None


def _is_version(python: Path, version: str) -> bool:
    code = 'import sys, venv; print("%d.%d" % sys.version_info[:2])'
    run = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return run.returncode == 0 and run.stdout.strip() == version


def tested(version: str, resolution: str, folder: Path, uv: Path, arguments: list[str]) -> Outcome:
    """Makes one environment and runs the subset in it."""
    base = interpreter(version, uv)
    if base is None:
        return Outcome(version, resolution, "skipped", f"no Python {version}: install it, or let uv download it")
    home = folder / f"{version}-{resolution}"
    python = home / "bin" / "python"
    subprocess.run([uv, "venv", "--quiet", "--clear", "--python", base, home], check=True)
    install = [uv, "pip", "install", "--quiet", "--python", python]
    # both distributions come from the checkout (editable: nothing is built beside the sources), the rest from the index
    requirements = [
        "--only-binary", ":all:", "--no-binary", "osape-client", "--no-binary", "osape-companion",
        "--resolution", RESOLUTIONS[resolution], "--editable", ROOT, *TOOLS,
    ]  # fmt: skip
    done = subprocess.run([*install, *requirements], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return Outcome(version, resolution, "failed", f"cannot be installed:\n{done.stderr}")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "NUMBA"))}
    environment["NUMBA_CACHE_DIR"] = str(home / "kernels")
    imported = subprocess.run(
        [python, "-c", IMPORT_ALL], capture_output=True, text=True, check=False, env=environment, cwd=folder
    )
    if imported.returncode != 0:
        return Outcome(version, resolution, "failed", f"cannot be imported:\n{imported.stderr}")
    versions = imported.stdout.strip().splitlines()[-1]
    one = subprocess.run(
        [python, EXAMPLE],
        capture_output=True,
        text=True,
        check=False,
        env=environment | {"PYTHONPATH": str(ROOT)},
        cwd=ROOT,
    )
    if one.returncode != 0 or " m up, margin " not in one.stdout:
        return Outcome(version, resolution, "failed", f"{versions}; {EXAMPLE}:\n{one.stdout}{one.stderr}")
    command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(arguments or SUBSET)]
    passed = subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode == 0
    return Outcome(version, resolution, "passed" if passed else "failed", versions)


def main() -> int:
    """The status of the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "versions", help="of the environments")
    parser.add_argument("--only", action="append", default=[], help="a version of Python, lowest or highest")
    parser.add_argument("arguments", nargs="*", help="of pytest, in place of the quick subset")
    args = parser.parse_args()
    folder = args.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        uv = installed_uv(folder)
    except UnreachableIndexError as error:
        print(error, file=sys.stderr)
        return 3
    versions = [v for v in VERSIONS if v in args.only] or VERSIONS
    resolutions = [r for r in RESOLUTIONS if r in args.only] or RESOLUTIONS
    outcomes = []
    for version in versions:
        for resolution in resolutions:
            print(f"== Python {version}, {resolution} versions of the packages", flush=True)
            outcomes.append(tested(version, resolution, folder, uv, args.arguments))
            print(f"{outcomes[-1].state}: {outcomes[-1].detail}", flush=True)
    print("== summary")
    for o in outcomes:
        print(f"Python {o.version}, {o.resolution}: {o.state} ({o.detail.splitlines()[0]})")
    return int(any(o.state == "failed" for o in outcomes))


if __name__ == "__main__":
    sys.exit(main())
