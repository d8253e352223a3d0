"""A simulated autopilot for tests and for the demo: it sends and answers MAVLink messages as PX4 or ArduPilot does.

`SimulatedAutopilot` holds no socket and no clock: bytes and instants in, bytes out. `drivers.simulation.autopilot_link`
connects it to a UDP port or a pty. It behaves as measured on the firmware: PX4 streams without a request and sends
TIMESYNC requests at 10 Hz; ArduPilot sends only heartbeats until streams are requested, and refuses 400 Hz.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..mavlink.dialect import dialect
from ..mavlink.parser import MessageSplitter
from ..mavlink.session_types import ARDUPILOT, PX4
from .firmware_models.ardupilot import ArduPilotReader
from .firmware_models.ardupilot_layers import ArduPilotHeights, ArduPilotLayers
from .firmware_models.px4 import UNKNOWN, Px4Reader
from .firmware_models.timed_flight import TimedFlight
from .firmware_profile import FirmwareProfile, hovering
from .flight_path import VehicleState

NS = 1_000_000_000
AUTOPILOT_IDS = {PX4: dialect.MAV_AUTOPILOT_PX4, ARDUPILOT: dialect.MAV_AUTOPILOT_ARDUPILOTMEGA}
_HEARTBEAT, _TIMESYNC = dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_TIMESYNC
_ATTITUDE, _ATTITUDE_QUATERNION = dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
_LOCAL_POSITION = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
_ATTITUDES = (_ATTITUDE, _ATTITUDE_QUATERNION)
_STREAMS = {dialect.MAV_DATA_STREAM_EXTRA1: (_ATTITUDE,), dialect.MAV_DATA_STREAM_POSITION: (_LOCAL_POSITION,)}
_TAKEN_UNSIGNED = {
    PX4: {"HEARTBEAT", "RADIO_STATUS", "ADSB_VEHICLE", "COLLISION"},
    ARDUPILOT: {"RADIO_STATUS", "RADIO"},
}
"""Messages that are accepted unsigned although a key is set."""
_STREAMED_UNASKED = {PX4: {_ATTITUDE: 100.0, _ATTITUDE_QUATERNION: 50.0, _LOCAL_POSITION: 30.0}, ARDUPILOT: {}}
_MOST_HZ = {PX4: 1000.0, ARDUPILOT: 250.0}
_LOOK_NS = 1_000_000
"""Time between two calls of `due` while a message is held back, because the attitude is hidden or the autopilot is silent."""
_ANGLE_NOISE_RAD = 1e-5
"""The angles of an estimator are never equal to those before: companions refuse repeated ones."""
_VERSIONS = {PX4: (1, 16, 0), ARDUPILOT: (4, 6, 2)}
_VERSION_REQUESTS = (
    (dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    (dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1),
)


class SimulatedAutopilot:
    """An autopilot without input or output: `receive` takes the bytes that the companion sent, `due` returns the bytes to send.
    Local instants are on the companion's monotonic clock, ns.

    parameters: name -> value, sent when requested and when set; a value in `stubborn` does not change (PX4 encodes whole
    numbers, here ints, in the bytes of the float). received: accepted messages, newest last; dropped: messages whose signature
    was refused; obstacles: the model of the firmware's map of OBSTACLE_DISTANCE, which is sent back on request;
    obstacle_times_ns: arrival of each; layers, heights: the same for points and for distances up and down. ignores_obstacles:
    these messages have no effect; sends_nothing: it receives only. silent: the link passes nothing to it, and it sends nothing.
    keeps_messages: False: `received`, `dropped` and `obstacle_times_ns` stay empty, as for a long run."""

    def __init__(self, profile: FirmwareProfile | None = None) -> None:
        self.profile = profile or FirmwareProfile()
        self.parameters: dict[str, float] = {}
        self.received: list[Any] = []
        self.obstacles: Px4Reader | ArduPilotReader = (
            ArduPilotReader() if self.profile.kind == ARDUPILOT else Px4Reader()
        )
        self.obstacle_times_ns: list[int] = []
        self.layers: ArduPilotLayers | None = None
        self.heights = ArduPilotHeights()
        self.stubborn: set[str] = set()
        self.silent = self.ignores_obstacles = self.sends_nothing = False
        self.keeps_messages = True
        self._next_ns: dict[int, int] = {}
        self._flight = TimedFlight(self.profile.flight)
        self._moved: tuple[int | None, VehicleState] = (None, hovering(0))
        self._estimated: VehicleState | None = None
        self._intervals: dict[int, float] = {}
        self._answers: list[bytes] = []
        self._mavlink = dialect.MAVLink(None, self.profile.system_id, self.profile.component_id)
        self._splitter = MessageSplitter()
        self.dropped: list[Any] = []
        self.sign(self.profile.key)
        self.reboot(self.profile.boot_at_ns)

    def reboot(self, now_ns: int) -> None:
        """Boot time starts from 0 and all intervals are forgotten."""
        p = self.profile
        p.boot_at_ns = now_ns
        self._intervals = dict(_STREAMED_UNASKED[p.kind] if p.streams is None else p.streams)
        self._next_ns.clear()
        self._answers.clear()

    def sign(self, key: bytes | None) -> None:
        """Signs with this key from now on; None: stops signing. Forgets the timestamps of earlier signatures."""
        self.profile.key = key
        signing = self._mavlink.signing
        signing.secret_key, signing.sign_outgoing = key, key is not None
        signing.timestamp = self.profile.signing_ticks
        signing.stream_timestamps.clear()

    def boot_ns(self, now_ns: int) -> int:
        """Time since boot on its own clock, which drifts."""
        return max(0, round((now_ns - self.profile.boot_at_ns) * (1.0 + self.profile.drift)))

    def _boot_ms(self, now_ns: int) -> int:
        return self.boot_ns(now_ns) // 1_000_000 % 2**32

    # ---- in -----------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_ns: int) -> None:
        """Handles bytes that the companion sent."""
        for message in self._splitter.feed(data):
            taken = self._takes(message)
            if self.keeps_messages:
                (self.received if taken else self.dropped).append(message)
            if not taken:
                continue
            receive = _RECEIVERS.get(message.get_type())
            if receive is not None:
                receive(self, message, now_ns)

    def _takes(self, message: Any) -> bool:
        """Whether a message is accepted, by the check of the MAVLink library, which also advances its time by received timestamps."""
        frame = message.get_msgbuf()
        if self.profile.key is None or not any(self.profile.key):
            return True
        if frame[0] != 0xFD or not frame[2] & 1:
            return message.get_type() in _TAKEN_UNSIGNED[self.profile.kind]
        return bool(self._mavlink.check_signature(frame, message.get_srcSystem(), message.get_srcComponent()))

    def of_kind(self, kind: str) -> list[Any]:
        """The received messages of one kind."""
        return [m for m in self.received if m.get_type() == kind]

    def _time_request(self, message: Any, now_ns: int) -> None:
        if message.tc1 == 0 and self.profile.answers_timesync:
            self._answer(dialect.MAVLink_timesync_message(self.boot_ns(now_ns) // 1000 * 1000 or 1000, message.ts1))

    def _command(self, message: Any, now_ns: int) -> None:
        asked = message.command, int(message.param1)
        if message.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._set_interval(int(message.param1), float(message.param2))
        elif asked in _VERSION_REQUESTS:
            self._report_version(int(message.command))
        elif asked == (dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_SYS_STATUS):
            present = dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY if self.profile.proximity_started else 0
            self._answer(dialect.MAVLink_sys_status_message(present, present, present, *[0] * 10))
        elif asked == (dialect.MAV_CMD_REQUEST_MESSAGE, _HEARTBEAT):
            self._answer(dialect.MAVLink_command_ack_message(message.command, dialect.MAV_RESULT_ACCEPTED))
            self._answer(self._heartbeat())
        else:
            ack = self._flight.answer(message, (self.profile.system_id, self.profile.component_id), now_ns)
            if ack is not None:
                self._answer(ack)

    def _stream_request(self, message: Any, _: int) -> None:
        for number in _STREAMS.get(int(message.req_stream_id), ()):
            self._intervals[number] = float(message.req_message_rate)

    def _obstacle_distance(self, message: Any, now_ns: int) -> None:
        if self.keeps_messages:
            self.obstacle_times_ns.append(now_ns)
        if not self.ignores_obstacles:
            self.obstacles.read(message, now_ns)

    def _obstacle_point(self, message: Any, now_ns: int) -> None:
        if isinstance(self.obstacles, ArduPilotReader) and not self.ignores_obstacles:
            self.layers = self.layers or ArduPilotLayers(self.obstacles)
            self.layers.read(message, now_ns)

    def _distance(self, message: Any, now_ns: int) -> None:
        if not self.ignores_obstacles:
            self.heights.read(message, now_ns)

    def _set_interval(self, number: int, interval_us: float) -> None:
        result = dialect.MAV_RESULT_ACCEPTED
        if not self.profile.knows_intervals:
            result = dialect.MAV_RESULT_UNSUPPORTED
        elif number == _HEARTBEAT and self.profile.kind == PX4:
            result = dialect.MAV_RESULT_FAILED  # MavlinkReceiver::set_message_interval
        elif interval_us > 0 and 1e6 / interval_us > _MOST_HZ[self.profile.kind]:
            result = dialect.MAV_RESULT_DENIED
        elif interval_us > 0:
            self._intervals[number] = 1e6 / interval_us
        elif interval_us < 0:
            self._intervals.pop(number, None)
        self._answer(dialect.MAVLink_command_ack_message(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, result))

    def _report_version(self, command: int) -> None:
        version = self.profile.version or _VERSIONS[self.profile.kind]
        hidden = self.profile.hides_version
        result = dialect.MAV_RESULT_UNSUPPORTED if hidden else dialect.MAV_RESULT_ACCEPTED
        self._answer(dialect.MAVLink_command_ack_message(command, result))
        if not hidden:
            number = version[0] << 24 | version[1] << 16 | version[2] << 8 | 255
            self._answer(
                dialect.MAVLink_autopilot_version_message(0, number, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
            )

    def _read_parameter(self, request: Any, _: int) -> None:
        name = request.param_id
        if name not in self.parameters:
            return
        value, kind = self.parameters[name], dialect.MAV_PARAM_TYPE_REAL32
        if self.profile.kind == PX4 and isinstance(value, int):
            value, kind = struct.unpack("<f", struct.pack("<i", value))[0], dialect.MAV_PARAM_TYPE_INT32
        index = list(self.parameters).index(name)
        self._answer(dialect.MAVLink_param_value_message(name.encode(), value, kind, len(self.parameters), index))

    def _set_parameter(self, message: Any, now_ns: int) -> None:
        """Sets a parameter and sends it with its new value."""
        name, value = message.param_id, float(message.param_value)
        if name not in self.parameters:
            return
        if self.profile.kind == PX4 and message.param_type == dialect.MAV_PARAM_TYPE_INT32:
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        if name not in self.stubborn:
            self.parameters[name] = value
        self._read_parameter(message, now_ns)

    def relay(self, data: bytes) -> None:
        """Adds bytes of another sender, which a router forwards with the next message."""
        self._answers.append(data)

    def _answer(self, message: Any) -> None:
        self._answers.append(self._pack(message))

    # ---- out ----------------------------------------------------------------------------------------------------

    def due(self, now_ns: int) -> list[bytes]:
        """The messages to send now, encoded."""
        out, self._answers = self._answers, []
        if self.silent or self.sends_nothing:
            return []
        self._flight.until(now_ns)
        if self._is_due(_HEARTBEAT, self._intervals.get(_HEARTBEAT, 1.0), now_ns):
            out.append(self._pack(self._heartbeat()))
        hidden = _ATTITUDES if self.profile.hides_attitude(now_ns) else ()
        for number, hz in list(self._intervals.items()):
            if number > 255 and self.profile.mavlink_1:
                continue
            if number in _SENDERS and number not in hidden and self._is_due(number, hz, now_ns):
                out += [self._pack(message) for message in _SENDERS[number](self, now_ns)]
        hz = self.profile.timesync_asks_hz if self.profile.kind == PX4 else 0.1
        if self._is_due(_TIMESYNC, hz, now_ns):
            out.append(self._pack(dialect.MAVLink_timesync_message(0, self.boot_ns(now_ns))))
        return out

    def next_due_ns(self, now_ns: int) -> int:
        """Instant of the next call of `due` after one at now_ns: that of the next message, or soon where one is held back."""
        own = (_HEARTBEAT, _TIMESYNC)
        awaited = [t_ns for number, t_ns in self._next_ns.items() if number in self._intervals or number in own]
        return max(min(awaited, default=now_ns), now_ns + _LOOK_NS)

    def _is_due(self, number: int, hz: float, now_ns: int) -> bool:
        if hz <= 0.0 or now_ns < self._next_ns.get(number, 0):
            return False
        step = round(NS / hz)
        # keeps the rate over late calls, without a burst after a long pause
        self._next_ns[number] = max(self._next_ns.get(number, now_ns) + step, now_ns)
        return True

    def _heartbeat(self) -> Any:
        p = self.profile
        mode = p.custom_mode if p.flight is None else p.flight.mode
        base_mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED if p.armed else 0
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_QUADROTOR, AUTOPILOT_IDS[p.kind], base_mode, mode, dialect.MAV_STATE_ACTIVE, 3
        )

    def _state(self, now_ns: int) -> VehicleState:
        """Once for all messages of an instant: it takes longer than they do."""
        if self._moved[0] != now_ns:
            flight = self.profile.flight
            self._moved = (now_ns, self.profile.motion(now_ns) if flight is None else flight.state())
        return self._moved[1]

    def _estimate(self, now_ns: int) -> VehicleState:
        """The state with the noise of an estimator in its angles, the same for all messages of an instant."""
        if self._estimated is None or not self.profile.repeats_attitude(now_ns):
            state, noise = self._state(now_ns), random.Random(now_ns)
            roll, pitch, yaw = (a + noise.uniform(-_ANGLE_NOISE_RAD, _ANGLE_NOISE_RAD) for a in state.euler_rad)
            self._estimated = replace(state, euler_rad=(roll, pitch, yaw))
        return self._estimated

    def _attitude(self, now_ns: int) -> list[Any]:
        m = self._estimate(now_ns)
        return [dialect.MAVLink_attitude_message(self._boot_ms(now_ns), *m.euler_rad, *m.rates_frd_rad_s)]

    def _attitude_quaternion(self, now_ns: int) -> list[Any]:
        m = self._estimate(now_ns)
        boot_ms = self._boot_ms(now_ns)
        return [dialect.MAVLink_attitude_quaternion_message(boot_ms, *m.q_ned_frd_wxyz, *m.rates_frd_rad_s)]

    def _local_position(self, now_ns: int) -> list[Any]:
        m = self._state(now_ns)
        boot_ms = self._boot_ms(now_ns)
        return [dialect.MAVLink_local_position_ned_message(boot_ms, *m.position_ned_m, *m.velocity_ned_m_s)]

    def _fused_obstacles(self, now_ns: int) -> list[Any]:
        """PX4's own map, once it has received an obstacle."""
        if not isinstance(self.obstacles, Px4Reader) or not self.obstacles.has_data(now_ns):
            return []
        bins, step = self.obstacles.bins_cm(now_ns), self.obstacles.bin_deg
        values = bins + [UNKNOWN] * (72 - len(bins))
        near_cm, far_cm = self.obstacles.min_cm, max(self.obstacles.ranges_cm)
        boot_us, frame = self.boot_ns(now_ns) // 1000, dialect.MAV_FRAME_BODY_FRD
        return [
            dialect.MAVLink_obstacle_distance_message(
                boot_us, 0, values, step, near_cm, far_cm, float(step), 0.0, frame
            )
        ]

    def _face_distances(self, now_ns: int) -> list[Any]:
        """One DISTANCE_SENSOR for each of ArduPilot's faces that holds something."""
        if not isinstance(self.obstacles, ArduPilotReader):
            return []
        return [
            dialect.MAVLink_distance_sensor_message(
                self._boot_ms(now_ns), 20, 1200, round(100 * m), 0, 10 + face, face, 0
            )
            for face, m in enumerate(self.obstacles.faces_m(now_ns))
            if m < 1e6
        ]

    def _extended_sys_state(self, _: int) -> list[Any]:
        return [dialect.MAVLink_extended_sys_state_message(0, self.profile.landed_state)]

    def _pack(self, message: Any) -> bytes:
        data = bytes(message.pack(self._mavlink, force_mavlink1=self.profile.mavlink_1))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return data


_SENDERS: dict[int, Callable[[SimulatedAutopilot, int], list[Any]]] = {
    _ATTITUDE: SimulatedAutopilot._attitude,
    _ATTITUDE_QUATERNION: SimulatedAutopilot._attitude_quaternion,
    _LOCAL_POSITION: SimulatedAutopilot._local_position,
    dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: SimulatedAutopilot._fused_obstacles,
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: SimulatedAutopilot._face_distances,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: SimulatedAutopilot._extended_sys_state,
}
_RECEIVERS: dict[str, Callable[[SimulatedAutopilot, Any, int], None]] = {
    "TIMESYNC": SimulatedAutopilot._time_request,
    "COMMAND_LONG": SimulatedAutopilot._command,
    "REQUEST_DATA_STREAM": SimulatedAutopilot._stream_request,
    "PARAM_REQUEST_READ": SimulatedAutopilot._read_parameter,
    "PARAM_SET": SimulatedAutopilot._set_parameter,
    "OBSTACLE_DISTANCE": SimulatedAutopilot._obstacle_distance,
    "OBSTACLE_DISTANCE_3D": SimulatedAutopilot._obstacle_point,
    "DISTANCE_SENSOR": SimulatedAutopilot._distance,
}
