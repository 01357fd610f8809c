"""The commander's monitors of wind, flight time and attitude.

A stopped motor is detected only by the attitude failure that follows. PX4 can also detect a stopped motor by
ESC telemetry (FD_ACT_EN), but neither the simulated nor the recorded vehicle has ESC telemetry.
"""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.path import TICK_S
from vehicle_sim.frames import rotation_matrix
from vehicle_sim.vehicle_view import VehicleView

TERMINATION_DISABLED = 121212
"""Value of CBRK_FLIGHTTERM that disables flight termination."""
WIND_TIME_CONSTANT_S = 4.0
WIND_WARNING_EVERY_S = 60.0
AIR_DENSITY_KG_M3 = 1.225
MIN_TILT_COSINE = 0.1
"""Cosine of the largest tilt at which the horizontal wind can be estimated from the body axes."""
TIME_WARNINGS_S = (120, 60, 30, 10)
"""Remaining flight times at which the operator is warned."""


class Monitors:
    """The monitors of one vehicle; call `update` at each tick."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view, self._announcer = view, announcer
        self.attitude_failure = self.roll_failure = self.pitch_failure = False
        self.flight_time_over = False
        self.wind_m_s = math.nan
        """Wind speed estimated from the drag (EKF2_DRAG_CTRL); NaN: not estimated."""
        self._tilted_since_s: dict[str, float] = {}
        """Start of the excessive tilt, by the parameter of the limit."""
        self._wind_ne_m_s: tuple[float, float] | None = None
        self._wind_warned_at_s = -math.inf
        self._took_off_at_s = math.nan
        self._last_warning_s = math.inf
        """Remaining flight time of the last warning."""

    def update(self, *, armed: bool, landed: bool) -> None:
        """Updates all monitors."""
        if not armed:
            self._reset()
        self._check_attitude()
        self._check_flight_time(armed=armed, landed=landed)
        self._check_wind(landed)

    @property
    def needs_no_update(self) -> bool:
        """Whether roll and pitch are within their limits, and neither flight time nor wind is monitored."""
        return (
            not self._tilted_since_s
            and self._view.choice("COM_FLT_TIME_MAX") <= 0
            and self._view.choice("EKF2_DRAG_CTRL") != 1
        )

    def _reset(self) -> None:
        self.flight_time_over = False
        self._took_off_at_s, self._last_warning_s = math.nan, math.inf

    def _check_attitude(self) -> None:
        estimate = self._view.estimate
        roll_deg, pitch_deg = math.degrees(estimate.roll_rad), math.degrees(estimate.pitch_rad)
        self.roll_failure = self._exceeds_tilt("FD_FAIL_R", roll_deg)
        self.pitch_failure = self._exceeds_tilt("FD_FAIL_P", pitch_deg)
        self.attitude_failure = self.roll_failure or self.pitch_failure

    def _exceeds_tilt(self, name: str, angle_deg: float) -> bool:
        limit_deg = self._view.parameter(name)
        if limit_deg <= 0.0 or abs(angle_deg) <= limit_deg:
            if self._tilted_since_s:
                self._tilted_since_s.pop(name, None)
            return False
        since_s = self._tilted_since_s.setdefault(name, self._view.time_s)
        return self._view.time_s - since_s >= self._view.parameter(name + "_TTRI")

    # --- flight time and wind --------------------------------------------------------------------------

    def _check_flight_time(self, *, armed: bool, landed: bool) -> None:
        limit_s = self._view.choice("COM_FLT_TIME_MAX")
        if not armed or landed:
            self._took_off_at_s = math.nan
        elif math.isnan(self._took_off_at_s):
            self._took_off_at_s = self._view.time_s
        if limit_s <= 0 or math.isnan(self._took_off_at_s):
            return
        remaining_s = limit_s - (self._view.time_s - self._took_off_at_s)
        self.flight_time_over = remaining_s <= 0.0
        for warning_s in TIME_WARNINGS_S:
            if 0.0 < remaining_s <= warning_s < min(self._last_warning_s, limit_s):
                self._last_warning_s = warning_s
                self._warn_of_flight_time(warning_s)

    def _warn_of_flight_time(self, seconds: int) -> None:
        if seconds >= 60:
            minutes = seconds // 60
            self._announcer.announce(
                4, f"Approaching max flight time (system will RTL in {minutes} minutes)",
                "commander_max_flight_time_warning_minutes", "h", minutes,
            )  # fmt: skip
        else:
            self._announcer.announce(
                4, f"Approaching max flight time (system will RTL in {seconds} seconds)",
                "commander_max_flight_time_warning_seconds", "h", seconds,
            )  # fmt: skip

    @property
    def wind_too_high(self) -> bool:
        """Whether the wind is above COM_WIND_MAX."""
        return math.isfinite(self.wind_m_s) and 0.0 < self._view.parameter("COM_WIND_MAX") < self.wind_m_s

    def _check_wind(self, landed: bool) -> None:
        if self._view.choice("EKF2_DRAG_CTRL") != 1 or landed:
            self._wind_ne_m_s, self.wind_m_s = None, math.nan
            return
        new_n, new_e = self._wind_by_drag()
        north, east = self._wind_ne_m_s or (0.0, 0.0)
        weight = TICK_S / WIND_TIME_CONSTANT_S
        self._wind_ne_m_s = (north + weight * (new_n - north), east + weight * (new_e - east))
        self.wind_m_s = math.hypot(*self._wind_ne_m_s)
        warning_m_s = self._view.parameter("COM_WIND_WARN")
        now_s = self._view.time_s
        due = now_s - self._wind_warned_at_s > WIND_WARNING_EVERY_S
        if due and 0.0 < warning_m_s < self.wind_m_s:
            self._wind_warned_at_s = now_s
            text = f"High wind speed detected ({self.wind_m_s:.1f} m/s), landing advised"
            self._announcer.announce(4, text, "check_high_wind_warning", "f", self.wind_m_s)

    def _wind_by_drag(self) -> tuple[float, float]:
        """Wind velocity from the accelerations perpendicular to the thrust, with PX4's drag model.

        Wind is horizontal, so two body axes are enough. The model's parameters EKF2_MCOEF and EKF2_BCOEF_*
        are set by the user; wrong values give a wrong wind.
        """
        view, estimate = self._view, self._view.estimate
        ax, ay, _ = view.simulation.sensors.accel_frd_m_s2[view.row].tolist()
        momentum_per_s = view.parameter("EKF2_MCOEF")
        airspeed_x = _air_speed(-ax, momentum_per_s, view.parameter("EKF2_BCOEF_X"))
        airspeed_y = _air_speed(-ay, momentum_per_s, view.parameter("EKF2_BCOEF_Y"))
        matrix = rotation_matrix(np.array([estimate.q_ned_frd]))[0]
        (nx, ny, _), (ex, ey, _), (dx, dy, _) = matrix.tolist()
        vn, ve, vd = estimate.velocity_ned_m_s
        # The parts of the airspeed that horizontal motion causes.
        forward, right = airspeed_x - dx * vd, airspeed_y - dy * vd
        tilt_cosine = nx * ey - ny * ex
        if abs(tilt_cosine) < MIN_TILT_COSINE:
            return self._wind_ne_m_s or (0.0, 0.0)
        wind_n = vn - (forward * ey - right * ex) / tilt_cosine
        return wind_n, ve - (right * nx - forward * ny) / tilt_cosine


def _air_speed(drag_m_s2: float, momentum_per_s: float, ballistic_kg_m2: float) -> float:
    """The airspeed along an axis that causes this drag.

    Args:
        drag_m_s2: deceleration.
        momentum_per_s: EKF2_MCOEF, drag proportional to the speed; 0.001 or less: no such drag.
        ballistic_kg_m2: EKF2_BCOEF_*, drag proportional to the squared speed, as mass / (frontal area · drag
            coefficient); 1 or less: no such drag.
    """
    square_per_m = 0.5 * AIR_DENSITY_KG_M3 / ballistic_kg_m2 if ballistic_kg_m2 > 1.0 else 0.0
    linear_per_s = momentum_per_s if momentum_per_s > 1e-3 else 0.0
    drag_size_m_s2 = abs(drag_m_s2)
    root = math.sqrt(linear_per_s**2 + 4.0 * square_per_m * drag_size_m_s2)
    # Form of the quadratic root that is also valid if one of the two terms is missing.
    speed = 2.0 * drag_size_m_s2 / (linear_per_s + root) if linear_per_s + root > 0.0 else 0.0
    return math.copysign(speed, drag_m_s2)
