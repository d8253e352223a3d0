"""The commands of `companion`, in the order of use: the module of each, what it does, and examples of its use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the command line."""

    module: str  # in this package, with add_parser and run
    purpose: str  # one sentence without a full stop
    examples: tuple[str, ...] = ()  # command lines


GROUPS: Final[dict[str, dict[str, Command]]] = {
    "try it without hardware": {
        "demo": Command(
            "demo.command",
            "fly a simulated scene with the live service, replay the log and draw it",
            ("companion demo", "companion demo --fast -o /tmp/demo"),
        ),
        "simulate-autopilot": Command(
            "autopilot.simulate_autopilot",
            "simulate the autopilot of a simulated flight, for `companion run` without hardware",
            (
                "companion simulate-autopilot -c configs/simulated.toml",
                "companion simulate-autopilot -c configs/simulated.toml --ardupilot --armed",
            ),
        ),
    },
    "configure and check": {
        "setup": Command(
            "setup.setup",
            "find the camera and the autopilot, write a configuration and check all parts",
            (
                "companion setup -o my.toml",
                "companion setup -o my.toml --yes --camera oak --autopilot udpin:0.0.0.0:14540 --pitch=-10",
            ),
        ),
        "configs": Command(
            "install.configs",
            "list the shipped configurations, or copy one",
            ("companion configs", "companion configs oak -o my.toml"),
        ),
        "check-config": Command(
            "config.check_config",
            "report all mistakes of a configuration, or what differs from the defaults",
            ("companion check-config my.toml",),
        ),
        "doctor": Command(
            "doctor.doctor",
            "check all parts before a flight and print what to do about each fault",
            (
                "companion doctor -c my.toml",
                "companion doctor -c my.toml --mount",
                "companion doctor -c my.toml --apply",
            ),
        ),
        "bench": Command(
            "bench.bench",
            "measure the frame rate that this computer reaches",
            ("companion bench", "companion bench --size 848x480 --hz 30"),
        ),
        "warmup": Command("kernels.warmup", "compile all kernels now instead of at their first use"),
    },
    "live service": {
        "run": Command(
            "live.run",
            "run the live service: cameras and autopilot in, obstacles out",
            ("companion run -c my.toml",),
        ),
        "status": Command(
            "live.status",
            "show the state of the running service",
            ("companion status", "sudo companion status"),
        ),
        "view": Command(
            "viewer.command",
            "draw a log as pictures and a 3-D page, or serve a page that follows the running service",
            (
                "companion view prisms.mcap -o pictures",
                "companion view prisms.mcap -o pictures --frame 120 --no-page",
                "companion view --live",
            ),
        ),
        "ros2": Command(
            "ros2.command",
            "publish the results of the running service to ROS 2 through rmw_zenoh",
            ("companion ros2 --router tcp/192.168.1.20:7447",),
        ),
    },
    "logs": {
        "import": Command(
            "importers.command",
            "convert depth images or a ROS 2 recording into a log",
            (
                "companion import FOLDER -o flight.mcap --mount=0,-20,0 --max-range-m 10",
                "companion import bag.mcap -o flight.mcap --tlog flight.ulg",
            ),
        ),
        "replay": Command(
            "replay.command",
            "compute the obstacles of a log again, and compare them with the recorded ones on request",
            (
                "companion replay flight.mcap -o prisms.mcap",
                "companion replay flight.mcap -o prisms.mcap -c my.toml",
                "companion replay prisms.mcap --check",
            ),
        ),
        "info": Command(
            "log.info",
            "show the content of a log: topics, rates, gaps, damage",
            ("companion info flight.mcap",),
        ),
        "recover": Command(
            "log.recover",
            "copy what is readable of a damaged or unfinished log into a complete one",
            ("companion recover flight.mcap.active",),
        ),
        "export": Command(
            "export.command",
            "write the results of a log as CSV, NPZ, Parquet or glTF",
            ("companion export prisms.mcap -f csv -o tables", "companion export prisms.mcap -f gltf -o model.glb"),
        ),
    },
    "many flights": {
        "batch": Command(
            "batch.command",
            "replay many logs into tables, or compare two such results",
            (
                "companion batch /logs -o /results/new -c new.toml",
                "companion batch --compare /results/old /results/new -o /results/report",
            ),
        ),
        "find": Command(
            "batch.find",
            "cut the times that fulfil a condition out of the logs of `companion batch`",
            (
                "companion find /results/new blind_while_armed -o clips",
                'companion find /results/new \'[["nearest_m", "<", 1.5]]\' -o clips --list',
            ),
        ),
    },
    "install": {
        "install": Command(
            "install.install",
            "install the service on this computer as a systemd unit (needs root)",
            ("sudo companion install -c my.toml --dry-run", "sudo companion install -c my.toml"),
        ),
        "uninstall": Command(
            "install.uninstall",
            "remove the service from this computer (needs root)",
            ("sudo companion uninstall --dry-run",),
        ),
        "keys": Command(
            "streams.keys",
            "make keys for streams over the network and for MAVLink signatures",
            ("companion keys /etc/osape-companion/keys --client ground", "companion keys --signing team.key"),
        ),
    },
}
"""Title of the group -> its commands."""

COMMANDS: Final[dict[str, Command]] = {name: c for group in GROUPS.values() for name, c in group.items()}
