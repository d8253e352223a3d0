"""One neighbour: its reports, their age, and the place of its frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from .alignment import Fit, FitResult, agree, fit
from .params import SharingParams
from .placement import Floats, Placement, placement_by_position
from .records import Header, LocalFrame, Packet, SharedMover, SharedPlanes, VehicleState

NS = 1_000_000_000
CLOCK_DRIFT = 1e-3
"""Greatest relative difference of the rates of two clocks, each corrected by up to 500 ppm. A delay that grows more slowly is not
noticed."""
OLDEST_S = 4096.0
"""Age of planes whose age is beyond the largest class."""
KEEP_FIT_NS = 30 * NS
"""An alignment that newer fits do not confirm is dropped after this time."""
SILENT_NS = 10 * NS
"""After this silence any packet is accepted, because the sender may have been restarted with its clock set back."""
MOST_FORMER = 8
"""Greatest number of frames that a neighbour has left and whose reports have not expired; a further change is refused."""
MOST_MOVERS = 128
"""Moving obstacles held of one frame; the oldest are dropped. A sender has 56 of them in two seconds."""
MOST_CONTRADICTIONS = 2
"""An alignment is also dropped after this number of consecutive fits with enough planes that do not agree with it."""


@dataclass(slots=True)
class HeldPlane:
    """A plane that a neighbour has reported, in its frame."""

    box: tuple[float, ...]  # a_x, a_y, b_x, b_y, top, bottom, m
    margin_m: float  # margin_m, flags: as reported
    flags: int
    seen_ns: int  # newest observation by the neighbour, on the own clock
    received_ns: int  # arrival of the newest packet with it, from which it expires


@dataclass(slots=True)
class HeldMover:
    """A moving obstacle that a neighbour has reported, in its frame. seen_ns: newest observation by the neighbour, on the
    own clock, from which it expires."""

    mover: SharedMover
    seen_ns: int


@dataclass(slots=True)
class FrameReports:
    """What a neighbour has reported in one frame, and the place of that frame."""

    state: VehicleState | None = None  # newest state; None: not known
    # planes, movers: by their numbers, the one received last at the end
    planes: dict[int, HeldPlane] = field(default_factory=dict)
    movers: dict[int, HeldMover] = field(default_factory=dict)
    aligned: Placement | None = None  # place by planes of both vehicles; None: not known
    aligned_ns: int = 0  # instant of the newest fit that has confirmed `aligned`

    def placement(self, own: LocalFrame | None) -> Placement | None:
        """Returns the place of the frame; None: not known."""
        return self.aligned if self.aligned is not None or own is None else self.by_position(own)

    def by_position(self, own: LocalFrame) -> Placement | None:
        """Returns the place by the positions of both vehicles alone; None: not known."""
        if self.state is None:
            return None
        return placement_by_position(own, self.state.frame, self.state.position_m)

    def boxes(self) -> Floats:
        """Returns the planes in the frame of the neighbour, (N, 6)."""
        return np.array([p.box for p in self.planes.values()], np.float64).reshape(-1, 6)

    def expire(self, now_ns: int, params: SharingParams) -> None:
        """Removes what is too old."""
        oldest_ns = now_ns - round(params.expire_s * NS)
        self.planes = {k: p for k, p in self.planes.items() if p.received_ns > oldest_ns}
        oldest_ns = now_ns - round(params.mover_expire_s * NS)
        self.movers = {k: m for k, m in self.movers.items() if m.seen_ns > oldest_ns}
        if now_ns - self.aligned_ns > KEEP_FIT_NS:
            self.aligned = None


@dataclass(slots=True)
class Neighbour:
    """The reports of one vehicle. Times are on the own clock; `expire` removes reports that are too old."""

    vehicle: int  # vehicle, stream, section, sent_ms: of the newest packet, see `Header`
    stream: int
    section: int
    sent_ms: int
    received_ns: int  # arrival of that packet
    least_offset_ms: float  # least arrival less sent_ms, of the fastest packet, which delays are measured against
    state_ns: int = 0  # when the newest state or motion was sent
    present: FrameReports = field(default_factory=FrameReports)  # reports in the present frame
    # reports in frames that the neighbour has left. They keep the place of their frame, and expire there.
    former: list[FrameReports] = field(default_factory=list)
    packets: int = 0  # packets, refused: numbers of packets
    refused: int = 0
    last_fit: Fit | None = None  # last_fit, fitted_ns: newest fit, and when it was tried
    fitted_ns: int = 0
    _candidate: Placement | None = None
    _contradictions: int = 0

    @classmethod
    def first(cls, header: Header, arrival_ns: int) -> Neighbour:
        """Returns a neighbour from the header of its first packet, which is not counted yet."""
        return cls(
            vehicle=header.vehicle,
            stream=header.stream,
            section=header.section,
            sent_ms=-1,
            received_ns=arrival_ns,
            least_offset_ms=arrival_ns / 1e6 - header.sent_ms,
        )

    def refusal(self, packet: Packet, arrival_ns: int, params: SharingParams) -> str:
        """Returns why a packet must not be used, as a code; empty: it may. Changes nothing."""
        header, silent = packet.header, arrival_ns - self.received_ns > SILENT_NS
        if header.stream < self.stream and not silent:
            return "old_stream"
        if self._changes_frame(packet) and len(self.former) >= MOST_FORMER:
            return "too_many_frames"
        if silent:
            return ""
        if header.stream != self.stream:
            return "" if self._starts_after(header, arrival_ns, params) else "ahead"
        if not self._continues(header, arrival_ns, params):
            return "replayed" if header.sent_ms <= self.sent_ms else "ahead"
        return "delayed" if self._delay_s(header, arrival_ns) > params.max_delay_s else ""

    def take(self, packet: Packet, arrival_ns: int, params: SharingParams) -> None:
        """Uses a packet that `refusal` accepts."""
        header, content = packet.header, packet.content
        if (
            header.stream != self.stream
            or not self._continues(header, arrival_ns, params)
            or self._delay_s(header, arrival_ns) * NS > SILENT_NS
        ):
            self._restart(header, arrival_ns)
        elif header.section != self.section:
            self._leave_frame(header.section)
        delay_s = self._delay_s(header, arrival_ns)
        drifted_ms = CLOCK_DRIFT * (arrival_ns - self.received_ns) / 1e6
        self.least_offset_ms = min(self.least_offset_ms + drifted_ms, arrival_ns / 1e6 - header.sent_ms)
        self.sent_ms, self.received_ns = header.sent_ms, arrival_ns
        self.packets += 1
        sent_ns = arrival_ns - round(max(0.0, delay_s) * NS)
        motion, state = packet.motion, self.present.state
        if motion is not None and state is not None:
            self.present.state = replace(state, position_m=motion.position_m, velocity_m_s=motion.velocity_m_s)
            self.state_ns = sent_ns
        if isinstance(content, VehicleState):
            self._take_state(content, sent_ns)
        elif isinstance(content, SharedPlanes):
            self._take_planes(content, arrival_ns, sent_ns, params.most_planes)
        else:
            self._take_movers(content, sent_ns)

    def expire(self, now_ns: int, params: SharingParams) -> None:
        """Removes reports that are too old."""
        for reports in (self.present, *self.former):
            reports.expire(now_ns, params)
        self.former = [reports for reports in self.former if reports.planes or reports.movers]

    def align(self, own_box: Floats, own: LocalFrame, now_ns: int) -> None:
        """Tries to refine the place of the frame by own planes, (N, 6). Two consecutive fits must agree."""
        self.fitted_ns = now_ns
        present, prior = self.present, self.present.by_position(own)
        if prior is None or not present.planes:
            return
        try:
            self.last_fit = fit(present.boxes(), own_box, prior)
        except (np.linalg.LinAlgError, ArithmeticError, ValueError):
            self.last_fit = Fit(FitResult.FAILED, prior)
        accepted, new = self.last_fit.result is FitResult.ACCEPTED, self.last_fit.placement
        if accepted and present.aligned is not None and agree(present.aligned, new):
            confirmed = True
        else:
            confirmed = accepted and self._candidate is not None and agree(self._candidate, new)
            self._contradictions += self.last_fit.result is not FitResult.TOO_LITTLE
        self._candidate = new if accepted else None
        if confirmed:
            present.aligned, present.aligned_ns, self._contradictions = new, now_ns, 0
        elif self._contradictions >= MOST_CONTRADICTIONS:
            present.aligned, self._contradictions = None, 0

    def forget_alignment(self) -> None:
        """Discards the alignments, because the own frame has changed."""
        self._candidate = self.last_fit = None
        for reports in (self.present, *self.former):
            reports.aligned = None

    def _changes_frame(self, packet: Packet) -> bool:
        """True if a packet is of another frame than those before."""
        header, content = packet.header, packet.content
        if (header.stream, header.section) != (self.stream, self.section):
            return True
        return isinstance(content, VehicleState) and self._moves_origin(content)

    def _moves_origin(self, state: VehicleState) -> bool:
        known = self.present.state
        return known is not None and _origin(known.frame) != _origin(state.frame)

    def _starts_after(self, header: Header, arrival_ns: int, params: SharingParams) -> bool:
        """True if another stream begins after the newest packet was sent: one with a wrong number does not."""
        return arrival_ns - header.sent_ms * 1e6 >= self.received_ns - params.max_delay_s * NS

    def _continues(self, header: Header, arrival_ns: int, params: SharingParams) -> bool:
        """True if a packet of the same stream is later than those before, and not ahead of its arrival."""
        ahead_ms = header.sent_ms + self.least_offset_ms - arrival_ns / 1e6
        return header.sent_ms > self.sent_ms and ahead_ms <= params.max_delay_s * 1e3

    def _delay_s(self, header: Header, arrival_ns: int) -> float:
        """Returns the delay of a packet relative to the fastest packet; 0 for another stream."""
        if header.stream != self.stream:
            return 0.0
        return max(0.0, (arrival_ns / 1e6 - header.sent_ms - self.least_offset_ms) / 1e3)

    def _restart(self, header: Header, arrival_ns: int) -> None:
        self.stream, self.sent_ms = header.stream, -1
        self.least_offset_ms = arrival_ns / 1e6 - header.sent_ms
        self._leave_frame(header.section)

    def _leave_frame(self, section: int) -> None:
        """Begins a new frame."""
        self.section = section
        if self.present.planes or self.present.movers:
            self.former.append(self.present)
        self.present, self._candidate, self.last_fit = FrameReports(), None, None

    def _take_state(self, state: VehicleState, sent_ns: int) -> None:
        if self._moves_origin(state):
            self._leave_frame(self.section)
        self.present.state, self.state_ns = state, sent_ns

    def _take_planes(self, planes: SharedPlanes, arrival_ns: int, sent_ns: int, most: int) -> None:
        held = self.present.planes
        for k in range(len(planes)):
            age_s = float(planes.age_s[k])
            seen_ns = sent_ns - round(min(age_s, OLDEST_S) * NS)
            number = int(planes.ids[k])
            held.pop(number, None)
            held[number] = HeldPlane(
                tuple(planes.box[k].tolist()), float(planes.margin_m[k]), int(planes.flags[k]), seen_ns, arrival_ns
            )
        frames = [*(reports.planes for reports in self.former), held]
        over = sum(map(len, frames)) - most
        for held in frames:
            for number in list(islice(held, max(0, over))):
                del held[number]
                over -= 1

    def _take_movers(self, movers: tuple[SharedMover, ...], sent_ns: int) -> None:
        held = self.present.movers
        for mover in movers:
            held.pop(mover.id, None)
            held[mover.id] = HeldMover(mover, sent_ns - round(mover.age_s * NS))
            if len(held) > MOST_MOVERS:
                held.pop(next(iter(held)))


def _origin(frame: LocalFrame) -> tuple[float, float, float, float]:
    return frame.latitude_deg, frame.longitude_deg, frame.altitude_m, frame.yaw_rad
