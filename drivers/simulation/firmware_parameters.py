"""Parameters of simulated autopilots with which the vehicle brakes, with the defaults of all others that are read.

A reader repeats a request for a parameter that is not answered for seconds: a simulated autopilot has them all, as a real one."""

from __future__ import annotations

from typing import Final

from ..mavlink.session_types import ARDUPILOT, PX4

DEFAULTS: Final[dict[str, dict[str, float]]] = {
    PX4: {"COM_OBS_AVOID": 0},
    ARDUPILOT: {
        "PRX2_TYPE": 0.0,
        "PRX1_MIN": 0.0,
        "PRX1_MAX": 0.0,
        "PRX1_ORIENT": 0.0,
        "PRX1_YAW_CORR": 0.0,
        "PRX_IGN_GND": 0.0,
        "PRX_FILT": 1.0,
        "AVOID_ALT_MIN": 0.0,
        "AVOID_ACCEL_MAX": 3.0,
        "AVOID_BACKUP_DZ": 0.1,
        "AVOID_BACKZ_SPD": 0.75,
        **{f"RC{n}_OPTION": 0.0 for n in range(1, 17)},
    },
}
"""Kind of the autopilot -> parameters that its firmware may lack. PX4 sends whole numbers, here ints, in a form of their own."""
PARAMETERS: Final[dict[str, dict[str, float]]] = {
    # CP_DELAY: more than what a busy machine adds to the age of obstacles, which would be a diagnostic
    PX4: DEFAULTS[PX4] | {"CP_DIST": 3.0, "CP_DELAY": 1.0, "CP_GO_NO_DATA": 0, "MPC_POS_MODE": 4},
    ARDUPILOT: DEFAULTS[ARDUPILOT]
    | {
        "PRX1_TYPE": 2,
        "AVOID_ENABLE": 7,
        "AVOID_MARGIN": 2.5,
        "AVOID_BEHAVE": 1,
        "AVOID_BACKUP_SPD": 0,
        "OA_TYPE": 0,
    },
}
"""Kind of the autopilot -> all parameters, as the pages about connecting it set them."""
