"""The application around the core: configuration, synchronisation, pipeline, logs and commands."""

import os
import sys
from contextlib import suppress


def _is_command() -> bool:
    """Whether this process is the command `companion`, not a program that imports this package."""
    program = os.path.basename(sys.argv[0]) if getattr(sys, "argv", None) else ""
    if program == "-m":  # the module is not located yet
        return "-m" in sys.orig_argv and sys.orig_argv[sys.orig_argv.index("-m") + 1] == "companion"
    return program == "companion"


try:
    from .kernels.jit_cache import use_own_cache

    with suppress(ModuleNotFoundError):  # without numba; `companion.cli` reports it when a command needs it
        use_own_cache()  # must run before any module imports numba
except KeyboardInterrupt:  # no function of a command runs yet that could handle it
    if not _is_command():
        raise
    sys.exit(130)
