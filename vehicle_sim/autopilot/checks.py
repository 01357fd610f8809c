"""Runs the arming checks, and reports their results when they change."""

from __future__ import annotations

import math

from vehicle_sim.autopilot import health
from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.geofence import Breach
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.monitors import Monitors
from vehicle_sim.autopilot.offboard import Offboard
from vehicle_sim.external_modes.registry import ExternalModes
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import VehicleView

FIRST_REPORT_AFTER_S = 1.0
"""Time since boot before which no report is sent."""
POSITION_RECOVERY_S = 1.0
"""A lost position must be valid for this long before modes may use it again."""
GCS_TIMEOUT_S = 2.5
"""A ground station counts as connected for this long after a heartbeat; then COM_DL_LOSS_T starts."""
COMPANION_TIMEOUT_S = 3.0
"""An onboard computer counts as connected for this long after a heartbeat; then COM_OBC_LOSS_T starts."""
REPORT_EVERY_S = 2.05
"""Minimum interval between reports; a failsafe or a command sends a report earlier."""
BATTERY_TEXTS = {
    "check_battery_low": "Low battery",
    "check_battery_critical": "Critical battery",
    "check_battery_emergency": "Emergency battery level",
}
CALIBRATIONS = (
    ("accel", "CAL_ACC0_ID", 1310988), ("gyro", "CAL_GYRO0_ID", 1310988), ("mag", "CAL_MAG0_ID", 197388),
)  # fmt: skip
"""Sensor, parameter with the id of the calibrated sensor, and id of the installed sensor."""
EMERGENCY = 3
"""`battery_warning` at the emergency level."""
_BATTERY_LEVELS = ((EMERGENCY, "BAT_EMERGEN_THR"), (2, "BAT_CRIT_THR"), (1, "BAT_LOW_THR"))
FAILED_AFTER_S = 0.3
"""PX4 reports a failed driver after this time without data."""
NO_DATA_AFTER_S = 1.0
"""The arming check fails after this time without data."""
STALE, TIMEOUT = 2, 4
"""Bits of sensor_failover_reason_t."""
FIX_3D = 3
"""GPS_FIX_TYPE."""


class SensorWatch:
    """Reports sensors of one vehicle without data, stale data, and start and stop of GNSS fusion."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view, self._announcer = view, announcer
        self._received_at_s = {"baro": view.time_s, "mag": view.time_s}
        self._failed = {"baro": False, "mag": False}
        self._gnss_used = False

    def update(self, *, armed: bool) -> None:
        """Reports changes; call before each arming check. The use of GNSS is reported only while armed."""
        view, i = self._view, self._view.row
        now_s, sensors = view.time_s, view.simulation.sensors
        for name, fresh, stale in (
            ("baro", sensors.baro_fresh.item(i), sensors.baro_stale.item(i)),
            ("mag", sensors.mag_fresh.item(i), sensors.mag_stale.item(i)),
        ):
            if fresh or stale:
                self._received_at_s[name] = now_s
            if fresh:
                self._failed[name] = False
            elif not self._failed[name] and (stale or now_s - self._received_at_s[name] >= FAILED_AFTER_S):
                self._failed[name] = True
                reason, reason_text = (STALE, "STALE") if stale else (TIMEOUT, "TIMEOUT")
                self._announcer.text(0, f"{name.upper()} #0 failed:  {reason_text}!\t")
                self._announcer.event(f"sensor_failover_{name}", "BH", 0, reason)
        gnss_used = view.simulation.fusion.gnss_pos.item(i)
        if gnss_used != self._gnss_used:
            if armed:
                self._announcer.event(f"check_estimator_gnss_fusion_{'started' if gnss_used else 'stopped'}")
            self._gnss_used = gnss_used

    def note_fresh_data(self) -> None:
        """Replaces `update` while both sensors send fresh data and the use of GNSS has not changed."""
        self._received_at_s["baro"] = self._received_at_s["mag"] = self._view.time_s

    def timed_out(self, name: str) -> bool:
        """Whether "baro" or "mag" has sent no data for NO_DATA_AFTER_S."""
        return self._view.time_s - self._received_at_s[name] >= NO_DATA_AFTER_S

    def gps_problem(self) -> str:
        """Why the newest fix does not satisfy EKF2_REQ_*; empty: no problem, or not checked."""
        view, i = self._view, self._view.row
        if not view.simulation.fusion.gps_quality_bad[i]:
            return ""
        return "fix" if view.simulation.sensors.gps_fix_type[i] < FIX_3D else "satellites"


class Checks:
    """The arming checks of one vehicle."""

    def __init__(
        self,
        view: VehicleView,
        announcer: Announcer,
        offboard: Offboard,
        home: Home,
        monitors: Monitors,
        external: ExternalModes,
    ) -> None:
        self._view = view
        self._announcer = announcer
        self.offboard = offboard
        self._home = home
        self.external = external
        self.has_mission = False
        self.logging = True
        """Whether a log is written, or no log is required; set by the logger."""
        self.fence: frozenset[Breach] = frozenset()
        """The violated parts of the geofence."""
        self.monitors = monitors
        self.sensors = SensorWatch(view, announcer)
        self._had_position = False
        self.position_usable_at_s = -math.inf
        self._gcs_was_lost = False
        self._sticks_lost_at_s: float | None = None
        self.manual_control_at_s = -math.inf
        self.gcs_heartbeat_at_s = -math.inf
        self.companion_heartbeat_at_s = -math.inf
        self._companion_was_lost = False
        self._was_emergency = False
        self._battery_levels: tuple[tuple[int, float], ...] = ()
        self._parameter_values: tuple[object, ...] = ()
        self._parameters_revision = -1
        """`parameter_changes` at which the parameters were read."""
        self._inputs: tuple[object, ...] = ()
        self.report = self.current_report(NavState.HOLD, armed=False, terminated=False)
        self._announced: health.CheckResults | None = None
        self._announced_at_s = -math.inf
        self.has_unreported_change = True
        """Whether a change has not been reported yet."""

    def _read_inputs(self, mode: NavState, *, armed: bool, terminated: bool) -> tuple[object, ...]:
        """The first inputs in the order of `health.CheckInputs`: those that can change in flight."""
        view, estimate, monitors, sensors = self._view, self._view.estimate, self.monitors, self.sensors
        position_usable = self.position_usable
        wind_too_high = monitors.wind_too_high
        distance_sensors = 2 if view.simulation.world.lidars.forward else 1
        return (
            mode,
            armed,
            estimate.valid_attitude,
            position_usable and estimate.valid_velocity,
            position_usable and self._home.valid,
            self.has_mission,
            self.offboard.has_signal(),
            self.has_manual_control(),
            view.choice("NAV_DLL_ACT") > 0 and not self.gcs_connected(),
            self.battery_warning,
            terminated,
            self.fence,
            monitors.roll_failure,
            monitors.pitch_failure,
            wind_too_high,
            round(monitors.wind_m_s, 1) if wind_too_high else 0.0,
            monitors.flight_time_over,
            self.logging,
            sensors.timed_out("baro"),
            sensors.timed_out("mag"),
            view.simulation.fusion.gnss_pos.item(view.row),
            "" if armed else sensors.gps_problem(),
            distance_sensors,
            self.external.health(),
        )

    def _read_parameters(self) -> None:
        """Reads the last inputs in the order of `health.CheckInputs`, and the battery thresholds."""
        view = self._view
        self._parameters_revision = view.parameter_changes
        self._parameter_values = (
            bool(view.choice("COM_ARM_MIS_REQ")),
            tuple(sensor for sensor, name, device_id in CALIBRATIONS if view.choice(name) != device_id),
            view.choice("SYS_HAS_MAG"),
            view.choice("COM_ARM_ODID"),
            view.choice("COM_PARACHUTE") > 0,
            view.choice("SYS_HAS_NUM_DIST"),
            view.choice("SYS_HAS_NUM_OF") > 0,
            view.parameter("COM_CPU_MAX") > 0.0 or view.parameter("COM_RAM_MAX") > 0.0,
        )
        self._battery_levels = tuple((level, view.parameter(name)) for level, name in _BATTERY_LEVELS)
        self._inputs = ()

    @property
    def position_usable(self) -> bool:
        """Whether the position is valid; after a loss, whether it has been valid for POSITION_RECOVERY_S."""
        return self._view.estimate.valid_position and self._view.time_s >= self.position_usable_at_s

    def _watch_sensors(self, armed: bool) -> None:
        """Records a lost position, and reports sensors that send no data or that are no longer used."""
        view = self._view
        if view.estimate.valid_position:
            self._had_position = True
        elif self._had_position:
            self.position_usable_at_s = view.time_s + POSITION_RECOVERY_S
        self.sensors.update(armed=armed)

    def has_manual_control(self) -> bool:
        """Whether stick input was received recently."""
        return self._view.time_s - self.manual_control_at_s < self._view.parameter("COM_RC_LOSS_T")

    @property
    def has_been_connected(self) -> bool:
        """Whether sticks, a ground station or an onboard computer have been connected since boot."""
        never = -math.inf
        return (
            self.manual_control_at_s != never
            or self.gcs_heartbeat_at_s != never
            or self.companion_heartbeat_at_s != never
        )

    def gcs_connected(self) -> bool:
        """Whether a ground station is connected, or was connected within COM_DL_LOSS_T."""
        return self._view.time_s - self.gcs_heartbeat_at_s < GCS_TIMEOUT_S + self._view.choice(
            "COM_DL_LOSS_T"
        )

    def gcs_lost(self) -> bool:
        """Whether the connection to a ground station was lost."""
        return math.isfinite(self.gcs_heartbeat_at_s) and not self.gcs_connected()

    def report_losses(self, *, armed: bool) -> None:
        """Reports loss and recovery of sensors, manual control, onboard computer and ground station, and a
        battery emergency."""
        self._watch_sensors(armed)
        self._watch_battery()
        self._watch_sticks()
        self._watch_companion()
        lost = self.gcs_lost()
        if lost == self._gcs_was_lost:
            return
        self._gcs_was_lost = lost
        if lost:
            self._announcer.announce(4, "Connection to ground control station lost", "commander_gcs_lost")
        else:
            self._announcer.announce(6, "GCS connection regained", "commander_dl_regained")

    def _watch_battery(self) -> None:
        """Reports that the board refuses the shutdown which PX4 requests in a battery emergency."""
        emergency = self.battery_warning >= EMERGENCY
        if emergency and not self._was_emergency:
            self._announcer.announce(
                2, "System does not support shutdown", "commander_low_bat_shutdown_failed"
            )
        self._was_emergency = emergency

    def _watch_companion(self) -> None:
        heartbeat_at_s = self.companion_heartbeat_at_s
        limit_s = COMPANION_TIMEOUT_S + self._view.choice("COM_OBC_LOSS_T")
        lost = math.isfinite(heartbeat_at_s) and self._view.time_s - heartbeat_at_s >= limit_s
        if lost == self._companion_was_lost:
            return
        self._companion_was_lost = lost
        if lost:
            self._announcer.announce(2, "Connection to mission computer lost", "commander_mission_comp_lost")
        else:
            self._announcer.announce(6, "Onboard controller regained", "commander_onboard_ctrl_regained")

    def _watch_sticks(self) -> None:
        lost = math.isfinite(self.manual_control_at_s) and not self.has_manual_control()
        if lost and self._sticks_lost_at_s is None:
            self._sticks_lost_at_s = self._view.time_s
            self._announcer.event("commander_rc_lost")
        elif not lost and self._sticks_lost_at_s is not None:
            lost_for_s, self._sticks_lost_at_s = self._view.time_s - self._sticks_lost_at_s, None
            self._announcer.event("commander_rc_regained", "f", lost_for_s)

    @property
    def battery_warning(self) -> int:
        """0 normal, 1 low, 2 critical, 3 emergency."""
        if self._parameters_revision != self._view.parameter_changes:
            self._read_parameters()
        remaining = self._view.simulation.battery.remaining.item(self._view.row)
        for level, threshold in self._battery_levels:
            if remaining < threshold:
                return level
        return 0

    def current_report(self, mode: NavState, *, armed: bool, terminated: bool) -> health.CheckResults:
        """Returns the current report without sending it; runs the checks only if an input has changed."""
        inputs = self._read_inputs(mode, armed=armed, terminated=terminated)
        if inputs != self._inputs:
            self._inputs = inputs
            self._current = health.run_checks(health.CheckInputs._make((*inputs, *self._parameter_values)))
        return self._current

    def run(self, mode: NavState, *, armed: bool, terminated: bool) -> None:
        """Runs the checks, and sends a changed report at most every REPORT_EVERY_S."""
        report = self.current_report(mode, armed=armed, terminated=terminated)
        if report is not self.report and report != self.report:
            self.has_unreported_change = True
        self.report = report
        if self.has_unreported_change and self._view.time_s - self._announced_at_s >= REPORT_EVERY_S:
            self.announce()

    def announce_changes(self) -> None:
        """Sends a changed report immediately; called before a failsafe is announced."""
        if self.has_unreported_change:
            self.announce(texts=False)

    def announce(self, *, texts: bool = True) -> None:
        """Sends the report, but not before FIRST_REPORT_AFTER_S.

        Args:
            texts: whether to send the status texts of a new battery level and of a missing ground station.
        """
        previous = self._announced
        if self._view.time_s <= FIRST_REPORT_AFTER_S:
            return
        self._announced, self._announced_at_s = self.report, self._view.time_s
        self.has_unreported_change = False
        health.send_report(self.report, self._announcer)
        if not texts:
            return
        new_events = {finding.event for finding in self.report.findings}
        old_events = {finding.event for finding in previous.findings} if previous else set[str]()
        for event, text in BATTERY_TEXTS.items():
            if event in new_events - old_events:
                self._announcer.text(0, text + "\t")
        if "check_rc_dl_no_dllink" in new_events - old_events and not math.isfinite(self.gcs_heartbeat_at_s):
            self._announcer.text(4, "Preflight Fail: No connection to the ground control station\t")
