"""`companion simulate-autopilot`: a simulated autopilot for the simulated cameras.

It reads the flight from the same file as `companion run`. Both compute the flight from the monotonic clock alone, so
that the attitude fits the images whichever of the two is started or restarted first."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from pathlib import Path
from typing import Any

from drivers.mavlink.address import parse_address
from drivers.mavlink.session_types import ARDUPILOT, PX4
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, Faults, PtyEnd, UdpEnd
from drivers.simulation.firmware_parameters import PARAMETERS
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flights import flight_plan
from drivers.simulation.looping_flight import LoopingFlight

from ..argument_types import checked_by, number_in
from ..common_options import add_config
from ..config.loader import Config, load_config
from ..console import print_json, print_line
from ..stop_signal import stop_event

EVERYWHERE = {"0.0.0.0": "127.0.0.1", "[::]": "::1"}


def flight_of(config: Config) -> LoopingFlight:
    """Returns the flight that the simulated cameras of the configuration see. Raises ValueError if there are none."""
    section = next((c for c in config.cameras if c.kind == "simulated"), None)
    if section is None:
        raise ValueError(
            'no camera of kind = "simulated" in the configuration, and so no flight: take configs/simulated.toml (`companion configs simulated`); with --address it also tests the line of another configuration'
        )
    return LoopingFlight(flight_plan(section.flight, section.seed))


def simulated(
    flight: LoopingFlight, kind: str = PX4, *, armed: bool = False, drift_ppm: float = 0.0
) -> SimulatedAutopilot:
    """Returns an autopilot on this flight, without a link."""
    return SimulatedAutopilot(
        FirmwareProfile(
            kind=kind, armed=armed, drift=drift_ppm * 1e-6, motion=flight.state, hides_attitude=flight.hides_attitude
        )
    )


def other_end(address: str) -> UdpEnd | PtyEnd:
    """Returns the autopilot's end of a line whose other end is the service's address, `pty`, or `pty:LINK`.

    LINK is a name for the pty that a configuration can contain. Raises ValueError for lines that cannot be opened
    from this side."""
    if address == "pty" or address.startswith("pty:"):
        return PtyEnd()
    line = parse_address(address)
    if line.kind not in ("udpin", "udpout"):
        raise ValueError(
            f'a simulated autopilot cannot be at the other end of "{address}": let the service listen, [autopilot] '
            'address = "udpin:127.0.0.1:14540", or give --address udpout:HOST:PORT, --address pty or pty:LINK'
        )
    return UdpEnd(EVERYWHERE.get(line.place, line.place.strip("[]")), line.number)


def _link(address: str, end: UdpEnd | PtyEnd) -> Path | None:
    """Creates the name of pty:LINK. An existing symbolic link is replaced, any other file is not."""
    name = address.removeprefix("pty:") if address.startswith("pty:") else ""
    if not name or not isinstance(end, PtyEnd):
        return None
    link = Path(name)
    try:
        if link.is_symlink():
            link.unlink()
        link.symlink_to(end.device)
    except OSError as error:  # it names the device, not the link
        raise OSError(error.errno, error.strerror, name) from error
    return link


def add_parser(subparsers: Any) -> None:
    """Adds the command line of `companion simulate-autopilot`."""
    parser = subparsers.add_parser("simulate-autopilot")
    add_config(parser, "configuration of `companion run`, with a simulated camera", required=True)
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--px4", action="store_const", dest="kind", const=PX4, default=PX4, help="simulate PX4 (default)")
    kind.add_argument("--ardupilot", action="store_const", dest="kind", const=ARDUPILOT, help="simulate ArduPilot")
    parser.add_argument(
        "--address",
        type=checked_by(other_end),
        metavar="LINE",
        help="udpout:HOST:PORT, pty or pty:LINK (default: the counterpart of [autopilot] address)",
    )
    parser.add_argument("--armed", action="store_true", help="report an armed vehicle")
    parser.add_argument(
        "--drift-ppm",
        type=number_in(float, -1000.0, 1000.0),
        default=0.0,
        metavar="X",
        help="drift of its clock in ppm (default: 0)",
    )
    parser.add_argument(
        "--jitter-ms",
        type=number_in(float, 0.0, 10_000.0),
        default=0.0,
        metavar="X",
        help="delay each message by a random time of 0 to X ms (default: 0)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, then run")


def run(args: argparse.Namespace) -> int:
    """Runs until it is stopped, and returns 0. Raises ValueError, ConfigError and OSError."""
    config = load_config(args.config)
    flight = flight_of(config)
    address = args.address or config.autopilot.address
    if not address:
        raise ValueError("the configuration has no [autopilot] address; give --address udpout:HOST:PORT")
    # a real autopilot is another computer: the simulated one must not take processor time from the service
    with contextlib.suppress(OSError):  # a container may forbid it
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    stop = stop_event()
    end = other_end(address)
    autopilot = simulated(flight, args.kind, armed=args.armed, drift_ppm=args.drift_ppm)
    autopilot.keeps_messages = False
    autopilot.parameters.update(PARAMETERS[args.kind])
    with AutopilotLink(autopilot, end, Faults(jitter_s=args.jitter_ms / 1000.0)):
        link = _link(address, end)
        try:
            _print_address(args, flight, str(link or end.device) if isinstance(end, PtyEnd) else address)
            stop.wait()
        finally:
            if link is not None:
                link.unlink(missing_ok=True)
    return 0


def _print_address(args: argparse.Namespace, flight: LoopingFlight, line: str) -> None:
    if args.json:
        print_json({"autopilot": args.kind, "flight": flight.plan.name, "line": line})
    else:
        print_line(f'{args.kind}, simulated, flies "{flight.plan.name}" there and back on {line}; Ctrl-C ends it')
        if line.startswith("/"):
            print_line(f'in the configuration: [autopilot] address = "serial:{line}"')
    sys.stdout.flush()
