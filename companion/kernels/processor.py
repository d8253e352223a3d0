"""The processor for which numba compiles."""

from __future__ import annotations

import os


def processor() -> str:
    """Name and features, as in numba's own key of a cached kernel: kernels of another processor are not used."""
    from llvmlite import binding

    name = os.environ.get("NUMBA_CPU_NAME") or binding.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    return f"{name} {binding.get_host_cpu_features().flatten() if features is None else features}"
