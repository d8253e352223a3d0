"""`companion import` of ROS 2 recordings with wrong stamps, units or encodings, which must not pass as good ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.cli import main

from ..ros2_recording import NS, START_NS, RosFlight, header

Entry = tuple[int, str, str, dict[str, Any]]


def imported(tmp_path: Path, flight: RosFlight, change: Callable[[list[Entry]], object], capsys) -> tuple[int, str]:
    """(status, stderr) of an import of the flight after a change of its messages."""
    entries = flight.entries()
    change(entries)
    path = flight.write_entries(tmp_path / "in.mcap", entries)
    status = main(["import", str(path), "-o", str(tmp_path / "out.mcap")])
    return status, capsys.readouterr().err


def images(entries: list[Entry]) -> list[dict[str, Any]]:
    return [message for _, _, kind, message in entries if kind.endswith("/Image")]


@pytest.mark.parametrize("encoding", ["8UC1", "64FC1", "bgr8"])
def test_an_encoding_that_is_no_depth_is_named(tmp_path, capsys, encoding):
    status, error = imported(tmp_path, RosFlight(encoding=encoding), lambda entries: None, capsys)
    assert status == 1
    assert f"/cam/depth/image ({encoding})" in error
    assert "16UC1" in error


@pytest.mark.parametrize(("encoding", "factor"), [("32FC1", 1000.0), ("16UC1", 0.001)])
def test_depth_in_the_wrong_unit_is_a_problem(tmp_path, capsys, encoding, factor):
    def change(entries: list[Entry]) -> None:
        kind = "<f4" if encoding == "32FC1" else "<u2"
        for message in images(entries):
            message["data"] = (np.frombuffer(message["data"], kind) * factor).astype(kind).tobytes()

    status, error = imported(tmp_path, RosFlight(encoding=encoding), change, capsys)
    assert status == 1
    assert "no pixels of the images are measured from 0.1 m to 65 m" in error
    assert "millimetres" in error


def test_stamps_that_do_not_increase_are_a_problem(tmp_path, capsys):
    """A replay drops such frames as duplicates, or out of order."""

    def change(entries: list[Entry]) -> None:
        found = images(entries)
        found[4]["header"] = found[3]["header"]
        found[7]["header"] = header(START_NS + NS // 10, "cam_optical")

    status, error = imported(tmp_path, RosFlight(), change, capsys)
    assert status == 1
    assert "2 images of /cam/depth/image have a stamp that is not later than one before" in error
    assert "the first is image 4" in error


def test_stamps_after_the_log_time_are_a_warning(tmp_path, capsys):
    """The camera's clock is then not that of the attitude, which is measured at another time than the image."""

    def change(entries: list[Entry]) -> None:
        for number, message in enumerate(images(entries)):
            message["header"] = header(START_NS + number * NS // 10 + NS // 2, "cam_optical")

    status, error = imported(tmp_path, RosFlight(), change, capsys)
    assert status == 0
    assert "stamped 0.47 s after their log time" in error
    assert "synchronise" in error


def test_images_of_a_usual_delay_are_no_warning(tmp_path, capsys):
    assert imported(tmp_path, RosFlight(), lambda entries: None, capsys) == (0, "")


@pytest.mark.parametrize(
    ("recorder_s", "attitude_delay_s"),
    [(-0.5, 0.0), (0.2, 0.0), (0.0, 0.2), (1000.0, 0.2)],
)
def test_a_recorder_with_another_clock_is_no_warning(tmp_path, capsys, recorder_s, attitude_delay_s):
    """Stamps of images and attitudes are of one clock, whatever the log times are (simulated time, another computer)."""

    def change(entries: list[Entry]) -> None:
        entries[:] = [
            (log_ns + round(NS * (recorder_s + attitude_delay_s * kind.endswith("/Odometry"))), topic, kind, message)
            for log_ns, topic, kind, message in entries
        ]

    assert imported(tmp_path, RosFlight(), change, capsys) == (0, "")


@pytest.mark.parametrize("row", range(8))
def test_a_sensor_that_measures_few_rows_is_no_problem(tmp_path, capsys, row):
    """Every eighth row was counted, and a good recording refused for its unit."""

    def change(entries: list[Entry]) -> None:
        for message in images(entries):
            depth_mm = np.frombuffer(message["data"], "<u2").reshape(message["height"], -1).copy()
            depth_mm[np.arange(len(depth_mm)) % 8 != row] = 0
            message["data"] = depth_mm.tobytes()

    assert imported(tmp_path, RosFlight(), change, capsys) == (0, "")


def test_a_recording_without_camera_info_says_what_to_record(tmp_path, capsys):
    def change(entries: list[Entry]) -> None:
        entries[:] = [entry for entry in entries if not entry[2].endswith("/CameraInfo")]

    status, error = imported(tmp_path, RosFlight(), change, capsys)
    assert status == 1
    assert "no camera info in it; record /cam/depth/camera_info" in error
    assert "--info-topic" not in error


def test_attitudes_that_cannot_be_used_are_named(tmp_path, capsys):
    def change(entries: list[Entry]) -> None:
        for _, _, kind, message in entries:
            if kind.endswith("/Odometry"):
                message["pose"]["pose"]["orientation"] = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}

    status, error = imported(tmp_path, RosFlight(), change, capsys)
    assert status == 1
    assert "the 100 messages of /odom have a position or an orientation that is not valid" in error
