"""A thread that stores the exception that ended it."""

from __future__ import annotations

import threading
from collections.abc import Callable


class WatchedThread(threading.Thread):
    """A daemon thread. failure: the exception that ended it, as text; empty: none. The traceback goes to the journal."""

    def __init__(self, target: Callable[..., object], name: str, args: tuple[object, ...] = ()) -> None:
        super().__init__(target=target, name=name, args=args, daemon=True)
        self.failure = ""

    def run(self) -> None:
        try:
            super().run()
        except BaseException as error:
            self.failure = f"{type(error).__name__}: {error}"
            raise
