"""The topic `failsafe_flags`: a mask of modes for each mode requirement, and the vehicle's current faults."""

from __future__ import annotations

from typing import Any, Final

from vehicle_sim.autopilot.commander import Commander
from vehicle_sim.external_modes.requirements import Requirements
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import VehicleView

DECLARATION: Final = "".join(f"uint32_t mode_req_{name};" for name in Requirements._fields) + (
    "bool angular_velocity_invalid;bool attitude_invalid;bool local_altitude_invalid;"
    "bool local_position_invalid;bool local_position_invalid_relaxed;bool local_velocity_invalid;"
    "bool global_position_invalid;bool auto_mission_missing;bool offboard_control_signal_lost;"
    "bool home_position_invalid;bool manual_control_signal_lost;bool gcs_connection_lost;"
    "uint8_t battery_warning;bool battery_low_remaining_time;bool battery_unhealthy;bool geofence_breached;"
    "bool mission_failure;bool vtol_fixed_wing_system_failure;bool wind_limit_exceeded;"
    "bool flight_time_limit_exceeded;bool local_position_accuracy_low;bool navigator_failure;"
    "bool fd_critical_failure;bool fd_esc_arming_failure;bool fd_imbalanced_prop;bool fd_motor_failure"
)


def fault_flags(view: VehicleView, commander: Commander, home: Home) -> dict[str, Any]:
    """Flags of current faults; the topic is published immediately when a flag changes."""
    estimate, checks, monitors = view.estimate, commander.checks, commander.monitors
    position_usable = checks.position_usable
    return {
        "attitude_invalid": not estimate.valid_attitude,
        "angular_velocity_invalid": not estimate.valid_attitude,
        "local_altitude_invalid": not estimate.valid_altitude,
        "local_position_invalid": not position_usable,
        "local_position_invalid_relaxed": not position_usable,
        "local_velocity_invalid": not estimate.valid_velocity,
        "global_position_invalid": not position_usable,
        "auto_mission_missing": not checks.has_mission,
        "offboard_control_signal_lost": not commander.offboard.has_signal(),
        "home_position_invalid": not home.valid,
        "manual_control_signal_lost": not checks.has_manual_control(),
        "gcs_connection_lost": not checks.gcs_connected(),
        "battery_warning": checks.battery_warning,
        "geofence_breached": bool(checks.fence),
        "wind_limit_exceeded": monitors.wind_too_high,
        "flight_time_limit_exceeded": monitors.flight_time_over,
        "fd_critical_failure": monitors.roll_failure or monitors.pitch_failure,
    }


def values(view: VehicleView, commander: Commander, home: Home) -> dict[str, Any]:
    """All fields of the topic except the timestamp."""
    requirement_masks = {
        f"mode_req_{name}": mask for name, mask in commander.report.requirements._asdict().items()
    }
    return requirement_masks | fault_flags(view, commander, home)
