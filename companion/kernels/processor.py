"""The processor for which numba compiles: a level that many processors have in common.

Kernels of a level run on every processor with its instructions, so that a package or a copied cache can contain them.
numba reads the processor from NUMBA_CPU_NAME and NUMBA_CPU_FEATURES when it is imported. Values that the user has set
are kept; a processor without a level has kernels of its own.

The levels of x86-64 are micro-architecture levels of its psABI. Those of 64-bit ARM are Armv8.2-A as of the Cortex-A76
(Raspberry Pi 5, Jetson Orin) and Armv8.0-A. LLVM knows all of them by these names. A level with AVX-512 would
be 2 % faster where the processor has it (docs/research/speed.md), which is not worth another set of kernels."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Final

CPU_NAME: Final = "NUMBA_CPU_NAME"
CPU_FEATURES: Final = "NUMBA_CPU_FEATURES"
CPUINFO = Path("/proc/cpuinfo")
"""Lists the instructions of an x86-64 processor in lines `flags`."""
AUXV = Path("/proc/self/auxv")
"""What the system passes to each process: pairs of a type and a value. It names the instructions of an ARM processor, of
an emulated one too, in which CPUINFO describes the emulating computer."""
_AT_HWCAP: Final = 16
"""Type of the entry of AUXV with the instructions, one bit each."""
_ARM_HWCAP: Final = {
    0: "fp", 1: "asimd", 3: "aes", 4: "pmull", 5: "sha1", 6: "sha2", 7: "crc32", 8: "atomics", 9: "fphp", 10: "asimdhp",
    12: "asimdrdm", 15: "lrcpc", 16: "dcpop", 20: "asimddp",
}  # fmt: skip
"""Bit -> name of the instructions, on 64-bit ARM."""
_X86_64_V2: Final = frozenset(["cx16", "lahf_lm", "pni", "popcnt", "sse4_1", "sse4_2", "ssse3"])
_X86_64_V3: Final = _X86_64_V2 | frozenset(["abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"])
_ARMV8_0: Final = frozenset(["asimd", "fp"])
_CORTEX_A76: Final = _ARMV8_0 | frozenset(
    ["aes", "asimddp", "asimdhp", "asimdrdm", "atomics", "crc32", "dcpop", "fphp", "lrcpc", "pmull", "sha1", "sha2"]
)
_LEVELS: Final = {
    "x86_64": {"x86-64-v3": _X86_64_V3, "x86-64-v2": _X86_64_V2},
    "aarch64": {"cortex-a76": _CORTEX_A76, "generic": _ARMV8_0},
}
"""By machine the levels, best first, and the names of the instructions that each needs."""


def levels(machine: str | None = None) -> tuple[str, ...]:
    """Returns all levels of an architecture, best first. machine: as `uname -m` prints it; default: this one."""
    return tuple(_LEVELS.get(machine or os.uname().machine, {}))


def own_levels() -> tuple[str, ...]:
    """Returns the levels that this processor can run, best first."""
    found = instructions()
    return tuple(level for level, needed in _LEVELS.get(os.uname().machine, {}).items() if needed <= found)


def instructions() -> set[str]:
    """Returns the names of the instructions of this processor; none for other machines than those with levels."""
    try:
        return _arm_instructions() if os.uname().machine == "aarch64" else _x86_instructions()
    except OSError:
        return set()


def _x86_instructions() -> set[str]:
    lines = (line.partition(":") for line in CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines())
    return next((set(value.split()) for name, _, value in lines if name.strip() == "flags"), set())


def _arm_instructions() -> set[str]:
    content = AUXV.read_bytes()
    entries = dict(struct.iter_unpack("=QQ", content[: len(content) // 16 * 16]))
    bits = entries.get(_AT_HWCAP, 0)
    return {name for bit, name in _ARM_HWCAP.items() if bits >> bit & 1}


def level_variables(level: str) -> dict[str, str]:
    """Returns the environment variables with which numba compiles for a level."""
    return {CPU_NAME: level, CPU_FEATURES: ""}  # empty: no features besides those of the level


def use_level() -> None:
    """Sets numba's variables to the best level of this processor, unless the user has set one of them."""
    if not {CPU_NAME, CPU_FEATURES} & os.environ.keys() and (own := own_levels()):
        os.environ.update(level_variables(own[0]))
