"""Compares recomputed prisms with those in a log, field by field and bit by bit."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import Any, Final

from google.protobuf.message import Message

from core.types import DepthFrame
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import wire_bytes

Key = tuple[str, int, int]
"""Camera, sequence and exposure of a frame."""
WAITING: Final = 1000
"""Messages of each side that wait for their counterpart, which comes within a second: 20 MB. Of older ones the key is kept."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first differing field of two messages."""

    key: Key
    field: str
    logged: str
    computed: str

    def __str__(self) -> str:
        camera, sequence, t_ns = self.key
        where = f"camera {camera}, frame {sequence}, exposed at {t_ns} ns"
        return f"{where}: {self.field} is {self.logged} in the log and {self.computed} in the replay"


Compared = pb.PrismsFrame | pb.Tracks
"""Messages of which there is one for each frame."""


def key_of(message: Compared | pb.FrameDecision | DepthFrame) -> Key:
    """The key that identifies the frame of a message."""
    return message.camera, message.sequence, message.t_exposure_ns


@dataclass(slots=True)
class Comparison:
    """Pairs messages, in any order within the newest `WAITING`, and keeps the differences."""

    tolerance: float = 0.0  # greatest difference of two numbers, in their unit; 0 is bit-exact
    compared: int = 0
    different: int = 0
    first: Difference | None = None
    _newest_ns: dict[str, int] = field(default_factory=dict)
    _logged: dict[Key, Compared] = field(default_factory=dict)
    _computed: dict[Key, Compared] = field(default_factory=dict)
    _older_logged: list[Key] = field(default_factory=list)
    _older_computed: list[Key] = field(default_factory=list)

    def logged(self, message: Compared) -> None:
        """Adds a message of the log."""
        newest_ns = self._newest_ns.get(message.camera, message.t_exposure_ns)
        self._newest_ns[message.camera] = max(newest_ns, message.t_exposure_ns)
        self._take(message, self._logged, self._computed, logged=True)
        _drop_oldest(self._logged, self._older_logged)

    def computed(self, message: Compared) -> None:
        """Adds a recomputed message."""
        self._take(message, self._computed, self._logged, logged=False)
        _drop_oldest(self._computed, self._older_computed)

    @property
    def only_logged(self) -> tuple[Key, ...]:
        """Keys in the log without a frame to compute them from."""
        return (*self._older_logged, *self._logged)

    @property
    def only_computed(self) -> tuple[Key, ...]:
        """Keys computed but missing from the log."""
        return (*self._older_computed, *self._computed)

    @property
    def gaps(self) -> tuple[Key, ...]:
        """Keys of `only_computed` after which the log contains later frames of the camera, or of which it contains none
        at all. A missing end is not a gap: a log cut short by a power failure usually ends with a depth image."""
        return tuple(key for key in self.only_computed if key[2] <= self._newest_ns.get(key[0], key[2]))

    @property
    def passed(self) -> bool:
        """Whether something was compared and everything was equal."""
        return self.compared > 0 and self.different == 0

    def _take(self, message: Compared, here: dict[Key, Compared], there: dict[Key, Compared], logged: bool) -> None:
        key = key_of(message)
        other = there.pop(key, None)
        if other is None:
            here[key] = message
            return
        self.compared += 1
        pair = (message, other) if logged else (other, message)
        difference = first_difference(*pair, tolerance=self.tolerance)
        if difference is not None:
            self.different += 1
            self.first = self.first or Difference(key, *difference)


def _drop_oldest(waiting: dict[Key, Compared], older: list[Key]) -> None:
    """Keeps the key only of the oldest message where too many wait."""
    if len(waiting) > WAITING:
        key = next(iter(waiting))
        del waiting[key]
        older.append(key)


def first_difference(logged: Compared, computed: Compared, tolerance: float = 0.0) -> tuple[str, str, str] | None:
    """(field, value in the log, computed value) of the first difference; None when equal. Not compared: publication,
    and cause_text, which may change between versions (cause is compared)."""
    a, b = comparable(logged), comparable(computed)
    if wire_bytes(a) == wire_bytes(b):
        return None
    found = _walk(a, b, "", tolerance)
    if found is None and tolerance == 0.0:
        return "unknown fields", "written by a newer schema", "not known to this version"
    return found


def comparable(message: Compared) -> Compared:
    """A copy without the fields that are not compared."""
    copy = type(message)()
    copy.MergeFromString(wire_bytes(message))
    for name in ("publication", "cause_text"):
        if name in copy.DESCRIPTOR.fields_by_name:
            copy.ClearField(name)
    return copy


def _walk(a: Message, b: Message, path: str, tolerance: float) -> tuple[str, str, str] | None:
    for descriptor in a.DESCRIPTOR.fields:
        name = f"{path}{descriptor.name}"
        if descriptor.has_presence and a.HasField(descriptor.name) != b.HasField(descriptor.name):
            presence = ("present", "absent") if a.HasField(descriptor.name) else ("absent", "present")
            return name, *presence
        left, right = getattr(a, descriptor.name), getattr(b, descriptor.name)
        found = _values(descriptor, left, right, name, tolerance)
        if found is not None:
            return found
    return None


def _values(descriptor: Any, left: Any, right: Any, name: str, tolerance: float) -> tuple[str, str, str] | None:
    if not descriptor.is_repeated:
        return _value(left, right, name, tolerance)
    if len(left) != len(right):
        return f"{name} (length)", str(len(left)), str(len(right))
    for i, (one, other) in enumerate(zip(left, right, strict=True)):
        found = _value(one, other, f"{name}[{i}]", tolerance)
        if found is not None:
            return found
    return None


def _value(left: Any, right: Any, name: str, tolerance: float) -> tuple[str, str, str] | None:
    if isinstance(left, Message):
        return _walk(left, right, name + ".", tolerance)
    if isinstance(left, float):
        same = struct.pack("<d", left) == struct.pack("<d", right)
        near = tolerance > 0.0 and (abs(left - right) <= tolerance or (math.isnan(left) and math.isnan(right)))
        return None if same or near else (name, repr(left), repr(right))
    return None if left == right else (name, repr(left), repr(right))
