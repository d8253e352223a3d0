"""The service around the core: configuration, time matching, pipeline, logs, commands."""

from .kernels.jit_cache import use_own_cache

use_own_cache()  # before any module can import numba
