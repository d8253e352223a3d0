"""The application around the core: configuration, synchronisation, pipeline, logs and commands."""

import os
import signal
import sys
from contextlib import suppress
from types import FrameType


def _is_command() -> bool:
    """Whether this process is the command `companion`, not a program that imports this package."""
    program = os.path.basename(sys.argv[0]) if getattr(sys, "argv", None) else ""
    if program == "-m":  # the module is not located yet
        return "-m" in sys.orig_argv and sys.orig_argv[sys.orig_argv.index("-m") + 1] == "companion"
    return program == "companion"


_IS_COMMAND = _is_command()  # of -m, Python replaces the name of the program later


def _end(number: int, frame: FrameType | None) -> None:
    os._exit(130)


def end_at_interrupt() -> None:
    """From now on Ctrl-C ends the command at once, with status 130 and without a message: nothing of it has begun. A program that imports
    this package keeps its own handler.

    The KeyboardInterrupt would be lost where it arrives in an import that catches everything, and the command would run on."""
    # a shell lets its background jobs ignore it
    if _IS_COMMAND and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        with suppress(ValueError):  # not in the main thread, which alone gets signals
            signal.signal(signal.SIGINT, _end)


def raise_at_interrupt() -> None:
    """Ends the effect of `end_at_interrupt`: Ctrl-C raises KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


end_at_interrupt()
try:
    from .kernels.jit_cache import use_own_cache

    with suppress(ModuleNotFoundError):  # without numba; `companion.cli` reports it when a command needs it
        use_own_cache()  # must run before any module imports numba
except KeyboardInterrupt:  # no function of a command runs yet that could handle it
    if not _IS_COMMAND:
        raise
    sys.exit(130)
