"""A thread that remembers why it ended, so that its end can be named."""

from __future__ import annotations

import threading
from collections.abc import Callable


class WatchedThread(threading.Thread):
    """A daemon thread. failure: the exception that ended it, in words; empty: none did. The trace goes to the journal."""

    def __init__(self, target: Callable[..., object], name: str, args: tuple[object, ...] = ()) -> None:
        super().__init__(target=target, name=name, args=args, daemon=True)
        self.failure = ""

    def run(self) -> None:
        try:
            super().run()
        except BaseException as error:
            self.failure = f"{type(error).__name__}: {error}"
            raise

    @property
    def ended(self) -> bool:
        """Whether it was started and runs no more."""
        return self.ident is not None and not self.is_alive()
