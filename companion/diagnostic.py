"""Codes of faults, and the diagnostic that reports one."""

from __future__ import annotations

from dataclasses import dataclass

from core.codes import Code
from osape_client.proto import osape_v1_pb2 as pb


class DiagnosticCode(Code):
    """The codes of `osape.v1.Diagnostic` and their meaning. tests/companion/diagnostic_tables.py has the remedies for
    docs/reference/diagnostics.md."""

    STARTING = "starting", "the service is starting; nothing is detected yet"
    THREAD_STALLED = "thread_stalled", "a thread of the service has ended or does not respond"
    SERVICE_UNREACHABLE = "service_unreachable", "a service runs, but does not answer or refuses access"
    RESEARCH_MODE = "research_mode", "the extractor runs in a mode that is not for flight (earlier versions only)"
    # cameras
    NO_CAMERA_CONFIGURED = "no_camera_configured", "the configuration has no camera"
    NOT_A_LIVE_CAMERA = "not_a_live_camera", "the camera's kind is for recordings"
    CAMERA_UNAVAILABLE = "camera_unavailable", "a required camera gives no usable frame"
    OPTIONAL_CAMERA_UNAVAILABLE = "optional_camera_unavailable", "a camera that is not required gives no usable frame"
    CAMERA_FEW_MEASURED = "camera_few_measured", "almost no pixel of the camera holds a measurement"
    CAMERA_RATE_LOW = "camera_rate_low", "the camera's frame rate is below the configured one"
    CAMERA_MISALIGNED = (
        "camera_misaligned",
        "the rows of a stereo camera's images differ; its calibration is inaccurate",
    )
    TEMPLATE_INTRINSICS = "template_intrinsics", "the intrinsics are those of the shipped configuration"
    INTRINSICS_DIFFER = (
        "intrinsics_differ",
        "the configured intrinsics or calibration file are not those of the connected camera",
    )
    EXPOSURE_TIME_OFFSET = "exposure_time_offset", "the exposure stamps do not fit the attitude"
    # mount and ground
    MOUNT_ERROR = "mount_error", "the mount differs from its configuration; frames are invalid"
    MOUNT_DEGRADED = "mount_degraded", "the mount differs from its configuration; frames are valid"
    MOUNT_UNVERIFIED = (
        "mount_unverified",
        "the ground appears inclined, by terrain or by a wrong mount; frames are invalid",
    )
    MOUNT_YAW_ERROR = "mount_yaw_error", "the direction of motion in the images does not fit the velocity"
    GROUND_SLOPE_LIMIT = "ground_slope_limit", "the slope of the ground is at its configured limit"
    GROUND_LOST = "ground_lost", "no ground is found though most pixels are measured"
    GROUND_NEVER_SEEN = "ground_never_seen", "no ground was found since the camera started"
    # link to the autopilot
    NO_AUTOPILOT_CONFIGURED = "no_autopilot_configured", "the configuration has no autopilot"
    LINK_CLOSED = "link_closed", "the link to the autopilot is not open"
    LINK_SLOW = "link_slow", "the link to the autopilot is too slow for its messages"
    UDP_FLOOD = "udp_flood", "datagrams of other senders are dropped because there are too many"
    SIGNING_FAULT = "signing_fault", "message signing does not work, or differs between the two ends"
    DUPLICATE_AUTOPILOT = (
        "duplicate_autopilot",
        "contradictory heartbeats, timestamps or attitudes: two senders use the autopilot's ids",
    )
    SEVERAL_VEHICLES = "several_vehicles", "autopilots of several system ids are received and none is configured"
    DUPLICATE_OBSTACLE_SOURCE = "duplicate_obstacle_source", "another component sends obstacles to the autopilot"
    DUPLICATE_COMPONENT = "duplicate_component", "another sender uses the companion's ids"
    SYSTEM_ID_MISMATCH = (
        "system_id_mismatch",
        "only an autopilot with another system id than the configured one is received",
    )
    NO_HEARTBEAT = "no_heartbeat", "no heartbeat of an autopilot is received"
    ATTITUDE_STALE = "attitude_stale", "the newest attitude is too old, or none was received"
    ATTITUDE_REPEATED = (
        "attitude_repeated",
        "the autopilot's attitude repeats an earlier one with new timestamps; it is not used",
    )
    ATTITUDE_RATE_LOW = "attitude_rate_low", "the attitude arrives too rarely"
    NO_TIMESYNC = "no_timesync", "the autopilot does not answer TIMESYNC"
    CLOCK_UNCERTAIN = "clock_uncertain", "the error bound of the autopilot's timestamps is large"
    AUTOPILOT_SAMPLES_LOST = "autopilot_samples_lost", "attitudes or positions were lost before they were processed"
    # obstacles for the autopilot
    AVOIDANCE_FAULT = "avoidance_fault", "the distances for the autopilot cannot be computed"
    OBSTACLES_NOT_ACCEPTED = "obstacles_not_accepted", "the autopilot does not use the obstacles that are sent"
    FLIGHT_MODE_UNPROTECTED = "flight_mode_unprotected", "the vehicle does not stop before obstacles in its flight mode"
    PARAMETERS_UNKNOWN = "parameters_unknown", "no parameter of the autopilot could be read"
    PARAMETER_ADVICE = (
        "parameter_advice",
        "a parameter of the autopilot is unknown or keeps it from braking as expected",
    )
    PARAMETER_CONTRADICTION = "parameter_contradiction", "contradictory values of a parameter are received"
    PARAMETERS_NOT_WRITTEN = "parameters_not_written", "parameters of the autopilot could not be written"
    AVOID_MARGIN_UNKNOWN = "avoid_margin_unknown", "AVOID_MARGIN is not known"
    NEVER_CLEAR = "never_clear", "the sector straight ahead of a camera can never be clear"
    # guard
    GUARD_UNAVAILABLE = "guard_unavailable", "the guard is on and cannot stop the vehicle in its flight mode"
    GUARD_INTERVENES = "guard_intervenes", "the guard limits the speed, or stops or has stopped the vehicle"
    GUARD_FAULT = "guard_fault", "the thread of the guard has ended"
    # other parts of the service and the machine
    RECORDING_FAULT = "recording_fault", "the log is not written, or not completely"
    LOG_NOT_WRITABLE = "log_not_writable", "the log directory cannot be written"
    DISK_LOW = "disk_low", "the disk of the log directory is almost full"
    METRICS_FAULT = "metrics_fault", "the metrics server does not run"
    DEPTH_PREVIEW_FAULT = "depth_preview_fault", "the depth images for viewers are not published"
    SIGNATURE_CLOCK_FAULT = "signature_clock_fault", "the timestamps of signatures are not saved"
    KEY_CHECK_FAULT = "key_check_fault", "the check of subscribers' keys has ended; new subscribers are refused"
    WORLD_FAULT = "world_fault", "the thread of the merged world has ended"
    WORLD_STALLED = "world_stalled", "the merged world is not updated"
    SHARE_FAULT = "share_fault", "the thread that shares obstacles with other vehicles has ended or stalled"
    SHARE_LINK_CLOSED = "share_link_closed", "a link to other vehicles is not open"
    SHARE_NO_FRAME = "share_no_frame", "the place of the own frame on Earth is not known, so nothing is shared"
    SHARE_NOT_AUTHENTICATED = "share_not_authenticated", "reports of other vehicles are accepted without authentication"
    KERNEL_CACHE_DAMAGED = "kernel_cache_damaged", "damaged files of the kernel cache were deleted"
    KERNELS_NOT_COMPILED = (
        "kernels_not_compiled",
        "kernels are missing and cannot be stored: each start compiles them again",
    )


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One fault."""

    code: DiagnosticCode
    camera: str  # empty unless the fault concerns one camera
    text: str  # observation, likely cause and remedy

    def line(self) -> str:
        """Code and text in one line."""
        return f"{self.code}: {self.text}"

    def message(self) -> pb.Diagnostic:
        """The message for the health report."""
        return pb.Diagnostic(
            code=self.code.value, camera=self.camera, text=self.text, code_enum=f"CODE_{self.code.name}"
        )


def without_digits(text: str) -> str:
    """A text without its digits: texts of one cause differ in their numbers."""
    return "".join(c for c in text if not c.isdigit())
