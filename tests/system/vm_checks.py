"""Runs in the virtual machine, as root, under its systemd: one finding a line, behind a mark, on the console.

Times are systemd's own stamps, microseconds of CLOCK_MONOTONIC, so that asking costs nothing of what is measured."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

NAME = "osape-companion"
HOME = Path("/opt/osape-companion")
COMPANION = str(HOME / "bin" / "companion")
CONFIG = """
[[camera]]
name = "front"
kind = "v4l2"
device = "/dev/v4l/by-id/usb-not-plugged-in"
width_px = 640
height_px = 480
fx_px = 383.0
fy_px = 383.0
cx_px = 320.0
cy_px = 240.0
[autopilot]
address = "serial:/dev/serial/by-id/usb-not-plugged-in:921600"
"""
CAMERA = """
import json, os, select, time
from core.types import Intrinsics
from drivers.base import DeviceLost, DeviceNotFound
from drivers.cameras.kernel_capture import LinuxpyCapture
from drivers.cameras.pair_video import DeviceVideo, pair_format
from drivers.cameras.v4l2_depth import V4l2Settings, V4l2Source

WIDTH, HEIGHT, FPS, WANTED = 320, 180, 10.0, 12
from linuxpy.video.device import Device
with Device("/dev/video0") as device:  # else it stamps with the end of the frame, before that is
    device.controls["timestamp_source"].value = 1
video = DeviceVideo(pair_format("front", "/dev/video0", (320, 360), FPS))  # of both eyes, as a ZED sends them
image, stamp_ns = video.read(60.0)
pair = dict(pair_shape=image.shape, pair_age_ms=(time.monotonic_ns() - stamp_ns) / 1e6, pair_levels=len(set(image.ravel().tolist())))
video.close()
capture = LinuxpyCapture(pair_format("front", "/dev/video0", (320, 360), FPS))
with Device("/dev/video0") as device:
    device.controls["inject_v4l2_buf_flag_error"].push()
pair["faulty_marked"] = False
end_s = time.monotonic() + 60.0
while not pair["faulty_marked"] and time.monotonic() < end_s:
    select.select([capture], [], [], 5.0)
    pair["faulty_marked"] = capture.read().faulty
try:
    DeviceVideo(pair_format("front", "/dev/video0", (320, 360), FPS))
except DeviceNotFound as error:
    pair["busy"] = str(error)
capture.close()
intrinsics = Intrinsics(WIDTH, HEIGHT, 190.0, 190.0, 160.0, 90.0)
settings = V4l2Settings(camera="front", device="/dev/video0", intrinsics=intrinsics, fps=FPS, pixel_format="Y16 ")
source = V4l2Source(settings)
source.open()
frames = []
end_s = time.monotonic() + 60.0
while len(frames) < WANTED and time.monotonic() < end_s:
    frame = source.read(1.0)
    if frame is not None:
        frames.append(frame)
stamps = [f.t_exposure_ns for f in frames]
found = dict(
    **pair,
    camera_frames=len(frames), camera_shape=frames[0].depth_mm.shape, camera_type=str(frames[0].depth_mm.dtype),
    camera_levels=len(set(frames[0].depth_mm.ravel().tolist())),
    camera_stamps_rise=all(a < b for a, b in zip(stamps, stamps[1:])),
    camera_sequences_rise=all(a.sequence < b.sequence for a, b in zip(frames, frames[1:])),
    camera_oldest_ms=max((f.t_arrival_ns - f.t_exposure_ns) / 1e6 for f in frames),
)
with open("/sys/bus/platform/drivers/vivid/unbind", "w") as unbind:
    unbind.write("vivid.0")
try:
    end_s = time.monotonic() + 10.0
    while time.monotonic() < end_s:
        source.read(0.5)
except DeviceLost as error:
    found["camera_unplugged"] = str(error)
source.close()
source.close()
found["camera_held"] = open("/proc/self/maps").read().count("/dev/video")
try:
    V4l2Source(settings).open()
except DeviceNotFound as error:
    found["camera_gone"] = str(error)
print(json.dumps(found))
"""
PATIENCE_S = 300.0


def tell(**found: Any) -> None:
    with open("/dev/ttyS0", "w") as console:
        console.write("\n@@RESULT " + json.dumps(found) + "\n")


def ran(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)


def unit(*names: str) -> dict[str, str]:
    out = ran("systemctl", "show", NAME, *(f"--property={n}" for n in names)).stdout
    return dict(line.split("=", 1) for line in out.splitlines() if "=" in line)


def wait(condition: Callable[[], bool]) -> bool:
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.05)
    return True


def pid() -> int:
    return int(unit("MainPID")["MainPID"])


def ready_again(restarts: int) -> bool:
    state = unit("ActiveState", "NRestarts")
    return state["ActiveState"] == "active" and int(state["NRestarts"]) == restarts


def seconds_since(us: int) -> float:
    return round((int(unit("ActiveEnterTimestampMonotonic")["ActiveEnterTimestampMonotonic"]) - us) / 1e6, 2)


def now_us() -> int:
    return time.monotonic_ns() // 1000


def install() -> None:
    config = Path("/run/service.toml")
    config.write_text(CONFIG)
    ran("systemd-sysusers", str(HOME / "share/osape-companion/systemd/osape-companion.sysusers"))
    begun_us = now_us()
    done = ran(COMPANION, "install", "-c", str(config))
    tell(
        install_status=done.returncode,
        install_output=done.stdout[-3000:] + done.stderr[-2000:],
        install_s=round((now_us() - begun_us) / 1e6, 1),
    )
    if done.returncode != 0:
        raise ValueError("not installed")
    again = ran(COMPANION, "install", "--dry-run")
    would = [line for line in again.stdout.splitlines() if line.startswith("would")]
    tell(install_again_would=would)


def first_start() -> None:
    tell(ready=wait(lambda: ready_again(0)), start_to_ready_s=start_to_ready_s())
    status = Path(f"/proc/{pid()}/status").read_text()
    words = {line.split(":")[0]: line.split(":")[1].split() for line in status.splitlines()}
    tell(uid=int(words["Uid"][0]), capabilities=words["CapBnd"][0], no_new_privileges=words["NoNewPrivs"][0])
    time.sleep(5.0)  # two watchdogs long: waiting for a camera and an autopilot is living
    report = ran(COMPANION, "status")
    tell(status=report.returncode, status_output=report.stdout + report.stderr, **unit("NRestarts", "StatusText"))


def start_to_ready_s() -> float:
    return seconds_since(int(unit("ExecMainStartTimestampMonotonic")["ExecMainStartTimestampMonotonic"]))


def killed() -> None:
    begun_us = now_us()
    os.kill(pid(), signal.SIGKILL)
    tell(killed_ready=wait(lambda: ready_again(1)), killed_to_ready_s=seconds_since(begun_us))


def hung() -> None:
    process = pid()
    begun_us = now_us()
    os.kill(process, signal.SIGSTOP)
    gone = wait(lambda: not Path(f"/proc/{process}").exists())
    gone_s = round((now_us() - begun_us) / 1e6, 2)
    tell(hung_ended=gone, hung_to_end_s=gone_s, hung_ready=wait(lambda: ready_again(2)))
    tell(hung_to_ready_s=seconds_since(begun_us))
    journal = ran("journalctl", "-u", NAME, "-o", "cat", "--no-pager").stdout
    tell(stacks="most recent call first" in journal, watchdog_named="Watchdog timeout" in journal)


def stopped() -> None:
    begun_us = now_us()
    done = ran("systemctl", "stop", NAME)
    tell(stop_status=done.returncode, stop_s=round((now_us() - begun_us) / 1e6, 2), **unit("Result", "ActiveState"))
    left = ran("pgrep", "-u", NAME).stdout.split()
    tell(left_processes=left)


def camera() -> None:
    """A video device of the kernel's own making: Y16 stands in for Z16, the bytes are the same. Then it is unplugged."""
    for module in Path("/opt/modules/device-order").read_text().split():
        options = ["n_devs=1", "node_types=0x1"] if module == "vivid.ko" else []
        ran("insmod", f"/opt/modules/{module}", *options)
    wait(lambda: Path("/dev/video0").exists())
    done = ran(str(HOME / "bin" / "python3"), "-c", CAMERA)
    lines = done.stdout.strip().splitlines()
    tell(camera_output=done.stderr[-2000:], **(json.loads(lines[-1]) if lines else {}))


def uninstalled() -> None:
    logs = Path(f"/var/lib/{NAME}/logs")
    logs.mkdir(exist_ok=True)
    (logs / "flight.mcap").write_text("a flight")
    done = ran(COMPANION, "uninstall")
    tell(uninstall_status=done.returncode, uninstall_output=done.stdout[-2000:] + done.stderr[-2000:])
    tell(unit_left=unit("LoadState")["LoadState"], logs_left=(logs / "flight.mcap").exists())
    purged = ran(COMPANION, "uninstall", "--purge")
    tell(purge_status=purged.returncode, purge_left=[str(p) for p in (logs, Path(f"/etc/{NAME}")) if p.exists()])


def main() -> None:
    for check in (install, first_start, killed, hung, stopped, camera, uninstalled):
        try:
            check()
        except (OSError, KeyError, ValueError, IndexError) as error:
            tell(**{f"{check.__name__}_failed": repr(error)})
            break  # what follows would only wait for what cannot come
    journal = ran("journalctl", "-u", NAME, "-o", "short-monotonic", "--no-pager").stdout
    tell(journal=journal[-6000:])
    ran("systemctl", "poweroff", "-f", "-f")


main()
