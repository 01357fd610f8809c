"""This server's texts for PX4's arming checks: the cause and the remedy.

Ids and names are those of PX4 v1.16; the top byte of an id is the component id (1: autopilot). These texts
are used if the vehicle's own metadata is missing or has no remedy.
"""

from __future__ import annotations

from typing import NamedTuple


class Check(NamedTuple):
    """One check."""

    name: str
    """Name in PX4's metadata, for programs."""
    cause: str
    """The cause, as part of a sentence."""
    remedy: str | None = None
    """The remedy, as a sentence."""


STILL = "Keep the vehicle still and wait; if the problem stays, check the sensor."
SKY = "Wait at a place with a clear view of the sky."
CALIBRATE_RC = "Calibrate the RC transmitter again."
CALIBRATE = "Calibrate the sensor."
WIRING = "Check the connection of this part, and restart the vehicle."
NO_GPS_MODES = "Do not use flight modes that need GPS here."
GYRO = "Check that the gyro is connected, and restart the vehicle."
CHARGE = "Insert a charged battery."
POWER = "Check the power module."
BACK_INSIDE = "Bring the vehicle back inside the geofence, or change the geofence."

MANUAL_CONTROL_ID = 17231145
MODE_NEEDS: dict[int, Check] = {
    MANUAL_CONTROL_ID: Check(
        "check_modes_manual_control", "no RC transmitter or joystick",
        "Switch the RC transmitter on, or choose a mode that needs no pilot.",
    ),
    17154777: Check("check_modes_mission", "there is no mission to fly", "Upload a mission."),
    19865031: Check(
        "check_modes_offboard_signal", "no offboard setpoints received",
        "Start an offboard stream here: it sends setpoints before it requests the mode.",
    ),
    30612409: Check("check_modes_local_pos", "no valid position estimate", SKY),
    26788467: Check("check_modes_global_pos", "no valid global position", SKY),
    29467116: Check(
        "check_modes_local_alt", "no valid altitude estimate", "Wait; check the barometer."
    ),
    16856624: Check("check_modes_home_position", "there is no home position", SKY),
    27227279: Check("check_modes_attitude", "no valid attitude estimate", STILL),
    26420585: Check("check_modes_angular_velocity", "no valid angular velocity", GYRO),
    31525953: Check(
        "check_external_modes_unavailable", "the external mode is not registered", "Start its program."
    ),
    26592384: Check(
        "check_external_modes_unresponsive", "the external mode does not respond", "Restart its program."
    ),
}  # fmt: skip
"""Checks that must pass before the vehicle can fly a mode; all other checks only prevent arming."""

CHECKS: dict[int, Check] = MODE_NEEDS | {
    18648929: Check(
        "check_modes_cannot_takeoff", "this mode cannot take off from the ground",
        "Arm in Hold or Take off, then switch.",
    ),
    25316113: Check(
        "check_failure_detector_roll", "the vehicle is tilted too far",
        "Place the vehicle upright, then restart it."
    ),
    33522684: Check(
        "check_failure_detector_pitch", "the vehicle is tilted too far",
        "Place the vehicle upright, then restart it."
    ),
    21326245: Check(
        "check_failure_detector_alt", "the vehicle lost altitude unexpectedly",
        "Find the cause before you arm."
    ),
    21039037: Check("check_failure_detector_ext", "an external system reports a failure"),
    17443695: Check(
        "check_failure_detector_motor", "a motor failed", "Repair the motor before the next flight."
    ),
    32570390: Check("check_failure_detector_arm_esc", "an ESC did not arm", WIRING),
    21654568: Check(
        "check_failure_detector_imbalanced_prop", "a propeller is out of balance", "Change the propeller."
    ),
    21826980: Check("check_battery_low", "the battery is low", CHARGE),
    19404811: Check("check_battery_critical", "the battery level is critical", CHARGE),
    28121863: Check("check_battery_emergency", "the battery level is below the emergency threshold", CHARGE),
    19005802: Check("check_battery_rem_flight_time_low", "the remaining flight time is too short", CHARGE),
    27095490: Check("check_battery_missing", "a battery is missing", "Connect all batteries."),
    25576769: Check("check_battery_disconnected", "a battery is disconnected", "Connect all batteries."),
    30121562: Check("check_battery_unhealthy", "a battery is not healthy", "Replace the battery."),
    32379714: Check("check_battery_fault", "a battery reports a fault", "Replace the battery."),
    28274646: Check("check_estimator_gps_vert_pos_drift_too_high", "the GPS altitude still drifts", SKY),
    22494412: Check("check_estimator_gps_hor_pos_drift_too_high", "the GPS position still drifts", SKY),
    17826492: Check("check_estimator_gps_hor_pos_err_too_high", "the GPS position is too uncertain", SKY),
    17293278: Check("check_estimator_gps_vert_pos_err_too_high", "the GPS altitude is too uncertain", SKY),
    21752443: Check("check_estimator_gps_hor_speed_drift_too_high", "the GPS speed still drifts", SKY),
    23335473: Check("check_estimator_gps_vert_speed_drift_too_high", "the GPS climb rate still drifts", SKY),
    27455887: Check("check_estimator_gps_speed_acc_too_low", "the GPS speed is too uncertain", SKY),
    26976193: Check("check_estimator_gps_pdop_too_high", "poor GPS satellite geometry (PDOP too high)", SKY),
    29871674: Check("check_estimator_gps_num_sats_too_low", "there are too few GPS satellites", SKY),
    29146769: Check("check_estimator_gps_fix_too_low", "GPS has no 3D fix", SKY),
    18865335: Check("check_estimator_gps_generic", "GPS is not good enough", SKY),
    26385442: Check("check_estimator_gps_not_fusing", "the estimator does not use GPS", SKY),
    25491158: Check("check_estimator_gps_spoofed", "GPS spoofing detected", NO_GPS_MODES),
    29557505: Check(
        "check_estimator_gps_jamming_critical", "GPS jamming detected", NO_GPS_MODES
    ),
    22831554: Check("check_estimator_missing_data", "the estimator has not started yet", STILL),
    33420013: Check("check_estimator_heading_not_stable", "the heading estimate is not stable yet", STILL),
    26412014: Check("check_estimator_hgt_not_stable", "the altitude estimate is not stable yet", STILL),
    26475035: Check("check_estimator_hor_pos_not_stable", "the position estimate is not stable yet", STILL),
    25679424: Check("check_estimator_hor_vel_not_stable", "the speed estimate is not stable yet", STILL),
    25948424: Check("check_estimator_vert_vel_not_stable", "the climb rate is not stable yet", STILL),
    27737349: Check("check_estimator_low_position_accuracy", "the position estimate is inaccurate", SKY),
    20390844: Check(
        "check_estimator_high_accel_bias", "an accelerometer bias is too high", CALIBRATE
    ),
    26084437: Check("check_estimator_high_gyro_bias", "a gyro bias is too high", "Calibrate the gyro again."),
    32490591: Check(
        "check_estimator_mag_interference", "the magnetic field here is disturbed", "Move away from metal."
    ),
    20380425: Check(
        "check_estimator_mag_fault", "the estimator stopped using the compass", "Calibrate the compass again."
    ),
    26743035: Check("check_estimator_gnss_fault", "the GPS heading is not reliable", SKY),
    22720449: Check(
        "check_mag_sys_has_mag_missing", "too few compasses were found", "Connect them, or lower SYS_HAS_MAG."
    ),
    22050956: Check("check_mag_consistency", "the compasses disagree", "Calibrate the compasses again."),
    23035260: Check("check_mag_fault", "a compass is faulty", "Calibrate the compass again, or replace it."),
    19838260: Check("check_imu_accel_inconsistent", "the accelerometers disagree", STILL),
    19259057: Check("check_imu_gyro_inconsistent", "the gyros disagree", STILL),
    22222072: Check("check_accel_not_calibrated", "an accelerometer is not calibrated", CALIBRATE),
    18103665: Check("check_gyro_not_calibrated", "a gyro is not calibrated", CALIBRATE),
    33493753: Check("check_mag_not_calibrated", "a compass is not calibrated", CALIBRATE),
    25005055: Check("check_accel_missing", "an accelerometer is missing", WIRING),
    33007247: Check("check_accel_no_data", "an accelerometer gives no data", WIRING),
    20345936: Check("check_gyro_missing", "a gyro is missing", WIRING),
    28255544: Check("check_gyro_no_data", "a gyro gives no data", WIRING),
    32165976: Check("check_mag_missing", "a compass is missing", WIRING),
    23187824: Check("check_mag_no_data", "a compass gives no data", WIRING),
    21872809: Check("check_baro_missing", "a barometer is missing", WIRING),
    19966445: Check("check_baro_no_data", "a barometer gives no data", WIRING),
    30998685: Check("check_distance_sensor_missing", "a distance sensor is missing", WIRING),
    25321862: Check("check_distance_sensor_invalid", "a distance sensor gives no data", WIRING),
    25569984: Check("check_optical_sensor_missing", "the optical flow sensor is missing", WIRING),
    27903148: Check("check_optical_flow_sensor_invalid", "the optical flow sensor gives no data", WIRING),
    31343262: Check("check_escs_offline", "an ESC does not answer", WIRING),
    25968665: Check("check_escs_telem_missing", "an ESC sends no reports", WIRING),
    23725705: Check("check_escs_fault", "an ESC reports a fault", "Check the motor."),
    24685549: Check("check_avionics_power_missing", "the power module is not connected", WIRING),
    18447583: Check("check_avionics_power_low", "the avionics supply voltage is too low", POWER),
    32067059: Check("check_avionics_power_high", "the avionics supply voltage is too high", POWER),
    16920235: Check("check_gf_violation_custom_gf", "the vehicle is outside the geofence", BACK_INSIDE),
    30700832: Check(
        "check_gf_violation_max_alt", "the vehicle is above the maximum altitude (geofence)", BACK_INSIDE
    ),
    20842799: Check(
        "check_gf_violation_max_hor_dist", "the vehicle is too far from home (geofence)", BACK_INSIDE
    ),
    16901501: Check("check_gf_no_home", "a geofence with the action Return needs a home position", SKY),
    29582859: Check(
        "check_mission_failure", "the mission cannot be flown", "Correct the mission and upload it again."
    ),
    26938432: Check(
        "check_open_drone_id_missing", "the Open Drone ID system is missing", "Connect one (COM_ARM_ODID)."
    ),
    25218996: Check("check_open_drone_id_unhealthy", "the Open Drone ID system is not ready", WIRING),
    32742900: Check("check_parachute_missing", "the parachute system is missing", WIRING),
    30149368: Check("check_parachute_unhealthy", "the parachute system is not ready", WIRING),
    23579003: Check(
        "check_rc_dl_no_dllink", "the vehicle has no connection to a ground station",
        "Check the link in both directions."
    ),
    29532170: Check("check_system_flight_term_active", "the flight was terminated", "Restart the vehicle."),
    17054001: Check(
        "check_system_safety_button", "the safety button is not pressed", "Press the safety button."
    ),
    24439368: Check("check_system_usb_connected", "a USB cable is connected", "Disconnect the cable."),
    29053220: Check("check_system_no_global_pos", "no valid global position", SKY),
    23268580: Check("check_system_no_home_pos", "there is no home position", SKY),
    22481569: Check("check_system_arm_auth_failed", "arming authorization denied"),
    25855193: Check("check_man_control_kill_engaged", "the kill switch is on", "Switch it off."),
    24661593: Check("check_man_control_rtl_engaged", "the return switch is on", "Switch it off."),
    24736883: Check(
        "check_armable_configuration", "the vehicle is configured not to arm", "Complete its setup first."
    ),
    28190816: Check(
        "check_wind_too_high", "the wind is above the limit", "On the ground: wait. In the air: land."
    ),
    31421834: Check("check_flight_time_limit", "the maximum flight time has been reached", "Land."),
    27773549: Check("check_missing_fmu_sdcard", "there is no SD card", "Insert an SD card."),
    21225307: Check(
        "check_hardfault_present",
        "the SD card contains a crash log of the flight software",
        "Download the crash log.",
    ),
    17836172: Check("check_cpuload_too_high", "the flight computer is overloaded", "Stop unused modules."),
    31198698: Check("check_ram_usage_too_high", "the flight computer's memory is nearly full"),
    23756917: Check("check_rc_min_too_small", "the calibration of an RC channel is invalid", CALIBRATE_RC),
    24624528: Check("check_rc_max_too_high", "the calibration of an RC channel is invalid", CALIBRATE_RC),
    25272693: Check("check_rc_trim_too_small", "the calibration of an RC channel is invalid", CALIBRATE_RC),
    18694246: Check("check_rc_trim_too_high", "the calibration of an RC channel is invalid", CALIBRATE_RC),
    23436396: Check("check_rc_dz_too_high", "the calibration of an RC channel is invalid", CALIBRATE_RC),
}  # fmt: skip

HEALTH_COMPONENTS: tuple[str, ...] = (
    "nothing", "barometer", "airspeed sensor", "GPS", "optical flow", "vision", "distance sensor",
    "transmitter", "motors",
    "traffic management", "logging", "battery", "links", "rate control", "attitude control",
    "position control", "attitude estimate", "position estimate", "mission", "obstacle avoidance", "system",
    "camera", "gimbal", "payload", "global position", "storage", "parachute", "compass", "accelerometer",
    "gyro", "Open Drone ID", "31",
)  # fmt: skip
"""Names of PX4's health components, by the index in the arguments of an arming check."""
