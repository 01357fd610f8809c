"""Texts for PX4's failsafe flags (`failsafe_flags`), because PX4 sends no text for a refused command over ROS
2."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gcs_server.ros2.message_types import Values

MODE_REQUIREMENTS: Final = (
    ("angular_velocity_invalid", "mode_req_angular_velocity", "no valid angular velocity"),
    ("attitude_invalid", "mode_req_attitude", "no valid attitude estimate"),
    ("local_altitude_invalid", "mode_req_local_alt", "no valid altitude estimate"),
    ("local_position_invalid", "mode_req_local_position", "no valid local position estimate"),
    (
        "local_position_invalid_relaxed",
        "mode_req_local_position_relaxed",
        "no valid local position estimate",
    ),
    ("global_position_invalid", "mode_req_global_position", "no valid global position estimate"),
    ("auto_mission_missing", "mode_req_mission", "no mission on the vehicle"),
    ("offboard_control_signal_lost", "mode_req_offboard_signal", "no offboard setpoints are received"),
    ("home_position_invalid", "mode_req_home_position", "no home position"),
    ("manual_control_signal_lost", "mode_req_manual_control", "no manual control input"),
)
"""(flag, mask of the modes with this requirement, text); a mode's bit number is its `nav_state`."""
IN_ANY_MODE: Final = (
    ("battery_unhealthy", "battery unhealthy"),
    ("battery_low_remaining_time", "remaining flight time too low"),
    ("geofence_breached", "geofence breached"),
    ("wind_limit_exceeded", "wind speed limit exceeded"),
    ("flight_time_limit_exceeded", "flight time limit exceeded"),
    ("navigator_failure", "navigator failure"),
    ("fd_critical_failure", "critical failure (attitude or external failsafe)"),
    ("fd_esc_arming_failure", "an ESC did not arm"),
    ("fd_imbalanced_prop", "imbalanced propeller detected"),
    ("fd_motor_failure", "motor failure"),
)
"""(flag, text) of problems that matter in every mode."""


def problems(flags: Values, nav_state: int) -> Iterator[str]:
    """Texts of the flags that prevent arming or flying in a mode.

    Args:
        flags: a decoded `failsafe_flags`.
        nav_state: the mode, 0 to 31.
    """
    if nav_state < 32 and flags["mode_req_prevent_arming"] >> nav_state & 1:
        yield "PX4 does not arm in this mode"
    for flag, mask, text in MODE_REQUIREMENTS:
        if flags[flag] and nav_state < 32 and flags[mask] >> nav_state & 1:
            yield text
    for flag, text in IN_ANY_MODE:
        if flags[flag]:
            yield text
