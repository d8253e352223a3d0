"""The application around the core: configuration, synchronisation, pipeline, logs and commands."""

import sys
from contextlib import suppress

try:
    from .kernels.jit_cache import use_own_cache

    with suppress(ModuleNotFoundError):  # without numba; `companion.cli` reports it when a command needs it
        use_own_cache()  # must run before any module imports numba
except KeyboardInterrupt:  # no function of a command runs yet that could handle it
    sys.exit(130)
