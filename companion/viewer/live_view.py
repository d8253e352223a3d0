"""`companion view --live`: serves a page that follows the service, and on request Foxglove's viewer.

It runs in a process of its own at the lowest priority and subscribes like a planner. It serves this computer only,
unless --listen names another address. The page is read-only."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

from core.types import CameraInfo, Intrinsics
from osape_client.proto import osape_v1_pb2 as pb

from ..config.loader import load_config
from ..config.service import PublishConfig
from ..console import fail, print_line, warn
from ..pipeline.encode import SCHEMA_VERSION, prisms_from_message
from ..stop_signal import stop_event
from .live_page import LivePage
from .live_server import LOOPBACK, PORT, LiveServer, in_url, is_loopback
from .log import view_frame
from .page import frame_data
from .subscriber import NICE, LiveSubscriber, streams_of

if TYPE_CHECKING:
    from .foxglove_server import FoxgloveServer

TICK_S = 0.1


def follow(args: argparse.Namespace) -> int:
    """Serves the page until it is stopped. 0: by a signal; 1: no message is received any more."""
    listen = LOOPBACK if args.listen is None else args.listen
    subscriber = LiveSubscriber(streams_of(_publish(args), args.keys))
    server = LiveServer(LivePage(subscriber, "Live"), listen, PORT if args.port is None else args.port)
    foxglove: FoxgloveServer | None = None
    if args.foxglove is not None:
        from .foxglove_server import FoxgloveServer  # an optional package: imported only where requested

        foxglove = FoxgloveServer(subscriber, listen, args.foxglove)
    stop = stop_event()
    load_drawing()
    os.nice(NICE)
    with ExitStack() as stack:
        for part in (subscriber, server, foxglove):
            if part is not None:
                stack.callback(part.close)
                part.open()
        _announce(server, foxglove, listen)
        while not stop.wait(TICK_S):
            if not subscriber.running:
                fail("the subscriber has ended; its error is printed above. Restart the command")
                return 1
            if foxglove is not None:
                foxglove.tick()
    return 0


def load_drawing() -> None:
    """Draws an empty frame: imports the packages and loads the kernels that the first frame of a process needs.

    It needs 0.4 to 0.8 s of processor time. At a low priority on a computer with eight busy processes per core this takes
    37 s, in which a live page gets no response."""
    message = pb.PrismsFrame(schema_version=SCHEMA_VERSION, valid=True)
    message.stats.SetInParent()
    message.attitude.q_ned_frd.w = 1.0
    message.attitude.source = pb.AttitudeUsed.SOURCE_EXACT
    message.transform.yaw_rad = 0.0
    free = message.free
    free.azimuth_edges_rad.extend((0.0, 1.0))
    free.layer_edges_m.extend((0.0, 1.0))
    free.free_from_m.append(0.0)
    free.free_to_m.append(0.0)
    free.end = b"\0"
    info = CameraInfo("none", Intrinsics(width=16, height=16, fx=16.0, fy=16.0, cx=7.5, cy=7.5))
    frame_data(view_frame(prisms_from_message(message), info, None), 0, 0, 0)


def _publish(args: argparse.Namespace) -> PublishConfig:
    """The streams of the configuration, otherwise the usual ones of a service on this computer."""
    usual = PublishConfig(world="ipc://{run}/world", world_requests="ipc://{run}/world-snapshot")
    publish = usual if args.config is None else load_config(args.config).publish
    return replace(publish, depth="") if args.no_depth else publish


def _announce(server: LiveServer, foxglove: FoxgloveServer | None, listen: str) -> None:
    """Prints the addresses, and who can read them."""
    if not is_loopback(listen):
        warn(
            f"everyone who can connect to port {server.port} of this computer can see the camera images and the "
            "vehicle's position, unencrypted; for remote access use `ssh -L`"
        )
    shown = in_url(listen)
    print_line(f"page: http://{shown}:{server.port}/ (stop with Ctrl-C)")
    if foxglove is not None:
        print_line(f"Foxglove: ws://{shown}:{foxglove.port}")
        warn(
            f"any web page in a browser of this computer can read port {foxglove.port}: open no unknown page meanwhile"
        )
    sys.stdout.flush()
