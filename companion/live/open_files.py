"""Limit of open files of the service.

Each connection of a subscriber takes one. Where none is left, libzmq aborts the process when a subscriber connects over ipc
(`Too many open files`), and the obstacles end with it. The usual limit of 1024 is for programs that use select(), which
the service does not."""

from __future__ import annotations

import resource

MOST_FILES = 65_536


def raise_limit() -> int:
    """Raises the limit of open files to the greatest one that the system permits, at most MOST_FILES. Returns the limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_FILES if hard == resource.RLIM_INFINITY else min(MOST_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        return wanted
    return soft
