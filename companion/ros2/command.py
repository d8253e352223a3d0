"""`companion ros2`: publishes the results of the running service to ROS 2 (rmw_zenoh), without a ROS installation.

It runs in a process of its own and subscribes like a planner: it cannot disturb the service."""

from __future__ import annotations

import argparse
import os
import sys
import threading
from dataclasses import replace
from typing import Any, Final

from osape_client.clock import clock_ns

from ..argument_types import number_in
from ..common_options import add_keys, add_service
from ..config.loader import load_config
from ..config.service import PublishConfig
from ..console import fail, print_line, warn
from ..stop_signal import stop_event
from ..usage_error import UsageError
from ..viewer.subscriber import HEALTH_OLD_NS, NICE, LiveSubscriber, streams_of
from .bridge import BridgeOptions, Ros2Bridge
from .message_types import RosMessages
from .session import RosNode
from .wire import absolute_name

TICK_S: Final = 0.1
RETRY_S: Final = 2.0
"""Interval of the attempts to connect to the router."""
NODE: Final = "companion"


def add_parser(subparsers: Any) -> None:
    """The command line of `companion ros2`."""
    parser = subparsers.add_parser("ros2")
    add_service(parser)
    add_keys(parser)
    parser.add_argument(
        "--router",
        default="tcp/localhost:7447",
        metavar="ENDPOINT",
        help="address of the Zenoh router (default: tcp/localhost:7447)",
    )
    parser.add_argument(
        "--domain",
        type=number_in(int, 0, 232),
        metavar="N",
        help="ROS domain (default: the environment variable ROS_DOMAIN_ID, otherwise 0)",
    )
    parser.add_argument(
        "--namespace",
        default="/osape",
        metavar="NAME",
        help="namespace of topics and node; give each vehicle its own (default: /osape)",
    )
    parser.add_argument(
        "--hz",
        type=number_in(float, 0.1, 60.0),
        default=10.0,
        metavar="N",
        help="largest rate of each camera in Hz (default: 10)",
    )
    parser.add_argument(
        "--spacing",
        type=number_in(float, 0.02, 5.0),
        default=0.2,
        metavar="M",
        help="largest distance of neighbouring points of a cloud (default: 0.2 m)",
    )
    parser.add_argument(
        "--no-tf", action="store_true", help="do not publish /tf; for systems in which another node does"
    )


def run(args: argparse.Namespace) -> int:
    """Publishes until it is stopped. 1: the subscriber ended. Raises UsageError."""
    try:
        options = BridgeOptions(
            namespace=absolute_name(args.namespace), hz=args.hz, spacing_m=args.spacing, transforms=not args.no_tf
        )
        domain = _environment_domain() if args.domain is None else args.domain
        router = _endpoint(args.router)
    except ValueError as error:
        raise UsageError(str(error)) from error
    publish = PublishConfig() if args.config is None else load_config(args.config).publish
    ros = RosMessages()
    node = RosNode(ros, router, domain, options.namespace, NODE)
    subscriber = LiveSubscriber(replace(streams_of(publish, args.keys), depth="", world="", world_requests=""))
    bridge = Ros2Bridge(subscriber, node, ros, options)
    subscriber.on_message = bridge.on_message
    stop = stop_event()
    os.nice(NICE)
    print_line(
        f"topics {options.namespace}/markers, {options.namespace}/CAMERA/points, /diagnostics"
        f"{', /tf' if options.transforms else ''} of domain {domain} (stop with Ctrl-C)"
    )
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
    connected_ns, received_ns = 0, clock_ns()
    while not stop.wait(TICK_S):
        now_ns = clock_ns()
        if not bridge.subscriber.running:
            fail("the subscriber has ended; its error is printed above. Restart the command")
            return 1
        if now_ns >= connected_ns:
            router = _report("the Zenoh router is connected", node.connect(), router)
            connected_ns = clock_ns() + round(RETRY_S * 1e9)
        problem = bridge.tick(now_ns)
        received_ns = received_ns if problem else now_ns
        if not problem or now_ns - received_ns > HEALTH_OLD_NS:  # a short gap is on /diagnostics only
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


def _endpoint(text: str) -> str:
    """A Zenoh endpoint. Raises ValueError for one without a protocol or an address."""
    protocol, _, address = text.partition("/")
    if not (protocol.isalpha() and address):
        raise ValueError(f"--router {text}: expected PROTOCOL/ADDRESS, such as tcp/192.168.1.20:7447")
    return text


def _environment_domain() -> int:
    """The ROS domain of the environment. Raises ValueError for one that ROS does not have."""
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (text.isascii() and text.isdigit() and int(text) <= 232):
        raise ValueError(f"ROS_DOMAIN_ID={text}: expected 0 to 232")
    return int(text)
