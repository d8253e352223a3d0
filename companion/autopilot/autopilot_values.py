"""What is known of the autopilot: parameters, version and landed state, read now or before this start."""

from __future__ import annotations

from typing import Any

from drivers.mavlink.session_types import Vehicle

from .failsafe import AutopilotNow
from .firmware_version import VersionReader
from .landed import LandedState
from .last_values import LastValues, LastValuesFile
from .parameter_fault import AutopilotFacts
from .parameters import WANTED, ParameterReader


class AutopilotValues:
    """`take` gets every message of the autopilot, `due` returns the requests to send.

    Attributes:
        parameters: reads the parameters.
        version: reads the firmware's version."""

    def __init__(self, last: LastValuesFile) -> None:
        """last: values that were read before this start, used until they are read again."""
        self.parameters, self.version = ParameterReader(), VersionReader()
        self._landed, self._last = LandedState(), last

    def take(self, message: Any, arrival_ns: int) -> None:
        """Handles a message of the autopilot."""
        self.parameters.take(message, arrival_ns)
        self.version.take(message)
        self._landed.take(message, arrival_ns)

    def due(self, vehicle: Vehicle, now_ns: int) -> list[Any]:
        """Returns the requests for parameters and version to send now, and keeps what was read."""
        if vehicle.autopilot in WANTED:  # not while heartbeats contradict each other: then the values read before count
            self.parameters.begin(vehicle.autopilot, vehicle.system_id)
            self.version.begin(vehicle.autopilot, vehicle.system_id)
        requests = [*self.parameters.due(now_ns, vehicle.system_id), *self.version.due(now_ns, vehicle.system_id)]
        if vehicle.autopilot == self.parameters.kind:
            read = self.parameters.values()
            self._last.keep(LastValues(vehicle.autopilot, vehicle.system_id, self.version.version, read))
        return requests

    def facts(self, vehicle: Vehicle) -> AutopilotFacts:
        """Returns what was read. Until the version is read again, it is that of the last start."""
        version = self.version.version or self._last.of(vehicle.autopilot, vehicle.system_id).version
        kind, values, silent = vehicle.autopilot, self.parameters.values(), self.parameters.silent()
        return AutopilotFacts(kind=kind, values=values, silent=silent, version=version)

    def parameter(self, vehicle: Vehicle, name: str) -> float | None:
        """Returns a parameter as it is read now, else as it was read before this start; None: never."""
        read = self.parameters.value(name)
        return self._last.of(vehicle.autopilot, vehicle.system_id).parameters.get(name) if read is None else read

    def state(self, vehicle: Vehicle, now_ns: int, *, is_uncertain: bool) -> AutopilotNow:
        """Returns the state of the autopilot for a decision. is_uncertain: several vehicles may be the own one."""
        return AutopilotNow(
            kind=vehicle.autopilot,
            margin_m=self.parameter(vehicle, "AVOID_MARGIN"),
            cp_dist_m=self.parameter(vehicle, "CP_DIST"),
            on_ground=not is_uncertain and self._landed.on_ground(vehicle, now_ns),
            margin_is_read=self.parameters.value("AVOID_MARGIN") is not None,
            is_uncertain=is_uncertain,
        )

    def close(self) -> None:
        """Waits for a write in progress. May be called twice."""
        self._last.close()
