"""Codes of messages that were not used as received."""

from __future__ import annotations

from core.codes import Code


class LinkAnomaly(Code):
    """Keys of `LinkStatus.counts`."""

    NOISE_BYTES = "noise_bytes", "bytes that belong to no message"
    UNKNOWN_MESSAGE = "unknown_message", "unknown messages"
    UNDECODABLE_MESSAGE = "undecodable_message", "messages that cannot be decoded"
    FLOOD_DROPPED = "flood_dropped", "datagrams dropped as a flood"
    STAMP_BEHIND = "stamp_behind", "timestamp far behind the others"
    STAMP_AFTER_ARRIVAL = "stamp_after_arrival", "timestamp after its arrival"
    ATTITUDE_NON_FINITE = "attitude_non_finite", "attitude is not a number"
    ATTITUDE_REPEATED = "attitude_repeated", "attitude of an earlier time with a new timestamp"
    POSITION_NON_FINITE = "position_non_finite", "position is not a number"
    POSITION_REPEATED = "position_repeated", "position of an earlier time with a new timestamp"
    ODOMETRY_UNUSABLE = "odometry_unusable", "odometry of another frame or failed"
    ODOMETRY_UNCONFIRMED = "odometry_unconfirmed", "odometry while no valid LOCAL_POSITION_NED is received"
    ODOMETRY_UNIX_TIME = "odometry_unix_time", "odometry with unix time"
    OTHER_VEHICLE = "other_vehicle", "heartbeats of other vehicles"
    LATE_HEARTBEAT = "late_heartbeat", "late copies of heartbeats"
    UNSENT_NO_AUTOPILOT = "unsent_no_autopilot", "messages not sent: no autopilot is received"
    TIMESYNC_UNPAIRED = "timesync_unpaired", "TIMESYNC answers that were not requested"
    UNSIGNED = "unsigned", "rejected: unsigned"
    SIGNATURE_WRONG_KEY = "signature_wrong_key", "rejected: signed with another key"
    SIGNATURE_REPLAYED = (
        "signature_replayed",
        "rejected: signed with the right key, but not newer than earlier messages",
    )
