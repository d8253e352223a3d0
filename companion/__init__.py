"""The application around the core: configuration, synchronisation, pipeline, logs and commands."""

from contextlib import suppress

from .kernels.jit_cache import use_own_cache

with suppress(ModuleNotFoundError):  # without numba; `companion.cli` reports it when a command needs it
    use_own_cache()  # must run before any module imports numba
