"""A flight that never ends: a path flown there and back, again and again, since the zero of the monotonic clock.

Where it is depends on the clock alone. So a simulated camera and a simulated autopilot in different processes, started
and restarted at any time, fly the same flight without a word between them. The way back is the way there, backwards:
nothing jumps when a lap is over. Only the swaying of the attitude turns round at the ends, within 0.2 rad/s."""

from __future__ import annotations

from dataclasses import replace

from .flight_path import Triple, VehicleState
from .flights import FlightPlan

NS = 1_000_000_000


class LoopingFlight:
    """A plan on the monotonic clock. Raises ValueError for a path without duration."""

    def __init__(self, plan: FlightPlan) -> None:
        self.plan = plan
        self.leg_ns = round(plan.path.duration_s * NS)
        """From one end of the path to the other."""
        if self.leg_ns <= 0:
            raise ValueError(f"flight {plan.name}: its path takes no time")

    def on_path(self, t_ns: int) -> tuple[int, bool]:
        """(time since the start of the path in ns, 0..leg_ns; whether the vehicle is on the way back)."""
        phase = t_ns % (2 * self.leg_ns)
        return (2 * self.leg_ns - phase, True) if phase > self.leg_ns else (phase, False)

    def state(self, t_ns: int) -> VehicleState:
        """The true state of the vehicle at an instant of the monotonic clock."""
        since_ns, back = self.on_path(t_ns)
        there = self.plan.path.at(since_ns / NS)
        if not back:
            return there
        return replace(
            there,
            velocity_ned_m_s=_reversed(there.velocity_ned_m_s),
            rates_frd_rad_s=_reversed(there.rates_frd_rad_s),
        )

    def hides_attitude(self, t_ns: int) -> bool:
        """Whether the plan says that no attitude comes from here."""
        since_s = self.on_path(t_ns)[0] / NS
        return any(begin <= since_s < end for begin, end in self.plan.failures.no_attitude)


def _reversed(v: Triple) -> Triple:
    return (-v[0], -v[1], -v[2])
