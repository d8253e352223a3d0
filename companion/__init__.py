"""The application around the core: configuration, synchronisation, pipeline, logs and commands."""

from .kernels.jit_cache import use_own_cache

use_own_cache()  # must run before any module imports numba
