"""Camera processes with habits, and their supervisor."""

from __future__ import annotations

import textwrap

CAMERA = textwrap.dedent("""
    import json, os, sys, time
    from dataclasses import asdict
    import numpy as np
    from core.types import CameraInfo, DepthFrame, Intrinsics
    from drivers.base import DeviceLost
    from drivers.cameras.frame_channel import FrameWriter

    writer = FrameWriter(int(sys.argv[2]), "front")
    habit, times = sys.argv[1].split(":")
    rng = np.random.default_rng(0)
    info = CameraInfo("front", Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0))
    notice = "the rows differ" if habit == "misaligned" and not os.path.exists("was_open") else ""
    exchanged = habit == "exchanged" and os.path.exists("is_exchanged")
    identity = "serial 2" if exchanged else "serial 1" if habit in ("exchanged", "nameless") else ""
    if habit == "nameless" and os.path.exists("is_nameless"):
        identity = ""
    writer.send("opened", info=asdict(info), notice=notice, identity=identity)
    depth = np.full((48, 64), 3000, np.uint16)
    for k in range(1 << 30):
        after = k >= int(times)
        if habit == "twice" and k % 2 or habit == "frozen" and after or habit == "stands":
            pass  # the image before
        else:
            depth = rng.integers(2000, 3000, (48, 64)).astype(np.uint16)
        if after and habit == "ends":
            writer.send("failed", cause="the cable is out")
            sys.exit(1)
        if after and habit == "fails":
            writer.send("failed", cause="the cable is out")
            time.sleep(1000)
        if after and habit == "exits":
            os._exit(7)
        if after and habit == "hangs":
            time.sleep(1000)
        now = time.monotonic_ns()
        if after and habit == "silent":
            writer.send("alive")
        else:
            try:
                stamp = 5 if after and habit == "stuck" else now
                writer.write(DepthFrame(camera="front", sequence=k, t_exposure_ns=stamp, t_arrival_ns=now, depth_mm=depth))
            except DeviceLost:
                sys.exit(1)
        time.sleep(0.01)
""")
