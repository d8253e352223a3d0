"""`companion ros2`: publishes the results of the running service to ROS 2 (rmw_zenoh), without a ROS installation.

It runs in a process of its own and subscribes like a planner: it cannot disturb the service."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from ..config.loader import load_config
from ..config.service import PublishConfig
from ..console import fail, print_line, warn
from ..viewer.live_server import NICE, streams_of
from ..viewer.subscriber import HEALTH_OLD_NS, LiveSubscriber
from .bridge import BridgeOptions, Ros2Bridge
from .message_types import RosMessages
from .occupied import spacing_or_error
from .session import RosNode
from .wire import absolute_name

TICK_S: Final = 0.1
RETRY_S: Final = 2.0
"""Interval of the attempts to connect to the router."""
NODE: Final = "companion"


def add_parser(subparsers: Any) -> None:
    """The command line of `companion ros2`."""
    parser = subparsers.add_parser("ros2", help="publish the results of the running service to ROS 2")
    parser.add_argument(
        "-c", "--config", type=Path, metavar="FILE", help="configuration of the service, where it publishes elsewhere"
    )
    parser.add_argument(
        "--keys", type=Path, metavar="DIR", help="directory of the client keys, for streams of another computer"
    )
    parser.add_argument(
        "--router", default="tcp/localhost:7447", metavar="ENDPOINT", help="Zenoh router (tcp/localhost:7447)"
    )
    parser.add_argument(
        "--domain", type=int, metavar="N", help="ROS domain (the environment variable ROS_DOMAIN_ID, otherwise 0)"
    )
    parser.add_argument("--namespace", default="/osape", metavar="NAME", help="namespace of the topics (/osape)")
    parser.add_argument("--hz", type=float, default=10.0, metavar="N", help="largest rate of each camera (10)")
    parser.add_argument("--spacing", default="0.2", metavar="M", help="distance of the points of a cloud (0.2 m)")
    parser.add_argument("--no-tf", action="store_true", help="do not publish /tf, where another node does")


def run(args: argparse.Namespace) -> int:
    """Publishes until it is stopped. 1: the subscriber ended; 2: wrong usage."""
    try:
        options = _options(args)
        domain = _domain(args.domain)
    except ValueError as error:
        fail(str(error))
        return 2
    publish = PublishConfig() if args.config is None else load_config(args.config).publish
    ros = RosMessages()
    node = RosNode(ros, args.router, domain, options.namespace, NODE)
    subscriber = LiveSubscriber(replace(streams_of(publish, args.keys), depth="", world="", world_requests=""))
    bridge = Ros2Bridge(subscriber, node, ros, options)
    subscriber.on_message = bridge.on_message
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    os.nice(NICE)  # the service has precedence
    print_line(f"topics {options.namespace}/markers, {options.namespace}/CAMERA/points, /diagnostics"
               f"{', /tf' if options.transforms else ''} of domain {domain} (stop with Ctrl-C)")  # fmt: skip
    sys.stdout.flush()
    try:
        subscriber.open()
        return _publish(bridge, node, stop)
    finally:
        subscriber.on_message = None
        node.close()
        subscriber.close()


def _publish(bridge: Ros2Bridge, node: RosNode, stop: threading.Event) -> int:
    """Connects, and reports each change of the connections on the terminal."""
    router = silence = "-"  # unknown: the first state is reported too
    connected_ns = 0
    while not stop.wait(TICK_S):
        now_ns = time.monotonic_ns()
        if not bridge.subscriber.running:
            fail("the subscriber has ended; its error is printed above. Restart the command")
            return 1
        if now_ns >= connected_ns:
            router = _report("the Zenoh router is connected", node.connect(), router)
            connected_ns = time.monotonic_ns() + round(RETRY_S * 1e9)
        problem = bridge.tick(now_ns)
        if not problem or now_ns - bridge.subscriber.begun_ns > HEALTH_OLD_NS:
            silence = _report("the service is received", problem, silence)
    return 0


def _report(good: str, problem: str, before: str) -> str:
    """Prints a state that differs from the one before. Returns it."""
    if problem != before:
        if problem:
            warn(f"{problem}; retrying")
        else:
            print_line(good)
            sys.stdout.flush()
    return problem


def _options(args: argparse.Namespace) -> BridgeOptions:
    """Raises ValueError for values out of range."""
    if not 0.1 <= args.hz <= 60.0:
        raise ValueError(f"--hz {args.hz:g}: expected 0.1 to 60")
    try:
        spacing_m = spacing_or_error(args.spacing)
    except ValueError as error:
        raise ValueError(f"--spacing {error}") from error
    return BridgeOptions(
        namespace=absolute_name(args.namespace), hz=args.hz, spacing_m=spacing_m, transforms=not args.no_tf
    )


def _domain(number: int | None) -> int:
    """The ROS domain. Raises ValueError for one out of range."""
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if number is None and not text.isdecimal():
        raise ValueError(f"ROS_DOMAIN_ID={text}: expected a number from 0 to 232")
    domain = int(text) if number is None else number
    if not 0 <= domain <= 232:
        raise ValueError(f"ROS domain {domain}: expected 0 to 232")
    return domain
