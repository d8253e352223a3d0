"""Which vehicle a session receives, and its state: other components, other vehicles, late heartbeats."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.commands import set_px4_hold
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams, Vehicle
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

from .conversation import NS, Conversation, talk


def test_of_another_component_of_the_vehicle_no_state_attitude_or_time_is_used() -> None:
    """A gimbal or a camera has the system id of the vehicle."""
    alone = talk(PX4, boot_at_ns=0, answers_timesync=False)
    alone.run(12.0)
    c = talk(PX4, boot_at_ns=0, answers_timesync=False)
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, component_id=100, boot_at_ns=0)))
    c.run(12.0)
    assert c.session.vehicle is not None
    assert c.session.vehicle.autopilot == PX4
    assert c.session.clock.estimate.source is ClockSource.ENVELOPE
    assert c.samples
    assert [s.t_ns for s in c.samples] == [s.t_ns for s in alone.samples]


@pytest.mark.parametrize("armed", [False, True])
def test_the_attitude_of_another_vehicle_is_never_used_for_one_that_fell_silent(armed: bool) -> None:
    """Its messages are lost, or it has no power yet again, and it still receives: obstacles at the attitude of another one, by way
    of a router, would be wrong. The other one took its place, 3 s after a disarmed one fell silent."""
    c = talk(PX4, boot_at_ns=0, armed=armed)
    c.run(6.0)
    assert c.samples
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, system_id=7, boot_at_ns=50 * NS)))
    c.autopilots[0].sends_nothing = True
    c.samples.clear()
    for _ in range(3):
        c.run(20.0)
        assert c.session.vehicle is not None
        assert c.session.vehicle.system_id == 1
        assert not c.session.connected(c.now_ns)
        assert c.session.own.fell_silent(c.now_ns)
        assert c.samples == []
        assert "systems 1, 7" in c.session.status(c.now_ns).conflicts["several vehicles"]
        c.now_ns += 300 * NS
    c.autopilots[0].sends_nothing = False
    c.autopilots.pop()
    c.run(62.0)
    assert c.samples
    assert c.session.status(c.now_ns).conflicts == {}


@pytest.mark.parametrize("first_s", [0.0, 6.0])
def test_no_attitude_is_used_while_several_vehicles_are_received_and_none_is_configured(first_s: float) -> None:
    """Both autopilots take the obstacles, and the one received first may be another operator's: sectors seen clear by its attitude
    would be wrong."""
    both = [FirmwareProfile(kind=ARDUPILOT, system_id=system, boot_at_ns=50 * NS, armed=True) for system in (7, 1)]
    for configured in (0, 1):
        c = Conversation(MavlinkSession(MavlinkParams(system_id=configured)), [SimulatedAutopilot(both[0])])
        c.run(first_s)
        c.autopilots.append(SimulatedAutopilot(both[1]))
        c.run(1.1)
        c.samples.clear()
        c.run(4.0)
        status = c.session.status(c.now_ns)
        assert bool(c.samples) == bool(configured)
        assert status.vehicle_uncertain != bool(configured)
        assert ("several vehicles" in status.conflicts) != bool(configured)
        if configured:
            continue
        assert "no attitude is used" in status.conflicts["several vehicles"]
        c.autopilots.pop()
        c.run(55.0)
        assert c.samples == []
        c.run(6.0)
        assert c.samples
        assert not c.session.status(c.now_ns).vehicle_uncertain


@pytest.mark.parametrize("first_is_received", [True, False])
@pytest.mark.parametrize("kinds", [(PX4, ARDUPILOT), (ARDUPILOT, PX4), (PX4, PX4)])
def test_what_is_safe_for_the_kinds_of_all_received_vehicles_is_sent(
    kinds: tuple[str, str], first_is_received: bool
) -> None:
    """Of PX4 alone the wall ends after silence_s, and the own ArduPilot, which takes unknown for clear, would fly on."""
    c = talk(kinds[0], boot_at_ns=0, armed=True, system_id=7)
    c.run(2.5)  # the second one's heartbeats then arrive between those of the first
    c.autopilots[0].sends_nothing = not first_is_received
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=kinds[1], boot_at_ns=50 * NS, armed=True)))
    c.run(1.1)
    for _ in range(25):
        c.run(0.1)
        assert c.session.vehicle is not None
        assert c.session.vehicle.system_id == 7
        assert c.session.vehicle.autopilot == " or ".join(sorted(set(kinds)))
    assert set(c.session.status(c.now_ns).conflicts) == {"several vehicles"}
    c.autopilots.pop()
    c.autopilots[0].sends_nothing = False
    c.run(62.0)
    assert c.session.vehicle.autopilot == kinds[0]


@pytest.mark.parametrize("vehicle_type", [5, 6, 18, 26, 27, *range(30, 35), *range(36, 43)])
def test_what_is_no_vehicle_is_not_taken_for_one(vehicle_type: int) -> None:
    """ArduPilot's antenna tracker has component 1 and an attitude of its own; a receiver of other traffic or a logger with component
    1 would make all cameras blind."""
    tracker = dialect.MAVLink(None, 200, 1)
    session = MavlinkSession()
    beat = dialect.MAVLink_heartbeat_message(vehicle_type, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3)
    session.receive([(bytes(beat.pack(tracker)), NS)])
    assert session.vehicle is None
    c = Conversation(session, [SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, boot_at_ns=0))])
    c.run(2.0)
    assert c.session.vehicle is not None
    assert c.session.vehicle.system_id == 1
    assert c.session.status(c.now_ns).conflicts == {}


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_late_copy_of_a_heartbeat_brings_no_earlier_state_back(kind: str) -> None:
    """A network or a second route delivers it again, seconds later."""
    heartbeats: list[bytes] = []
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, armed=True, custom_mode=5))

    def keep(data: bytes, _: int) -> None:
        heartbeats.extend([data] if data[7:10] == b"\0\0\0" else [])

    c = Conversation(MavlinkSession(on_frame=keep), [autopilot])
    c.run(4.0)
    copies = tuple(heartbeats)
    assert len(copies) >= 4
    for armed, mode in ((True, 3), (False, 5)):
        autopilot.profile.armed, autopilot.profile.custom_mode = armed, mode
        c.run(1.5)
        vehicle = c.session.vehicle
        assert vehicle is not None
        assert (vehicle.armed, vehicle.custom_mode) == (armed, mode)
        c.session.post(set_px4_hold(1), c.now_ns, vehicle)
        c.session.receive([(data, c.now_ns) for data in copies])
        assert c.session.vehicle == vehicle
        assert c.session.has_posted
        sent = len(c.sent)
        c.run(0.01)
        assert "COMMAND_LONG" in Conversation(c.session, [], sent=c.sent[sent:]).kinds()
    assert c.session.status(c.now_ns).counts["late_heartbeat"] == 2 * len(copies)
    autopilot.profile.armed = True
    c.run(1.1)
    assert c.session.vehicle is not None
    assert c.session.vehicle.armed
    assert c.session.vehicle.custom_mode == 5  # of a new heartbeat, as before the copies


def test_whether_a_silent_vehicle_is_armed_is_known_only_if_it_was() -> None:
    c = talk(PX4)
    c.run(2.0)
    vehicle = c.session.vehicle
    assert vehicle is not None
    for armed, silent in ((False, None), (True, True)):
        c.session.own.vehicle = replace(vehicle, armed=armed)
        assert c.session.own.armed(c.now_ns) is armed
        assert c.session.own.armed(c.now_ns + 4 * NS) is silent
        assert not c.session.own.fell_silent(c.now_ns)
        assert c.session.own.fell_silent(c.now_ns + 4 * NS) is armed


def test_to_a_vehicle_that_fell_silent_in_flight_obstacles_are_still_sent() -> None:
    """Its messages are lost. It may still receive."""
    c = talk(PX4)
    c.run(2.0)
    vehicle = c.session.vehicle
    assert vehicle is not None
    for armed in (False, True):
        c.session.own.vehicle = replace(vehicle, armed=armed)
        later_ns = c.now_ns + 4 * NS
        c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [100] * 72, 5, 20, 1200, 5.0, 0.0, 12), later_ns)
        assert len(c.session.due(later_ns)) == armed


@pytest.mark.parametrize("first_s", [0.0, 20.0])
def test_obstacles_are_still_sent_while_another_vehicle_than_the_one_received_first_may_be_the_own_one(
    first_s: float,
) -> None:
    """The own one flies, and another one that stands on the ground was received first and was switched off. Nothing was sent, which
    ArduPilot takes for clear."""
    c = talk(ARDUPILOT, system_id=7)
    c.run(2.0)
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, boot_at_ns=50 * NS, armed=True)))
    c.run(first_s)
    c.autopilots[0].sends_nothing = True
    c.run(5.0)
    assert c.session.vehicle is not None
    assert not c.session.vehicle.armed
    assert not c.session.connected(c.now_ns)
    message = dialect.MAVLink_obstacle_distance_message(0, 4, [100] * 72, 5, 20, 1200, 5.0, 0.0, 12)
    for later_s, often in ((0, 1), (61, 0)):
        later_ns = c.now_ns + later_s * NS
        c.session.post(message, later_ns)
        c.session.post(dialect.MAVLink_statustext_message(4, b"OA: several vehicles, set system_id"), later_ns)
        sent = Conversation(c.session, [], sent=c.session.due(later_ns)).kinds()
        assert sent.count("OBSTACLE_DISTANCE") == sent.count("STATUSTEXT") == often


def test_a_configured_vehicle_is_the_only_one_received() -> None:
    c = talk(PX4, MavlinkParams(system_id=3))
    c.run(2.0)
    assert c.session.vehicle is None
    assert c.sent == []


def test_system_0_is_no_vehicle_since_commands_to_it_reach_all() -> None:
    """MAVLink takes target 0 for a broadcast."""
    c = talk(PX4, system_id=0)
    c.run(2.0)
    assert c.session.vehicle is None
    assert c.sent == []
    assert c.session.status(c.now_ns).counts["other_vehicle"] > 0
    expected = Vehicle(0, PX4, 2, True, 0, heartbeat_ns=0)
    c = talk(PX4, system_id=0)
    c.session = MavlinkSession(expected=expected)
    c.run(2.0)
    assert c.session.vehicle is None
