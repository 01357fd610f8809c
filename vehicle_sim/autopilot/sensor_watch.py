"""What a vehicle says of its sensors: a driver that fell silent, GNSS that is used again or no more."""

from __future__ import annotations

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.vehicle_view import VehicleView

FAILED_AFTER_S, NO_DATA_AFTER_S = 0.3, 1.0
"""A driver so long silent has failed; so long, and nothing valid is left of it."""
TIMEOUT = 4
"""Bit of sensor_failover_reason_t."""
FIX_3D = 3


class SensorWatch:
    """The sensors of one vehicle."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view, self._announcer = view, announcer
        self._heard_at_s = {"baro": view.time_s, "mag": view.time_s}
        self._failed = {"baro": False, "mag": False}
        self._gnss_used: bool | None = None

    def update(self) -> None:
        """Look once; call it each tick."""
        view, i = self._view, self._view.row
        now_s, sensors = view.time_s, view.simulation.sensors
        for name, fresh in (("baro", sensors.baro_fresh), ("mag", sensors.mag_fresh)):
            if fresh[i]:
                self._heard_at_s[name], self._failed[name] = now_s, False
            elif not self._failed[name] and now_s - self._heard_at_s[name] >= FAILED_AFTER_S:
                self._failed[name] = True
                self._announcer.text(0, f"{name.upper()} #0 failed:  TIMEOUT!\t")
                self._announcer.event(f"sensor_failover_{name}", "BH", 0, TIMEOUT)
        used = bool(view.simulation.fusion.gnss_pos[i])
        if used != self._gnss_used:
            # The first fusion after boot is told by nobody.
            if self._gnss_used is not None:
                self._announcer.event(f"check_estimator_gnss_fusion_{'started' if used else 'stopped'}")
            self._gnss_used = used if used or self._gnss_used is not None else None

    def silent(self, name: str) -> bool:
        """Whether nothing came from "baro" or "mag" for NO_DATA_AFTER_S."""
        return self._view.time_s - self._heard_at_s[name] >= NO_DATA_AFTER_S

    def gps_problem(self) -> str:
        """Why the newest fix does not satisfy EKF2_REQ_*; empty: it does, or was not looked at."""
        view, i = self._view, self._view.row
        if not view.simulation.fusion.gps_quality_bad[i]:
            return ""
        return "fix" if view.simulation.sensors.gps_fix_type[i] < FIX_3D else "satellites"
