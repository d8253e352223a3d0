"""Kernels are compiled for a level of processors, shipped with an installation, and never run on a processor below it."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

import companion.kernels.processor as processor_module
import companion.kernels.warmup as warmup
from companion.cli import main
from companion.kernels.jit_cache import VARIABLE
from companion.kernels.manifest import add_groups
from companion.kernels.module_folder import kernels_in
from companion.kernels.processor import CPU_NAME, level_variables, levels, own_levels

from ..small_core import RUN, python, sources

V2 = "fpu sse sse2 cx16 lahf_lm pni popcnt sse4_1 sse4_2 ssse3"
V3 = f"{V2} abm avx avx2 bmi1 bmi2 f16c fma movbe xsave"
PI_4, PI_5 = 0x8FB, 0x119FFB
"""HWCAP of `qemu-aarch64 -cpu cortex-a72` and `cortex-a76` 7.2, the processors of a Raspberry Pi 4 and 5."""


def cpuinfo(flags: str) -> str:
    return f"processor\t: 0\nmodel name\t: some processor\nflags\t\t: {flags}\nbugs\t\t: avx2 fma\n\nprocessor\t: 1\n"


@pytest.mark.parametrize(
    ("machine", "flags", "hwcap", "expected"),
    [
        ("x86_64", f"{V3} avx512f avx512bw avx512cd avx512dq avx512vl", 0, ("x86-64-v3", "x86-64-v2")),
        ("x86_64", V3, 0, ("x86-64-v3", "x86-64-v2")),
        ("x86_64", V3.replace(" fma ", " "), 0, ("x86-64-v2",)),
        ("x86_64", f"{V2} avx xsave", 0, ("x86-64-v2",)),
        ("x86_64", V2.replace("popcnt", ""), PI_5, ()),
        ("x86_64", "", 0, ()),
        ("aarch64", "", PI_5, ("cortex-a76", "generic")),
        ("aarch64", V3, PI_5, ("cortex-a76", "generic")),  # emulated: /proc/cpuinfo is that of the host
        ("aarch64", V3, PI_4, ("generic",)),
        ("aarch64", V3, 0, ()),
        ("riscv64", "", 0, ()),
    ],
)
def test_a_processor_has_the_levels_whose_instructions_it_has(
    machine: str,
    flags: str,
    hwcap: int,
    expected: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(processor_module.os, "uname", lambda: SimpleNamespace(machine=machine))
    auxv = struct.pack("=6Q", 6, 4096, 16, hwcap, 0, 0)
    for name, content in (("CPUINFO", cpuinfo(flags).encode()), ("AUXV", auxv)):
        (tmp_path / name).write_bytes(content)
        monkeypatch.setattr(processor_module, name, tmp_path / name)
    assert own_levels() == expected


def test_the_compiler_knows_the_levels() -> None:
    """LLVM prints an unknown processor's name on stderr and compiles for the oldest one."""
    code = """
import sys
from llvmlite import binding
binding.initialize_all_targets()
triples = {"x86_64": "x86_64-unknown-linux-gnu", "aarch64": "aarch64-unknown-linux-gnu"}
for word in sys.argv[1:]:
    machine, level = word.split(":")
    binding.Target.from_triple(triples[machine]).create_target_machine(cpu=level)
"""

    def complaints(words: list[str]) -> str:
        done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
        return done.stderr

    machines = ("x86_64", "aarch64")
    assert complaints([f"{machine}:{level}" for machine in machines for level in levels(machine)]) == ""
    unknown = complaints([f"{machine}:no-{machine}" for machine in machines])
    assert all(f"'no-{machine}' is not a recognized" in unknown for machine in machines)


# ---- processes: which kernels are compiled, and which are loaded ---------------------------------------------------

needs_v3 = pytest.mark.skipif("x86-64-v3" not in own_levels(), reason="kernels for x86-64-v3 are run")

START = """
import os
import companion.kernels.jit_cache as jit_cache
import companion.kernels.processor as processor
from pathlib import Path
if {own_level}:
    os.environ.pop(processor.CPU_NAME)
    os.environ.pop(processor.CPU_FEATURES)
jit_cache.ROOT = Path({root!r})
jit_cache.SHARED = Path({shared!r})
processor.CPUINFO = Path({cpuinfo!r})
assert jit_cache.use_own_cache() is not None
"""
OUTCOME = """
import numba
print(numba.config.CPU_NAME, sum(outer.stats.cache_hits.values()), sum(outer.stats.cache_misses.values()))
"""


@dataclass(frozen=True, slots=True)
class Installation:
    """A small core, whose kernels may be in `shared`."""

    folder: Path

    @property
    def shared(self) -> Path:
        return self.folder / "shared"

    def start(self, flags: str, cache: str, **variables: str) -> str:
        """Runs the small core on a processor with these flags: numba's processor, kernels loaded and compiled."""
        (self.folder / "cpuinfo").write_text(cpuinfo(flags))
        values = {"root": str(sources(self.folder / "project", factor=2)), "shared": str(self.shared)}
        start = START.format(own_level=not variables, cpuinfo=str(self.folder / "cpuinfo"), **values)
        printed = python(start + RUN.format(**values) + OUTCOME, self.folder / cache, **variables)
        result, _, outcome = printed.partition("\n")
        assert result == "21"
        return outcome

    def ship(self, flags: str, **variables: str) -> None:
        """Puts the kernels of a processor into `shared`, as complete."""
        self.start(flags, "shared", **variables)
        for state in self.shared.iterdir():
            if kernels_in(state):
                add_groups(state, ["extractor"])


@pytest.fixture
def installation(tmp_path: Path) -> Installation:
    return Installation(tmp_path)


@pytest.fixture(scope="module")
def shipped_once(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """With the kernels of two levels, those of V3 alone in `shared-v3`. Tests use copies."""
    shipped = Installation(tmp_path_factory.mktemp("installation"))
    shipped.ship(V3)
    shutil.copytree(shipped.shared, shipped.folder / "shared-v3")
    shipped.ship(V2)
    return shipped


@pytest.fixture
def shipped(shipped_once: Installation, installation: Installation) -> Installation:
    """An installation with the kernels of two levels."""
    shutil.copytree(shipped_once.shared, installation.shared)
    return installation


@pytest.mark.process
@needs_v3
def test_an_empty_cache_starts_with_the_shipped_kernels_of_the_level(shipped: Installation) -> None:
    assert shipped.start(V3, "of v3") == "x86-64-v3 1 0"
    assert shipped.start(V2, "of v2") == "x86-64-v2 1 0"
    every, own = (set(shipped.folder.joinpath(name).rglob("*.nbc")) for name in ("shared", "of v3"))
    assert len(own) == len(every) / 2  # no kernel of another level is copied


@pytest.mark.process
@needs_v3
def test_shipped_kernels_of_another_level_are_not_used(shipped_once: Installation, installation: Installation) -> None:
    shutil.copytree(shipped_once.folder / "shared-v3", installation.shared)
    assert installation.start(V2, "own") == "x86-64-v2 0 1"
    assert installation.start(V3, "own") == "x86-64-v3 1 0"  # one directory may serve several computers
    assert installation.start(V2, "own") == "x86-64-v2 1 0"


@pytest.mark.process
@needs_v3
def test_a_processor_below_all_levels_compiles_for_itself(shipped: Installation) -> None:
    assert shipped.start("fpu sse sse2", "own") == "None 0 1"
    assert shipped.start("fpu sse sse2 popcnt", "own") == "None 0 1"  # a disk that was moved to another computer
    assert shipped.start("fpu sse sse2", "own") == "None 1 0"


@pytest.mark.process
def test_the_processor_that_the_user_names_is_kept(installation: Installation) -> None:
    installation.ship(V3, NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="")
    assert installation.start(V3, "own", NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == "generic 1 0"


BITS = """
import os
if {native}:
    os.environ.pop("NUMBA_CPU_NAME", None), os.environ.pop("NUMBA_CPU_FEATURES", None)
import numba
import numpy as np
from core.self_check.depth_registration import halve, reduce_depth
from core.stages.line_fit import incidence_cosine, misfit
rng = np.random.default_rng(3)
grid, half = np.empty((60, 80)), np.empty((30, 40))
reduce_depth(rng.integers(2000, 9000, (120, 160)).astype(np.uint16), 2, 300, 20000, grid)
halve(grid, half)
values = [misfit(*row) for row in rng.random((1000, 8))] + [incidence_cosine(*row) for row in rng.random((1000, 4))]
print(numba.config.CPU_NAME, b"".join(value.tobytes() for value in (grid, half, np.array(values))).hex())
"""


@pytest.mark.process
@needs_v3
def test_results_are_the_same_bits_at_each_level(tmp_path: Path) -> None:
    """A product and a sum in one instruction (FMA, not in x86-64-v2) would round once instead of twice."""
    printed = {
        name: python(BITS.format(native=not variables), tmp_path, **variables)
        for name, variables in (*((level, level_variables(level)) for level in own_levels()), ("native", {}))
    }
    processors, bits = zip(*(line.split() for line in printed.values()), strict=True)
    assert processors == (*own_levels(), "None")
    assert len(set(bits)) == 1
    assert len(bits[0]) > 10_000


@pytest.mark.process
def test_warmup_for_each_level_starts_a_process_with_its_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    code = """
import os, sys
print(sys.argv[1:], *(os.environ[name] for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_CACHE_DIR")))
"""
    monkeypatch.setattr(warmup, "LEVEL_CHILD", code)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kernels-0123456789abcdef"))
    monkeypatch.setenv(CPU_NAME, "generic")
    monkeypatch.setattr(warmup, "own_levels", lambda: levels()[1:])
    assert main(["warmup", "--levels", "--json"]) == 0
    printed = capfd.readouterr()
    assert printed.out == f"['--json'] {levels()[1]}  {tmp_path}\n"
    assert f"no kernels for {levels()[0]}" in printed.err


@pytest.mark.process
def test_warmup_for_each_level_fails_with_the_process_of_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warmup, "LEVEL_CHILD", "raise SystemExit(1)")
    assert main(["warmup", "--levels"]) == 1
    monkeypatch.setattr(warmup, "own_levels", tuple)
    assert main(["warmup", "--levels"]) == 1
    assert "no level in common" in capsys.readouterr().err
