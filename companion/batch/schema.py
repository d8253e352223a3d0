"""The tables of a dataset and their columns, documented in docs/reference/batch.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

SCHEMA_VERSION: Final = 1
"""Changes with every column that is removed or changes its meaning; new columns do not change it."""


@dataclass(frozen=True, slots=True)
class ColumnType:
    """A column."""

    name: str
    kind: str  # name of a pyarrow type
    doc: str  # its meaning


def _columns(text: str) -> tuple[ColumnType, ...]:
    """One column for each line: name, type, meaning."""
    rows = (line.split(maxsplit=2) for line in text.strip().splitlines())
    return tuple(ColumnType(*row) for row in rows)


TABLES: Final[dict[str, tuple[ColumnType, ...]]] = {
    "frames": _columns("""
        flight string name of the flight
        file int32 its number in `flights.files`, from 0
        camera string name of the camera
        sequence int64 number of the frame
        t_exposure_ns int64 middle of the exposure, monotonic clock of the vehicle
        valid bool false: no information
        cause string why not (code), empty where valid
        armed bool by the newest health report; null before the first
        frame string frame of the coordinates: ned or level
        planes int32 number of planes
        prisms int32 number of prisms
        nearest_m float distance in space from the camera to the nearest plane, without its margin; null: no plane
        free_share float share of the directions that are free for 1 m at the camera's height
        measured_share float share of measured pixels
        noise_per_m float `ke_per_m` of the message: the standard deviation of a depth Z is noise_per_m * Z^2
        ground_seen bool whether ground was found
        ground_height_m float height of the camera above it; null: not found
        attitude string source of the attitude: none, exact, interpolated, extrapolated
        attitude_distance_ms float to the nearest attitude sample; null: no attitude
        north_m double position; null: no position
        east_m double position
        down_m double position
        camera_latency_ms float exposure to arrival on board
        publish_latency_ms float exposure to publication, 95th percentile by the newest health report; null before the first
        digest string begin of the SHA-256 of the encoded result, 16 hexadecimal digits
        onboard_digest string the same of the result in the log; null: not in the log
        equals_onboard bool whether both are equal, bit for bit; null: not in the log
        """),
    "flights": _columns("""
        flight string name of the flight
        files strings its log files in order
        bytes int64 size of the log files
        software string version that computed these results
        config_hash string begin of the SHA-256 of the configuration in use
        onboard_software string version in the log; null: not in the log
        onboard_config_hash string configuration in the log; null: not in the log
        cameras strings names of the cameras
        begin_ns int64 first exposure; null: no frame
        duration_s double first to last exposure
        armed_s double armed time, by its health reports
        frames int64 frames with a result
        valid int64 valid frames among them
        blind_s double from an invalid frame to the next valid one, summed over the cameras
        planes int64 number of planes in all frames
        nearest_m float smallest nearest_m; null: no plane
        compared int64 frames with a result in the log
        different int64 compared frames whose result differs
        equals_onboard bool whether all compared frames are equal, bit for bit; null: none was compared
        first_difference string first differing field; null: none
        missing_onboard int64 computed frames without a result in the log
        without_depth int64 results in the log without a depth image
        skipped_live int64 frames that the live run skipped; they are not computed
        events int64 number of events
        damage string damaged or unreadable files, with the position; recovered files with what they lack, and files of another run; null: none
        unread_files int32 files of which nothing can be read; the results lack them
        """),
    "events": _columns("""
        flight string name of the flight
        file int32 number of the file in which it begins
        kind string blind, recovered, near_pass, obstacle_report
        camera string name of the camera; empty for obstacle_report
        t_ns int64 begin, monotonic clock of the vehicle
        end_ns int64 end; null: it lasts to the end of the log
        duration_s double end minus begin, or to the last frame of the camera
        armed bool at the begin; null: not known
        cause string blind: code of the first invalid frame; otherwise empty
        distance_m float near_pass: smallest distance; obstacle_report: nearest distance sent, null: none
        frames int64 number of frames in it
        """),
    "planes": _columns("""
        flight string name of the flight
        camera string name of the camera
        sequence int64 number of the frame
        t_exposure_ns int64 middle of the exposure
        plane int32 number in the frame
        a_x_m float first corner, in `frames.frame`
        a_y_m float first corner
        b_x_m float second corner
        b_y_m float second corner
        top_m float upper edge, z down
        bottom_m float lower edge, z down
        margin_m float subtract it from the free space in front of the plane
        support_px int32 number of source pixels
        flags int32 bits as in the message
        cluster int32 obstacle it belongs to; -1: none
        """),
}
"""Table -> columns. vehicle and date are the partitions, and no columns of the files."""
