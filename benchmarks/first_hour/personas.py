"""The sessions: who types what. CHECKOUT stands for the folder of the checkout, MATERIAL for that of the recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .steps import Step

RUN: Final = "companion run -c simulated.toml"
AUTOPILOT: Final = "companion simulate-autopilot -c simulated.toml"
CLIENT: Final = "python CHECKOUT/examples/subscriber.py"
UDP: Final = "udpin:127.0.0.1:14550"
PX4: Final = f"companion simulate-autopilot -c simulated.toml --px4 --address {UDP.replace('udpin', 'udpout')}"
SETUP: Final = f"companion setup --yes --autopilot {UDP} --pitch -10 --position 0.1 0 0 --width 0.6 --height 0.3"
WAIT: Final = "until companion status -c simulated.toml; do sleep 2; done"
OAK_RUN: Final = "companion run -c mine.toml"


@dataclass(frozen=True, slots=True)
class Persona:
    """cold: begins without compiled kernels, as on a new computer; pages: the documentation that the commands are from."""

    name: str
    who: str
    pages: str
    steps: tuple[Step, ...]
    cold: bool = False


NEWCOMER: Final = Persona(
    "newcomer",
    "is new to the project",
    "README, tutorial/demo",
    (
        Step("companion --help", shows=("companion demo",)),
        Step("companion demo", shows=("bit for bit", "flight.html")),
        Step("companion info demo-out/prisms.mcap", shows=("/camera/front/depth",)),
        Step("companion status", status=1, shows=("companion run",)),
    ),
    cold=True,
)

INTEGRATOR: Final = Persona(
    "integrator",
    "has an OAK and a PX4; the camera is not connected yet",
    "how-to/connect-oak, how-to/connect-px4, tutorial/first-bench-test",
    (
        Step("companion setup -o mine.toml", status=1, shows=("no camera was found", "--camera")),
        Step("companion configs oak -o my.toml", shows=("check-config",)),
        Step("companion check-config my.toml", shows=("usable", "obstacles are found up to")),
        Step(f"{SETUP} -o mine.toml --camera oak --no-doctor", shows=("written: mine.toml",)),
        Step("companion check-config mine.toml", shows=("usable",)),
        Step("companion configs simulated"),
        Step(PX4, starts=True),
        Step(
            "companion doctor -c mine.toml",
            status=1,
            wait_s=2.0,
            shows=("no OAK device", "udev", r"ok  autopilot: PX4"),
        ),
        Step(stop=PX4),
        Step(OAK_RUN, starts=True),
        Step("companion status -c mine.toml", status=1, wait_s=15.0, shows=("BLIND", "no OAK device", "no heartbeat")),
        Step(stop=OAK_RUN, shows=("ready", "stopped")),
    ),
)

PLANNER: Final = Persona(
    "planner developer",
    "writes a client of the obstacle stream",
    "tutorial/demo (Run it live), how-to/write-a-planner-client, how-to/connect-ros2",
    (
        Step("companion configs simulated"),
        Step(CLIENT, starts=True),
        Step(RUN, starts=True, wait_s=2.0),
        Step(AUTOPILOT, starts=True),
        Step("companion ros2", starts=True),
        Step(WAIT, shows=("BLIND|starting|no health report",)),
        Step("companion status -c simulated.toml", wait_s=2.0, shows=("front",)),
        Step(stop=AUTOPILOT),
        Step("companion status -c simulated.toml", status=1, wait_s=3.0, shows=("BLIND",)),
        Step(stop=RUN, shows=("stopped",)),
        Step(
            stop="companion ros2", wait_s=8.0, shows=("no Zenoh router", "the service is received", "companion status")
        ),
        Step(stop=CLIENT, shows=("nothing may be taken as free", "nearest")),
    ),
)

DATA: Final = Persona(
    "data person",
    "needs the results of a flight as tables and pictures",
    "how-to/view-logs",
    (
        Step("cp MATERIAL/prisms.mcap ."),
        Step("companion info prisms.mcap", shows=("/camera/front/depth",)),
        Step("companion export prisms.mcap -f csv -o tables", shows=("planes.csv",)),
        Step("companion export prisms.mcap -f npz -o tables.npz"),
        Step("companion export prisms.mcap -f parquet -o parquet"),
        Step("companion export prisms.mcap -f gltf -o model.glb"),
        Step("companion view prisms.mcap -o pictures", shows=("flight.html",)),
        Step("companion replay prisms.mcap --check", shows=("compared bit by bit: equal",)),
        Step("companion export prisms.mcap -f xls -o x", status=2, shows=("csv",)),
        Step("companion view nothing.mcap -o pictures", status=1, shows=("nothing.mcap",)),
    ),
)

STEREO: Final = Persona(
    "RealSense or ZED owner",
    "configures the camera before it is connected",
    "how-to/connect-realsense, how-to/connect-zed",
    (
        Step("companion configs v4l2 -o realsense.toml"),
        Step("companion check-config realsense.toml", status=1, shows=("intrinsics", "setup")),
        Step(
            f"{SETUP} -o rs.toml --camera v4l2:/dev/v4l/by-id/none --no-doctor",
            status=1,
            shows=("rs-enumerate-devices", "needs fx_px"),
        ),
        Step("companion configs zed -o zed.toml"),
        Step("companion check-config zed.toml", status=1, shows=("calibration",)),
        Step(
            f"{SETUP} -o z.toml --camera zed:/dev/video0 --calibration SN12345678.conf --no-doctor",
            status=1,
            shows=("SN12345678.conf",),
        ),
        Step("companion doctor -c zed.toml --patience 3", status=1, shows=("calibration",)),
    ),
)

RECORDINGS: Final = Persona(
    "owner of recordings",
    "has a ROS 2 bag, a TUM RGB-D folder and depth images with a PX4 log",
    "tutorial/first-recording, how-to/import-a-ros2-bag, how-to/import-recordings",
    (
        Step("companion import MATERIAL/bag.mcap -o bag.mcap", shows=("frames",)),
        Step("companion info bag.mcap", shows=("/camera/",)),
        Step("companion replay bag.mcap -o bag-prisms.mcap", shows=("valid",)),
        Step("companion view bag-prisms.mcap -o bag-pictures", shows=("flight.html",)),
        Step("companion import MATERIAL/tum -o tum.mcap", shows=("frames",)),
        Step("companion replay tum.mcap -o tum-prisms.mcap", shows=("valid",)),
        Step("companion view tum-prisms.mcap -o tum-pictures", shows=("flight.html",)),
        Step(
            "companion import MATERIAL/folder -o folder.mcap --mount=0,-20,0 --max-range-m 10",
            shows=("ulg|PX4|attitude",),
        ),
        Step("companion replay folder.mcap -o folder-prisms.mcap"),
        Step("companion import nowhere -o x.mcap", status=1, shows=("nowhere",)),
        Step("companion replay MATERIAL/bag.mcap -o x.mcap", status=1, shows=("companion import",)),
    ),
)

PERSONAS: Final = (NEWCOMER, INTEGRATOR, PLANNER, DATA, STEREO, RECORDINGS)
