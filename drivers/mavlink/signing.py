"""Signatures of MAVLink 2 on one link: signs what is sent, and verifies what is received.

The library can do both, with two faults. Its timestamp advances by one per packet and is not the time: here each
packet gets a timestamp of `SigningClock`. And it stores the timestamp of a packet before it verifies the signature,
so that one forged packet with a late timestamp locks out all valid ones: here the signature is verified first.

With a key, only messages signed with it are accepted. An autopilot that is not accepted is still sent the heartbeat:
its clock may be behind after a long time without power, and it learns the time from the signed heartbeat.

PX4 1.17 signs all its messages with a key of zeros until it is given a key, and accepts unsigned ones until then
(`MavlinkSignControl` in its sources). Such a signature proves nothing: the message counts as unsigned. PX4 1.18 signs
nothing until it is given a key."""

from __future__ import annotations

import hmac
from collections import Counter
from enum import Enum
from typing import Any

from .anomalies import LinkAnomaly
from .clock_bounds import NS
from .dialect import dialect
from .parser import MAVLINK2, SIGNATURE_BYTES
from .signing_clock import TICKS_PER_S, SigningClock
from .signing_key import KEY_BYTES, SigningKey, signature_of

NEW_STREAM_TICKS = 60 * TICKS_PER_S
"""Largest lag of the timestamp of a new sender."""
RECENT_NS = 5 * NS
"""Only messages of the autopilot within this time decide which fault is reported."""
HEARD_NS = 3 * NS
"""An autopilot that was not heard for so long ignores nothing: it is gone. It may send a heartbeat a second and nothing else."""
_NO_KEY = bytes(KEY_BYTES)


class Verdict(Enum):
    """Result of the verification of a signature."""

    UNSIGNED = "unsigned, or signed with a key of zeros"
    UNCHECKED = "signed, and no key is configured"
    GOOD = "signed with the configured key"
    FORGED = "signed with another key"
    OLD = "signed with the configured key, but not newer than earlier messages"


ANOMALIES = {
    Verdict.UNSIGNED: LinkAnomaly.UNSIGNED,
    Verdict.FORGED: LinkAnomaly.SIGNATURE_WRONG_KEY,
    Verdict.OLD: LinkAnomaly.SIGNATURE_REPLAYED,
}
REJECTED = frozenset(ANOMALIES)
"""Verdicts on messages that do not count if a key is configured."""


class Signing:
    """Signatures of one link. Without a key nothing is signed and everything is accepted. Messages are those of the
    dialect, as received."""

    def __init__(self, key: SigningKey | None = None, clock: SigningClock | None = None) -> None:
        self._key, self._clock = key, clock or SigningClock()
        self._streams: dict[tuple[int, int, int], int] = {}
        self._autopilot_ns: dict[Verdict, int] = {}
        self._good_since_ns = 0
        self.claimed_system = 0
        self.counts: Counter[LinkAnomaly] = Counter()

    @property
    def on(self) -> bool:
        """True if a key is configured."""
        return self._key is not None

    @property
    def failure(self) -> str:
        """Exception that ended the storing of timestamps, as text; empty: none."""
        return self._clock.failure

    @property
    def clock_fault(self) -> str:
        """Why timestamps are not stored, as text; empty: they are."""
        failure = self._clock.failure
        return f"timestamps of signatures are not saved ({failure})" if failure else self._clock.fault

    def close(self) -> None:
        """Ends the storing of timestamps."""
        self._clock.close()

    # ---- in ---------------------------------------------------------------------------------------------------------

    def believes(self, message: Any, arrival_ns: int, vehicle: int = 0) -> bool:
        """True if a message may be used; others are counted. vehicle: system id of the vehicle; 0: any."""
        if self._key is None and not _signed(message.get_msgbuf()):
            return True  # an unsigned heartbeat reveals nothing
        verdict = self._verdict(message)
        accepted = self._key is None or verdict not in REJECTED
        if not accepted:
            self.counts[ANOMALIES[verdict]] += 1
        system = message.get_srcSystem()
        # without a key an autopilot is known by its heartbeat only; before it there is no receiver
        counts = verdict is not Verdict.UNCHECKED or message.get_msgId() == dialect.MAVLINK_MSG_ID_HEARTBEAT
        if counts and message.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1 and vehicle in (0, system):
            if verdict is Verdict.GOOD and not self._recent(verdict, arrival_ns):
                self._good_since_ns = arrival_ns
            self._autopilot_ns[verdict] = arrival_ns
            if not accepted:
                self.claimed_system = system
        return accepted

    def _verdict(self, message: Any) -> Verdict:
        frame = message.get_msgbuf()
        if not _signed(frame):
            return Verdict.UNSIGNED
        signed, signature = bytes(frame[:-6]), bytes(frame[-6:])
        if signature == signature_of(_NO_KEY, signed):
            return Verdict.UNSIGNED
        if self._key is None:
            return Verdict.UNCHECKED
        if not hmac.compare_digest(self._key.signature(signed), signature):
            return Verdict.FORGED
        ticks = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[-13], message.get_srcSystem(), message.get_srcComponent())
        last = self._streams.get(stream)
        if ticks + NEW_STREAM_TICKS < self._clock.now() if last is None else ticks <= last:
            return Verdict.OLD
        self._streams[stream] = ticks
        self._clock.received(ticks)
        return Verdict.GOOD

    # ---- out --------------------------------------------------------------------------------------------------------

    def prepare(self, encoder: Any) -> None:
        """Makes the library sign the next packet with a timestamp of `SigningClock`."""
        if self._key is None:
            return
        encoder.signing.secret_key = self._key.secret
        encoder.signing.sign_outgoing = True
        encoder.signing.timestamp = self._clock.next()

    def rejects_autopilot(self, now_ns: int) -> bool:
        """True if messages of an autopilot were rejected lately. Only the heartbeat is then sent to it."""
        return self._key is not None and any(self._recent(v, now_ns) for v in REJECTED)

    # ---- faults -----------------------------------------------------------------------------------------

    def good(self, now_ns: int) -> bool:
        """True if the autopilot's signatures are correct at present."""
        return self._recent(Verdict.GOOD, now_ns)

    def fault(self, now_ns: int, *, answered: bool) -> str:
        """Returns the fault of the signatures with its remedy, as text; empty: none. answered: the autopilot answers
        requests of this service, so it accepts its messages."""
        text = self._with_key(now_ns, answered) if self.on else self._without_key(now_ns, answered)
        return text or self._clock.fault

    def _recent(self, verdict: Verdict, now_ns: int) -> bool:
        at_ns = self._autopilot_ns.get(verdict)
        return at_ns is not None and now_ns - at_ns < RECENT_NS

    def _without_key(self, now_ns: int, answered: bool) -> str:
        if not self._recent(Verdict.UNCHECKED, now_ns):
            return ""
        does = "its messages may be forged" if answered else "it drops all messages of this service but heartbeats"
        return (
            f"the autopilot signs and no key is configured: {does}; name the file of its key in [autopilot] signing_key"
        )

    def _with_key(self, now_ns: int, answered: bool) -> str:
        if self._recent(Verdict.GOOD, now_ns):
            if not answered and now_ns - self._autopilot_ns[Verdict.GOOD] < HEARD_NS:
                return "the autopilot ignores signed messages: its key is the same; set the clock of this computer, which may be behind"
            # unsigned messages from before the key was set are of the autopilot itself
            wrong = [
                v
                for v in (Verdict.FORGED, Verdict.UNSIGNED)
                if self._recent(v, now_ns) and self._autopilot_ns[v] > self._good_since_ns + NS
            ]
            return (
                f"another sender uses the autopilot's ids: {wrong[0].value}; its messages are dropped" if wrong else ""
            )
        ignored = "its messages are rejected, and no obstacles are sent to it"
        if self._recent(Verdict.FORGED, now_ns):
            return f"the autopilot signs with another key: {ignored}; give both the same key"
        if self._recent(Verdict.OLD, now_ns):
            return f"the autopilot's signatures are too old: {ignored} until it has taken the time from this service"
        if self._recent(Verdict.UNSIGNED, now_ns):
            return (
                f"the autopilot does not sign, but a key is set: {ignored}; give it the key from the ground station, or "
                "leave [autopilot] signing_key empty"
            )
        return ""


def for_the_log(message: Any) -> bytes | None:
    """Returns a message's frame for the log, without its signature; None for SETUP_SIGNING, which contains the key.

    Signatures are left out because they help to find the key."""
    if message.get_msgId() == dialect.MAVLINK_MSG_ID_SETUP_SIGNING:
        return None
    frame = bytes(message.get_msgbuf())
    if not _signed(frame):
        return frame
    plain = bytearray(frame[: -SIGNATURE_BYTES - 2])
    plain[2] &= ~dialect.MAVLINK_IFLAG_SIGNED
    checked = dialect.x25crc(bytes(plain[1:]) + bytes([message.crc_extra]))
    return bytes(plain) + int(checked.crc).to_bytes(2, "little")


def _signed(frame: bytes | bytearray) -> bool:
    return bool(frame[0] == MAVLINK2 and frame[2] & dialect.MAVLINK_IFLAG_SIGNED)
