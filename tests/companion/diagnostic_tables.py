"""The rows of the tables of docs/reference/diagnostics.md, from the codes themselves; `reference_tables` writes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from companion.diagnostic import DiagnosticCode as D
from companion.live.prometheus import families
from companion.pipeline.sync import DropCause
from companion.self_check.exposure_offset import STATE_TEXTS
from core.codes import Code
from core.types import InvalidCause
from drivers.mavlink.anomalies import LinkAnomaly
from osape_client.proto import osape_v1_pb2 as pb

REMEDIES: Final[Mapping[str, Mapping[D, str]]] = {
    "Service": {
        D.STARTING: "wait; without compiled kernels a start takes minutes",
        D.THREAD_STALLED: "the watchdog ends the service; send the log",
        D.SERVICE_UNREACHABLE: "`systemctl status osape-companion`; run the command as a user who may read the socket",
        D.RESEARCH_MODE: "update the service",
    },
    "Cameras": {
        D.NO_CAMERA_CONFIGURED: "add a `[[camera]]`",
        D.NOT_A_LIVE_CAMERA: "set another `kind`, see [connect a camera](../how-to/connect-a-camera.md)",
        D.CAMERA_UNAVAILABLE: "check cable and power; the text names the cause, see [conditions](#camera-conditions)",
        D.OPTIONAL_CAMERA_UNAVAILABLE: "the same",
        D.CAMERA_FEW_MEASURED: "check the lens cap, the light, and that objects are farther than `min_range_m`",
        D.CAMERA_RATE_LOW: (
            "less than 80 % of `fps` for 3 s: use USB 3; automatic exposure in poor light can lower the rate. `doctor` after "
            "one frame only: more time (`--patience`)"
        ),
        D.CAMERA_MISALIGNED: (
            "calibrate it with its maker's tool, or use the calibration file of its serial number "
            "([rows](../explanation/stereo-depth.md#rows-of-both-images))"
        ),
        D.TEMPLATE_INTRINSICS: "set the values of your camera",
        D.INTRINSICS_DIFFER: "set the values, or download the file, that the text names",
        D.EXPOSURE_TIME_OFFSET: (
            "the offset is above 4 ms and three standard deviations: set `exposure_offset_ms`, see "
            "[how-to](../how-to/measure-exposure-offset.md)"
        ),
    },
    "Mount and ground": {
        D.MOUNT_ERROR: (
            "correct `roll_deg`, `pitch_deg`: [check in operation](../how-to/calibrate-the-mount.md#check-in-operation)"
        ),
        D.MOUNT_DEGRADED: "the same",
        D.MOUNT_UNVERIFIED: "turn the vehicle by 45 degrees or more with ground in view, or aim the camera at walls",
        D.MOUNT_YAW_ERROR: "correct `yaw_deg`",
        D.GROUND_SLOPE_LIMIT: "steep terrain or wrong mount: look at the `mount` line of `status`",
        D.GROUND_LOST: "after 1 s. A large inclined surface is in view: steep terrain or wrong mount",
        D.GROUND_NEVER_SEEN: (
            "after 300 valid frames with at least 90 % measured pixels: check the signs of `pitch_deg` and `roll_deg`, a "
            "camera rotated by 90 or 180 degrees, and the attitude. No fault if only walls or sky are in view"
        ),
    },
    "Link to the autopilot": {
        D.NO_AUTOPILOT_CONFIGURED: "set `[autopilot] address`",
        D.LINK_CLOSED: "check the name and the rights of the device, and whether another program uses the port",
        D.LINK_SLOW: (
            "use 921600 baud, or lower rates; check cable and flow control. TCP: check the network, and that the other "
            "end reads"
        ),
        D.UDP_FLOOD: "find the sender; use a signed line",
        D.SIGNING_FAULT: "compare the keys: [signing](../how-to/sign-the-mavlink-line.md)",
        D.DUPLICATE_AUTOPILOT: (
            "find the second sender; give each vehicle its own system id. Copies that arrive late by another route cause it too"
        ),
        D.SEVERAL_VEHICLES: "set `[autopilot] system_id`: without it no attitude is used while several are received, and for 60 s after. After a change of the autopilot's id restart the service",
        D.DUPLICATE_OBSTACLE_SOURCE: (
            'the "clear" of one overwrites the obstacle of the other: switch one off, or do not forward its messages'
        ),
        D.DUPLICATE_COMPONENT: "end the second instance of the service, or the other program with component 196",
        D.SYSTEM_ID_MISMATCH: "correct `[autopilot] system_id`",
        D.NO_HEARTBEAT: (
            "check that the autopilot is on, the address, and of a serial port baud rate, wires and MAVLink protocol; the text states what "
            "arrives"
        ),
        D.ATTITUDE_STALE: (
            'the attitude is older than 0.5 s: check the stream rate and the link. "arrive and are not used": '
            "[the autopilot's clock is not known](../explanation/clock-synchronisation.md#the-autopilots-clock), as with "
            "`no_timesync`"
        ),
        D.ATTITUDE_REPEATED: (
            "during start and calibration of the autopilot: wait. Otherwise its estimator has stopped, or a relay repeats "
            "messages: reboot it, connect it without the relay. A script or simulator that sends constant angles "
            "(ArduPilot SITL with `AHRS_EKF_TYPE` 10) needs noise (0.00001 rad)"
        ),
        D.ATTITUDE_RATE_LOW: (
            "below 10 Hz for 3 s, in `doctor` below 80 % of `attitude_hz`: raise the stream rate of the port (ArduPilot "
            "`SRn_EXTRA1`, newer `MAVn_EXTRA1`; PX4 `MAV_n_RATE`); another station may reset it"
        ),
        D.NO_TIMESYNC: (
            "**do not fly**: all cameras are blind for 10 s after its first message; then a [delay of the line above 30 ms]"
            "(../explanation/clock-synchronisation.md#the-autopilots-clock) displaces obstacles in turns. Use MAVLink 2 on that "
            "port; TIMESYNC must pass all routers in both directions"
        ),
        D.CLOCK_UNCERTAIN: (
            "above 10 ms: the line is slow, or NTP corrects the clock of this computer. Use 921600 baud, or lower rates; "
            "synchronise the clock before the flight. [Frames in fast turns are dropped]"
            "(../explanation/clock-synchronisation.md#from-attitude-samples-to-a-frame)"
        ),
        D.AUTOPILOT_SAMPLES_LOST: "reduce the load of the computer or the frame rate",
    },
    "Obstacles for the autopilot, guard": {
        D.AVOIDANCE_FAULT: "blind values are sent; send the log",
        D.OBSTACLES_NOT_ACCEPTED: "correct what the text names: signatures, MAVLink 1, parameters",
        D.FLIGHT_MODE_UNPROTECTED: "fly in a mode that brakes: [flight modes](../explanation/failsafe.md#flight-modes)",
        D.PARAMETERS_UNKNOWN: "the autopilot does not answer PARAM_REQUEST_READ",
        D.PARAMETER_ADVICE: "set the value that the text gives, or `companion doctor --apply`",
        D.PARAMETER_CONTRADICTION: "find the second autopilot or ground station",
        D.PARAMETERS_NOT_WRITTEN: "the text names the cause",
        D.AVOID_MARGIN_UNKNOWN: "set `[avoid] avoid_margin_m` to the value of the vehicle",
        D.NEVER_CLEAR: (
            "PX4 does not move into it, ArduPilot is sent the artificial wall: change the value that the text gives "
            "(`[avoid] max_distance_m`, or the height band)"
        ),
        D.GUARD_UNAVAILABLE: (
            "the text names the cause, see [when nothing is sent](../explanation/guard.md#when-nothing-is-sent)"
        ),
        D.GUARD_INTERVENES: "change the flight mode to take over",
        D.GUARD_FAULT: "the service restarts; automatic modes are not stopped",
    },
    "Log, metrics, world, sharing, kernels": {
        D.RECORDING_FAULT: "check the disk and the rights of the directory; obstacles are still detected and sent",
        D.LOG_NOT_WRITABLE: "check the rights of `[record] folder`",
        D.DISK_LOW: "less than `least_free_mb` and `queue_mb` is left, so that nothing is recorded",
        D.METRICS_FAULT: "set another `[service] metrics_port`",
        D.DEPTH_PREVIEW_FAULT: "viewers show no depth; nothing else is affected",
        D.SIGNATURE_CLOCK_FAULT: "check the rights of the state folder; after a restart messages may be refused",
        D.KEY_CHECK_FAULT: "restart the service",
        D.WORLD_FAULT: "planners must not use the merged world; send the log",
        D.WORLD_STALLED: "the same",
        D.SHARE_FAULT: "the text names the cause, such as two vehicles with one number",
        D.SHARE_LINK_CLOSED: "check the address and the configuration of zenoh",
        D.SHARE_NO_FRAME: "`GPS_GLOBAL_ORIGIN` was not received: set `[share] origin`",
        D.SHARE_NOT_AUTHENTICATED: "set a signing key, or users or TLS of zenoh",
        D.KERNEL_CACHE_DAMAGED: "nothing to do: they are compiled again",
        D.KERNELS_NOT_COMPILED: (
            "correct the permissions of the folder that the text names, or set `NUMBA_CACHE_DIR` to another one"
        ),
    },
}
"""Group -> code -> likely cause and remedy, Markdown. Each code once, in the order of the page."""

DOCTOR_ONLY: Final = frozenset(
    {
        D.SERVICE_UNREACHABLE,
        D.NOT_A_LIVE_CAMERA,
        D.CAMERA_FEW_MEASURED,
        D.INTRINSICS_DIFFER,
        D.PARAMETERS_UNKNOWN,
        D.PARAMETERS_NOT_WRITTEN,
        D.LOG_NOT_WRITABLE,
        D.DISK_LOW,
        D.SHARE_NOT_AUTHENTICATED,
        D.KERNEL_CACHE_DAMAGED,
        D.KERNELS_NOT_COMPILED,
    }
)
"""Codes that the service does not report."""


Rows = Iterator[tuple[str, ...]]


def diagnostics(group: str) -> Rows:
    """Code, meaning, likely cause and remedy of the diagnostics of a group."""
    for code, remedy in REMEDIES[group].items():
        yield f"`{code}`", code.text + (" (`doctor` only)" if code in DOCTOR_ONLY else ""), remedy


def causes() -> Rows:
    """Code, number and meaning of the causes of an invalid frame."""
    kinds: tuple[type[Code], ...] = (InvalidCause, DropCause)
    camera = "no frame of the camera can be used; `cause_text` says why (live streams only)"
    for code, text in [*((code, code.text) for kind in kinds for code in kind if code), ("camera", camera)]:
        yield f"`{code}`", str(pb.Cause.Value(f"CAUSE_{code.upper()}")), text


def offsets() -> Rows:
    """Code, number and meaning of the states of a measured exposure time offset."""
    for state, text in STATE_TEXTS.items():
        yield f"`{state}`", str(pb.ExposureOffset.State.Value(f"STATE_{state.name}")), text


def anomalies() -> Rows:
    """Code of each anomaly of the link, and what it counts."""
    for code in LinkAnomaly:
        yield f"`{code}`", code.text


def metrics() -> Rows:
    """Name, labels and meaning of each metric."""
    for name, _kind, meaning, samples in families(_full_report()):
        yield f"`{name}`", ", ".join(f"`{label}`" for label in samples[0][0]), meaning


def _full_report() -> pb.Health:
    """A report in which each metric has a sample."""
    report = pb.Health(frames_dropped={"no_attitude": 1})
    report.diagnostics.add(code="link_closed")
    report.cameras.add(camera="front", age_ns=1).exposure_offset.offset_ms = 1.0
    report.autopilot.autopilot = "PX4"
    report.autopilot.attitude_age_ns = 1
    report.autopilot.clock.bound_ns = 1
    report.autopilot.counts["unsigned"] = 1
    report.latencies.add(stage="extract")
    report.temperatures.add(sensor="cpu")
    return report
