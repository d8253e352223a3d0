"""The messages of one camera, and the frame that the live page shows: with its depth image where that is recent."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

from core.types import CameraInfo
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.subscriber import TIMEOUT_S

NS = 1_000_000_000
PICTURE_NS = NS
"""Largest age of a displayed depth image."""
PAIR_NS = round(TIMEOUT_S * NS)
"""A frame is shown with its depth image unless the newest frame is newer by this."""
PLAIN_NS = NS // 5
"""Interval of frames without depth images."""
RECENT = 64
"""Frames and tracks that wait for what belongs to them."""
TRACKS_NS = round(TIMEOUT_S * NS)
"""The newest tracks are drawn with a frame that has none if both exposures differ by at most this."""


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """The frame of a camera that a page draws."""

    number: int  # consecutive
    info: CameraInfo
    message: pb.PrismsFrame
    preview: pb.DepthPreview | None
    exposed_ns: int  # exposure by `clock_ns`
    # after this frame, or the newest ones where these have not arrived; None: they are too old
    tracks: pb.Tracks | None = None


@dataclass(slots=True)
class Camera:
    """The messages of one camera; times by `clock_ns`."""

    info: CameraInfo | None = None
    newest: pb.PrismsFrame | None = None
    exposed_ns: int = 0  # of the newest frame
    received_ns: int = 0  # of the newest frame
    recent: OrderedDict[int, tuple[pb.PrismsFrame, int]] = field(default_factory=OrderedDict)
    preview: pb.DepthPreview | None = None
    preview_exposed_ns: int = 0
    tracks: OrderedDict[int, pb.Tracks] = field(default_factory=OrderedDict)
    shown: Shown | None = None
    key: tuple[Any, ...] = ()  # what distinguishes the shown frame from the next one
    shown_ns: int = 0  # when it was chosen

    def add_frame(self, message: pb.PrismsFrame, exposed_ns: int, now_ns: int) -> None:
        """Takes a frame."""
        self.newest, self.exposed_ns, self.received_ns = message, exposed_ns, now_ns
        self.recent[message.sequence] = message, exposed_ns
        if len(self.recent) > RECENT:
            self.recent.popitem(last=False)

    def add_preview(self, message: pb.DepthPreview, exposed_ns: int) -> None:
        """Takes a depth image."""
        self.preview, self.preview_exposed_ns = message, exposed_ns

    def add_tracks(self, message: pb.Tracks) -> None:
        """Takes tracks."""
        self.tracks[message.sequence] = message
        if len(self.tracks) > RECENT:
            self.tracks.popitem(last=False)

    def choose(self, now_ns: int, number: int) -> bool:
        """Selects the frame to show: that of the newest depth image if it is recent, otherwise the newest. A change
        between blind and valid is shown at once. Returns whether another one is shown than before. number: of that one."""
        m, p = self.newest, self.preview
        if m is None or self.info is None:
            return False
        if p is not None and now_ns - self.preview_exposed_ns <= PICTURE_NS:
            paired, exposed_ns = self.recent.get(p.sequence, (None, 0))
            same = paired is not None and (not paired.valid or paired.t_exposure_ns == p.t_exposure_ns)
            if paired is not None and same and paired.valid == m.valid and self.exposed_ns - exposed_ns < PAIR_NS:
                return self._show(Shown(number, self.info, paired, p, exposed_ns, self.tracks_of(paired)), now_ns)
        turned = self.shown is None or self.shown.message.valid != m.valid
        if turned or not m.valid or now_ns - self.shown_ns >= PLAIN_NS:
            return self._show(Shown(number, self.info, m, None, self.exposed_ns, self.tracks_of(m)), now_ns)
        return False

    def _show(self, shown: Shown, now_ns: int) -> bool:
        """Shows a frame unless it equals the shown one: a blind frame is repeated ten times per second."""
        m, p = shown.message, shown.preview
        picture = None if p is None else (p.sequence, p.t_exposure_ns)
        key = (m.sequence, m.t_exposure_ns if m.valid else m.cause_text, picture, shown.info)
        if key == self.key:
            return False
        self.key, self.shown_ns, self.shown = key, now_ns, shown
        return True

    def tracks_of(self, message: pb.PrismsFrame) -> pb.Tracks | None:
        """Returns the tracks after a frame, or the newest ones where these have not arrived; None: their exposure differs
        from that of the frame by more than TRACKS_NS."""
        newest = next(reversed(self.tracks.values()), None)
        tracks = self.tracks.get(message.sequence, newest)
        if tracks is None or abs(tracks.t_exposure_ns - message.t_exposure_ns) > TRACKS_NS:
            return None
        return tracks
