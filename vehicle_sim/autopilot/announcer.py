"""Status texts and events of a vehicle; each link sends them in the order in which they are published.

Event ids, names and log levels are those of PX4's build. If PX4 sends a status text together with an event,
the text ends with a tab, so that a ground station can ignore the text and show the event.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

EVENTS: Final[dict[str, tuple[int, int]]] = {
    # name: (id, log levels: internal in the high nibble, external in the low one)
    "commander_armed_by": (26266355, 102),
    "commander_disarmed_by": (32794487, 102),
    "commander_unsupported_arm_disarm_param": (19217309, 51),
    "commander_arm_denied_resolve_failures": (16910493, 98),
    "commander_arm_denied_calibrating": (18843603, 98),
    "commander_arm_denied_throttle_center": (18526277, 98),
    "commander_arm_denied_throttle_high": (22651936, 98),
    "commander_disarm_denied_not_landed": (25868725, 98),
    "commander_unsupported_auto_mode": (19869445, 51),
    "commander_modeswitch_not_avail": (27280279, 98),
    "commander_arming_check_summary": (27825120, 136),
    "commander_health_summary": (18691879, 136),
    "check_estimator_gnss_fusion_started": (32069699, 102),
    "check_estimator_gnss_fusion_stopped": (31476391, 102),
    "check_estimator_gps_fix_too_low": (29146769, 68),
    "check_estimator_gps_num_sats_too_low": (29871674, 68),
    "check_baro_no_data": (19966445, 51),
    "sensor_failover_baro": (26198989, 0),
    "sensor_failover_mag": (22148870, 0),
    "check_modes_cannot_takeoff": (18648929, 102),
    "check_modes_mission": (17154777, 102),
    "check_modes_offboard_signal": (19865031, 51),
    "check_modes_manual_control": (17231145, 68),
    "check_modes_local_pos": (30612409, 51),
    "check_modes_global_pos": (26788467, 51),
    "check_battery_low": (21826980, 68),
    "check_battery_critical": (19404811, 34),
    "check_accel_not_calibrated": (22222072, 51),
    "check_gyro_not_calibrated": (18103665, 51),
    "check_mag_not_calibrated": (33493753, 51),
    "check_failure_detector_roll": (25316113, 34),
    "check_system_flight_term_active": (29532170, 34),
    "check_external_modes_unavailable": (31525953, 51),
    "check_external_modes_unresponsive": (26592384, 34),
    "commander_failsafe_enter_low_bat": (28993875, 100),
    "commander_failsafe_enter_hold": (30481910, 66),
    "commander_failsafe_enter": (26528394, 66),
    "commander_failsafe_enter_generic": (31382480, 66),
    "commander_failsafe_enter_autopilot_disengaged": (29547634, 66),
    "commander_takeoff_detected": (21054825, 102),
    "commander_landing_detected": (26622124, 102),
    "commander_landing_current_pos": (20099806, 102),
    "commander_landing_prec_land": (25087420, 102),
    "commander_rtl": (20262116, 102),
    "commander_mission_start_denied_no_mission": (23844490, 98),
    "navigator_takeoff_default_alt": (20656071, 102),
    "navigator_takeoff_already_higher": (19098816, 99),
    "vrtl_return_at": (22161044, 102),
    "rtl_land_at_destination": (16962474, 102),
    "mavlink_rcv_sp_target_invalid": (22427557, 51),
    "mavlink_rcv_sp_target_unsup_coord": (28329281, 51),
    "mavlink_rcv_sp_target_gl_invalid_coord": (27739955, 51),
    "orbit_radius_exceeded": (18865022, 17),
    "commander_calib_rc_off": (26849815, 102),
    "commander_calib_rc_on": (23126771, 102),
    "mc_pos_ctrl_cruise_set": (32686809, 68),
    "mc_pos_ctrl_down_vel_set": (30857910, 68),
    "mc_pos_ctrl_hover_thrust_set": (20557127, 68),
    "mc_pos_ctrl_land_tilt_set": (20716921, 68),
    "mc_pos_ctrl_man_vel_back_set": (25483276, 68),
    "mc_pos_ctrl_man_vel_set": (30930440, 68),
    "mc_pos_ctrl_man_vel_side_set": (21843004, 68),
    "mc_pos_ctrl_tilt_set": (31358541, 68),
    "mc_pos_ctrl_up_vel_set": (22592207, 68),
    "mavlink_mission_mis_item_invalid": (33469040, 51),
    "mavlink_mission_no_transfer": (17216882, 51),
    "mavlink_mission_op_timeout": (25297520, 51),
    "mavlink_mission_seq_out_of_bounds": (30345769, 51),
    "mavlink_mission_wp_unexpected": (23752078, 51),
    "mavlink_mission_req_ignored": (32060428, 68),
    "mavlink_mission_partner_id_mismatch2": (20691444, 51),
    "mavlink_mission_mis_req_ignored_busy": (25790300, 51),
    "mavlink_mission_ignore_mis_count": (19532089, 51),
    "mavlink_mission_mis_item_busy": (25323968, 51),
    "mavlink_mission_ignore_clear": (20980031, 51),
    "mavlink_mission_getlist_busy": (21573515, 51),
    "mavlink_mission_partner_id_mismatch": (20866702, 51),
    "mavlink_mission_item_partner_id_mismatch": (23792908, 51),
    "mavlink_mission_state_busy": (25712744, 51),
    "check_failure_detector_pitch": (33522684, 34),
    "check_gf_violation_custom_gf": (16920235, 51),
    "check_gf_violation_max_hor_dist": (20842799, 51),
    "check_gf_violation_max_alt": (30700832, 51),
    "check_battery_emergency": (28121863, 34),
    "check_rc_dl_no_dllink": (23579003, 51),
    "check_mag_sys_has_mag_missing": (22720449, 51),
    "check_open_drone_id_missing": (26938432, 51),
    "check_parachute_missing": (32742900, 51),
    "check_missing_cpuload": (26044037, 51),
    "check_distance_sensor_missing": (30998685, 51),
    "check_optical_sensor_missing": (25569984, 51),
    "check_wind_too_high": (28190816, 68),
    "check_flight_time_limit": (31421834, 51),
    "check_mission_failure": (29582859, 51),
    "check_high_wind_warning": (22503920, 68),
    "commander_failsafe_enter_generic_hold": (21279712, 66),
    "commander_failsafe_enter_generic_warn": (30054617, 68),
    "commander_failsafe_enter_warn": (25334767, 68),
    "commander_failsafe_enter_crit_bat_warn": (19252160, 98),
    "commander_failsafe_enter_crit_low_bat_warn": (16828543, 96),
    "commander_low_bat_shutdown_failed": (22624381, 48),
    "commander_gcs_lost": (27571288, 100),
    "commander_mission_comp_lost": (27900317, 34),
    "commander_onboard_ctrl_regained": (27494155, 102),
    "commander_dl_regained": (31011876, 102),
    "commander_rc_lost": (22400324, 102),
    "commander_rc_regained": (17490621, 102),
    "commander_max_flight_time_warning_minutes": (23657844, 68),
    "commander_max_flight_time_warning_seconds": (24491452, 68),
    "navigator_reposition_outside_geofence": (30272452, 99),
    "navigator_change_altitude_outside_geofence": (18658125, 99),
    "commander_ctrl_high_latency_failed": (33368711, 98),
    "navigator_geofence_invalid_against_home": (27750677, 66),
    "navigator_geofence_invalid_against_cur_pos": (26209321, 66),
    "navigator_mis_starts_w_landing": (22901736, 99),
    "navigator_mis_unsup_cmd": (25552931, 67),
    "navigator_mis_vtol_items": (28298937, 99),
    "navigator_mis_takeoff_not_first": (33440290, 99),
    "navigator_mis_takeoff_too_low": (28985965, 99),
    "navigator_mis_takeoff_missing": (22271714, 99),
    "navigator_mis_land_missing": (25237137, 99),
    "navigator_mis_takeoff_or_land_missing": (29001630, 99),
    "navigator_mis_add_land_or_rm_to": (19546926, 99),
    "navigator_mis_add_to_or_rm_land": (33286782, 99),
    "feasibility_mis_in_air_landing_req": (19619824, 99),
    "navigator_mis_no_home_rel_alt": (20155474, 99),
    "navigator_mis_geofence_violation": (19608877, 99),
    "navigator_mis_geofence_no_home": (22572417, 99),
    "navigator_mission_failure_heading": (17487895, 98),
    "mission_execute": (32375217, 102),
    "mission_climb_before_start": (24986204, 102),
    "mission_finished": (24580612, 102),
    "mission_finished_loiter": (21455606, 102),
    "mission_not_valid_loiter": (20167372, 147),
    "mission_not_valid_refuse": (21631531, 147),
    "rtl_unsupported_mav_frame": (26128688, 51),
    "rtl_completed_loiter": (33502559, 102),
    "rtl_mission_land_climb": (27006470, 102),
    "logger_open_file_time": (17980399, 102),
    "logger_storage_full": (32826017, 51),
}

EVENT_QUEUE_LENGTH: Final = 20
"""Number of events that PX4 keeps for repeated requests."""


@dataclass(frozen=True, slots=True)
class StatusText:
    """A text for the operator; severity is MAV_SEVERITY."""

    id: int
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Event:
    """One event, with the fields of message EVENT."""

    sequence: int
    name: str
    id: int
    log_levels: int
    time_boot_ms: int
    arguments: bytes
    """ARGUMENTS_LENGTH bytes, filled up with zeros."""


ARGUMENTS_LENGTH: Final = 40
FIRST_SEQUENCE: Final = 0xFFFF - 9
"""First sequence number of PX4's events; the number wraps to 0 after ten events."""


class Announcer:
    """Numbers texts and events and passes them to the listeners."""

    def __init__(self, time_boot_ms: Callable[[], int]) -> None:
        self._time_boot_ms = time_boot_ms
        self._listeners: list[Callable[[StatusText | Event], None]] = []
        self._text_id = 0
        self.sequence = FIRST_SEQUENCE - 1
        self.recent: deque[Event] = deque(maxlen=EVENT_QUEUE_LENGTH)
        """The newest events, for repeated requests."""
        self._queued: list[StatusText | Event] | None = None

    def add_listener(self, listener: Callable[[StatusText | Event], None]) -> None:
        """Calls `listener` for each new text or event."""
        self._listeners.append(listener)

    def text(self, severity: int, text: str) -> None:
        """Sends a status text."""
        self._text_id = self._text_id % 0xFFFF + 1
        self._publish(StatusText(self._text_id, severity, text))

    def event(self, name: str, argument_format: str = "", *arguments: float) -> None:
        """Sends an event; arguments are packed little-endian with `argument_format`."""
        self._publish_event(name, *EVENTS[name], struct.pack("<" + argument_format, *arguments))

    def external_event(self, event_id: int, log_levels: int, arguments: bytes) -> None:
        """Sends an event of an external component; the simulator knows no name for the event."""
        self._publish_event("", event_id, log_levels, arguments)

    def _publish_event(self, name: str, event_id: int, log_levels: int, arguments: bytes) -> None:
        self.sequence = (self.sequence + 1) & 0xFFFF
        arguments = arguments.ljust(ARGUMENTS_LENGTH, b"\0")
        event = Event(self.sequence, name, event_id, log_levels, self._time_boot_ms(), arguments)
        self.recent.append(event)
        self._publish(event)

    def announce(
        self, severity: int, text: str, name: str, argument_format: str = "", *arguments: float
    ) -> None:
        """Sends a text and its event, as PX4 usually does."""
        self.text(severity, text + "\t")
        self.event(name, argument_format, *arguments)

    def pause(self) -> None:
        """Queues texts and events until `resume`, so that a command's acknowledgement is sent first."""
        self._queued = []

    def resume(self) -> None:
        """Sends the queued texts and events."""
        queued, self._queued = self._queued or [], None
        for announcement in queued:
            self._publish(announcement)

    def _publish(self, announcement: StatusText | Event) -> None:
        if self._queued is not None:
            self._queued.append(announcement)
            return
        for listener in tuple(self._listeners):
            listener(announcement)
