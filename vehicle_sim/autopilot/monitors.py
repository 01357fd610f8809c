"""What the commander keeps an eye on in flight: wind, flight time, attitude and motors."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.path import TICK_S
from vehicle_sim.vehicle_view import VehicleView

TERMINATION_DISABLED = 121212
"""CBRK_FLIGHTTERM's key."""
EARLY_TAKEOFF_S = 3.0
WIND_TIME_CONSTANT_S = 4.0
WIND_WARNING_EVERY_S = 60.0
TIME_WARNINGS_S = (120, 60, 30, 10)


class Monitors:
    """State of one vehicle; `update` each tick."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view, self._announcer = view, announcer
        self.attitude_failure = self.roll_failure = self.pitch_failure = False
        self.motor_failure = False
        self.flight_time_over = False
        self.wind_m_s = math.nan
        """Estimated from the drag (EKF2_DRAG_CTRL); NaN: not estimated."""
        self._tilted_since_s: dict[str, float] = {}
        self._idle_since_s: dict[int, float] = {}
        self._wind_ned: tuple[float, float] | None = None
        self._wind_warned_at_s = -math.inf
        self._took_off_at_s = math.nan
        self._warned_s = math.inf

    def update(self, *, armed: bool, landed: bool) -> None:
        """Look at everything once."""
        if not armed:
            self._forget()
        self._attitude(armed)
        self._motors(armed)
        self._flight_time(armed=armed, landed=landed)
        self._wind(landed)

    def _forget(self) -> None:
        self.motor_failure = self.flight_time_over = False
        self._idle_since_s.clear()
        self._took_off_at_s, self._warned_s = math.nan, math.inf

    # --- attitude and motors ---------------------------------------------------------------------------

    def _attitude(self, armed: bool) -> None:
        estimate = self._view.estimate
        self.roll_failure = self._tilted("FD_FAIL_R", estimate.roll_rad)
        self.pitch_failure = self._tilted("FD_FAIL_P", estimate.pitch_rad)
        self.attitude_failure = self.roll_failure or self.pitch_failure

    def _tilted(self, name: str, angle_rad: float) -> bool:
        limit_deg = self._view.parameter(name)
        if limit_deg <= 0.0 or abs(angle_rad) <= math.radians(limit_deg):
            self._tilted_since_s.pop(name, None)
            return False
        since_s = self._tilted_since_s.setdefault(name, self._view.time_s)
        return self._view.time_s - since_s >= self._view.parameter(name + "_TTRI")

    def _motors(self, armed: bool) -> None:
        """A motor that is asked for thrust and takes no current has failed."""
        if not armed or self._view.choice("FD_ACT_EN") != 1:
            return
        simulation, i, now_s = self._view.simulation, self._view.row, self._view.time_s
        health = simulation.motor_health[i].tolist()
        if min(health) > 0.0:
            self._idle_since_s.clear()
            return
        least = self._view.parameter("FD_ACT_MOT_THR")
        timeout_s = self._view.parameter("FD_ACT_MOT_TOUT") / 1000.0
        for motor, (signal, works) in enumerate(zip(simulation.motors_us[i].tolist(), health, strict=True)):
            if works > 0.0 or (signal - 1000.0) / 1000.0 <= least:
                self._idle_since_s.pop(motor, None)
                continue
            since_s = self._idle_since_s.setdefault(motor, now_s)
            self.motor_failure = self.motor_failure or now_s - since_s >= timeout_s

    # --- limits ----------------------------------------------------------------------------------------

    def _flight_time(self, *, armed: bool, landed: bool) -> None:
        limit_s = self._view.choice("COM_FLT_TIME_MAX")
        if not armed or landed:
            self._took_off_at_s = math.nan
        elif math.isnan(self._took_off_at_s):
            self._took_off_at_s = self._view.time_s
        if limit_s <= 0 or math.isnan(self._took_off_at_s):
            return
        left_s = limit_s - (self._view.time_s - self._took_off_at_s)
        self.flight_time_over = left_s <= 0.0
        for warning_s in TIME_WARNINGS_S:
            if 0.0 < left_s <= warning_s < min(self._warned_s, limit_s):
                self._warned_s = warning_s
                self._warn_of_time(warning_s)

    def _warn_of_time(self, seconds: int) -> None:
        if seconds >= 60:
            minutes = seconds // 60
            self._announcer.both(
                4, f"Approaching max flight time (system will RTL in {minutes} minutes)",
                "commander_max_flight_time_warning_minutes", "h", minutes,
            )  # fmt: skip
        else:
            self._announcer.both(
                4, f"Approaching max flight time (system will RTL in {seconds} seconds)",
                "commander_max_flight_time_warning_seconds", "h", seconds,
            )  # fmt: skip

    @property
    def wind_too_high(self) -> bool:
        """Above COM_WIND_MAX."""
        return math.isfinite(self.wind_m_s) and 0.0 < self._view.parameter("COM_WIND_MAX") < self.wind_m_s

    def _wind(self, landed: bool) -> None:
        if self._view.choice("EKF2_DRAG_CTRL") != 1 or landed:
            self._wind_ned, self.wind_m_s = None, math.nan
            return
        seen = self._wind_by_drag()
        if self._wind_ned is None:
            self._wind_ned = (0.0, 0.0)
        blend = TICK_S / WIND_TIME_CONSTANT_S
        north, east = self._wind_ned
        self._wind_ned = (north + blend * (seen[0] - north), east + blend * (seen[1] - east))
        self.wind_m_s = math.hypot(*self._wind_ned)
        warn_above = self._view.parameter("COM_WIND_WARN")
        now_s = self._view.time_s
        due = now_s - self._wind_warned_at_s > WIND_WARNING_EVERY_S
        if due and 0.0 < warn_above < self.wind_m_s:
            self._wind_warned_at_s = now_s
            text = f"High wind speed detected ({self.wind_m_s:.1f} m/s), landing advised"
            self._announcer.both(4, text, "check_high_wind_warning", "f", self.wind_m_s)

    def _wind_by_drag(self) -> tuple[float, float]:
        """Across the thrust accelerometers feel drag alone: their specific force is -k/m (v - wind)."""
        estimate, i = self._view.estimate, self._view.row
        ax, ay, _ = self._view.simulation.sensors.accel_frd_m_s2[i].tolist()
        drag_per_s = self._view.parameter("SIH_KDV") / max(self._view.parameter("SIH_MASS"), 1e-3)
        if drag_per_s <= 0.0:
            return (0.0, 0.0)
        cosine, sine = math.cos(estimate.yaw_ned_rad), math.sin(estimate.yaw_ned_rad)
        air_forward, air_right = -ax / drag_per_s, -ay / drag_per_s
        vn, ve, _ = estimate.velocity_ned_m_s
        return (
            vn - (air_forward * cosine - air_right * sine),
            ve - (air_forward * sine + air_right * cosine),
        )
