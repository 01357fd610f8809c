"""PX4's parameters of a gimbal, and what they mean. Names and numbers are facts of PX4's metadata."""

from __future__ import annotations

from typing import Final

INPUT, OUTPUT, PREARM = "MNT_MODE_IN", "MNT_MODE_OUT", "COM_PREARM_MODE"
"""Read when the gimbal module starts (input, output), and at once (prearm)."""
DISABLED, MAVLINK_INPUT = -1, 4
MAVLINK_INPUTS: Final = (0, 4)
"""Values of MNT_MODE_IN with gimbal protocol version 2: together with RC, or alone."""
SERVO_OUTPUT = 0
"""Value of MNT_MODE_OUT with which PX4 drives servos on its own outputs ("AUX")."""
PREARM_ALWAYS = 2
"""Value of COM_PREARM_MODE with which outputs that are not motors move while the vehicle is disarmed."""
FUNCTIONS: Final = {"roll": 420, "pitch": 421, "yaw": 422}
"""Functions of an output for the gimbal's axes."""
MODULE_PREFIX = "MNT_"
SETTINGS: Final = (
    INPUT,
    OUTPUT,
    "MNT_MAV_SYSID",
    "MNT_MAV_COMPID",
    "MNT_DO_STAB",
    "MNT_RANGE_ROLL",
    "MNT_RANGE_PITCH",
    "MNT_RANGE_YAW",
    "MNT_OFF_ROLL",
    "MNT_OFF_PITCH",
    "MNT_OFF_YAW",
    "MNT_LND_P_MIN",
    "MNT_LND_P_MAX",
    "MNT_RC_IN_MODE",
    "MNT_MAN_ROLL",
    "MNT_MAN_PITCH",
    "MNT_MAN_YAW",
    "MNT_RATE_PITCH",
    "MNT_RATE_YAW",
    PREARM,
)
"""Parameters of a gimbal's set-up, in the order in which a person sets them."""
