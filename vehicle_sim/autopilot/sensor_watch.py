"""Reports sensors without data, sensors with stale data, and start and stop of GNSS fusion."""

from __future__ import annotations

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.vehicle_view import VehicleView

FAILED_AFTER_S = 0.3
"""PX4 reports a failed driver after this time without data."""
NO_DATA_AFTER_S = 1.0
"""The arming check fails after this time without data."""
STALE, TIMEOUT = 2, 4
"""Bits of sensor_failover_reason_t."""
FIX_3D = 3
"""GPS_FIX_TYPE."""


class SensorWatch:
    """Checks the sensors of one vehicle."""

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
