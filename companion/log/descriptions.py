"""Descriptions of cameras and configuration, from another log for one that has lost its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drivers.logs.reader import open_scan, our_channel
from drivers.logs.record_scanner import Logged
from drivers.logs.topics import TOPICS

from ..usage_error import UsageError

_DESCRIBING = ("run", "camera_info")


def lost_descriptions(path: Path, other: Path) -> list[Logged]:
    """The messages of `other` that describe the run and the cameras of `path` and that this one lacks, at the time of its first
    message. Raises DriverError for a file that cannot be read, UsageError where none is lacking, or the other log does not have
    them."""
    present: set[tuple[str, str]] = set()
    first_ns = None
    for kind, item in _ours(path):
        present.add(kind)
        first_ns = item.message.log_time if first_ns is None else first_ns
    cameras = {camera for key, camera in present if key == "depth"}
    wanted = {("run", ""), *(("camera_info", camera) for camera in cameras)} - present
    if not wanted - {("run", "")}:
        raise UsageError(f"{path}: no description of a camera is lost; leave --cameras-from out")
    found: dict[tuple[str, str], Logged] = {}
    for kind, item in _ours(other):
        if kind in wanted:
            found.setdefault(kind, item)
    missing = sorted(TOPICS[key].of(camera) for key, camera in wanted - found.keys())
    if missing:
        raise UsageError(
            f"{other}: has no {', '.join(missing)}; give a log of the same vehicle, such as another file of the flight"
        )
    for item in found.values():
        item.message.log_time = item.message.publish_time = first_ns or 0
    return [found[kind] for kind in sorted(found, key=lambda kind: _DESCRIBING.index(kind[0]))]


def _ours(path: Path) -> Iterator[tuple[tuple[str, str], Logged]]:
    """The messages of this software, with key and camera."""
    scan = open_scan(path)
    try:
        for item in scan.items():
            if isinstance(item, Logged):
                kind = our_channel(item.channel, item.schema)
                if kind is not None:
                    yield kind, item
    finally:
        scan.close()
