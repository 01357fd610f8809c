"""Stick modes: conversion of stick deflections to setpoints in Position, Altitude, Stabilized and Acro, as in
PX4."""

from __future__ import annotations

import math

import numpy as np

from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.path import TICK_S, EstimateResets
from vehicle_sim.autopilot.setpoint_writer import SetpointWriter
from vehicle_sim.autopilot.sticks import Sticks
from vehicle_sim.autopilot.trajectory import Axis, advance_axis, plan
from vehicle_sim.frames import GRAVITY_M_S2, wrap_angle
from vehicle_sim.home import Home
from vehicle_sim.vehicle_view import VehicleView

ATTITUDE_RATE_MODES = frozenset({NavState.MANUAL, NavState.STABILIZED, NavState.ACRO})
"""Modes whose sticks control attitude or rates; a multicopter flies Manual as Stabilized."""
ALTITUDE_MODES = frozenset({NavState.ALTITUDE, NavState.ALTITUDE_CRUISE})
"""Modes whose sticks control tilt and climb rate. Altitude Cruise is flown as Altitude."""
STICK_MODES = ATTITUDE_RATE_MODES | ALTITUDE_MODES | {NavState.POSITION, NavState.POSITION_SLOW}
"""Modes that the pilot flies by sticks."""

TAKEOFF_THROTTLE = 0.3
"""A vehicle on the ground takes off at a throttle (-1..1) above this value."""
BRAKE_BOOST = 2.0
BRAKE_BOOST_TIME_CONSTANT_S = 0.8
"""Factor on the drag with centred sticks, and the time constant of a change of this factor."""
DRAG_ACCELERATION_FACTOR = 2.0
"""Factor on MPC_ACC_HOR, because the modelled drag takes half of the acceleration on average."""
STANDSTILL_M_S = 0.01
MAX_GAP_S = 2.5 * TICK_S
"""A longer time without a run of the task initializes the task again."""


class StickTasks:
    """The flight tasks of the modes that the pilot flies by sticks."""

    def __init__(self, view: VehicleView, setpoints: SetpointWriter, sticks: Sticks, home: Home) -> None:
        self._view = view
        self._home = home
        self._setpoints = setpoints
        self._sticks = sticks
        self._mode: NavState | None = None
        self._velocity_m_s = (0.0, 0.0)
        self._acceleration_m_s2 = (0.0, 0.0)
        self._kept_position_m: tuple[float, float] | None = None
        self._kept_down_m: float | None = None
        self._z = Axis()
        self._brake_boost = 1.0
        self._yaw_rad: float | None = None
        self._yaw_rate_rad_s = 0.0
        self._last_run_at_s = -math.inf
        self._resets = EstimateResets(view, np.zeros(1))

    # --- take-off ------------------------------------------------------------------------------------------

    def wants_to_climb(self) -> bool:
        """Whether the throttle would take off a vehicle on the ground."""
        return self._sticks.raw.throttle > TAKEOFF_THROTTLE

    # --- each tick -----------------------------------------------------------------------------------------

    def run(self, mode: NavState) -> None:
        """Runs one tick of a stick mode."""
        self._begin(mode)
        if mode is NavState.ACRO:
            thrust = 0.5 * (self._sticks.raw.throttle + 1.0)
            self._setpoints.rates(self._sticks.acro_rates_rad_s(), thrust)
        elif mode in ATTITUDE_RATE_MODES:
            self._stabilize()
        else:
            self._fly(mode)

    def stop_until_input(self, mode: NavState) -> bool:
        """Runs one tick of a stick mode without stick input: the vehicle stops until stick input returns.

        PX4 keeps the flight task and its speed setpoints while the vehicle stops.

        Returns:
            False if the last tick did not run this mode.
        """
        now_s = self._view.time_s
        if mode is not self._mode or now_s - self._last_run_at_s > MAX_GAP_S:
            return False
        self._last_run_at_s = now_s
        self._setpoints.trajectory(velocity_ned_m_s=(0.0, 0.0, 0.0))
        return True

    def _begin(self, mode: NavState) -> None:
        """Initializes the task from the vehicle's motion when the mode or stick control starts."""
        now_s, estimate = self._view.time_s, self._view.estimate
        if mode is not self._mode or now_s - self._last_run_at_s > MAX_GAP_S:
            vn, ve, vd = estimate.velocity_ned_m_s
            self._mode, self._velocity_m_s, self._acceleration_m_s2 = mode, (vn, ve), (0.0, 0.0)
            self._kept_position_m = self._kept_down_m = self._yaw_rad = None
            self._z.reset(estimate.position_ned_m[2], vd)
            self._brake_boost, self._yaw_rate_rad_s = 1.0, 0.0
            self._resets.discard()
        self._last_run_at_s = now_s
        self._follow_resets()

    def _follow_resets(self) -> None:
        """Shifts the setpoints by a reset of the estimate, so that the reset does not move the vehicle."""
        reset = self._resets.take()
        if reset is None:
            return
        (north, east, down), (vn, ve, vd) = (
            self._view.estimate.position_ned_m, self._view.estimate.velocity_ned_m_s,
        )  # fmt: skip
        if reset.horizontal_position and self._kept_position_m is not None:
            self._kept_position_m = north, east
        if reset.horizontal_velocity and self._kept_position_m is None:
            self._velocity_m_s = vn, ve
        if reset.height:
            self._z.position_m = down
            self._kept_down_m = None if self._kept_down_m is None else down
        if reset.vertical_velocity and self._kept_down_m is None:
            self._z.velocity_m_s = vd
        if self._yaw_rad is not None:
            self._yaw_rad = wrap_angle(self._yaw_rad + reset.heading_rad)

    def _stabilize(self) -> None:
        """Writes an attitude: tilt from the roll and pitch sticks, heading from the yaw stick, thrust from
        the throttle."""
        parameter, raw = self._view.parameter, self._sticks.raw
        tilt_max = math.radians(parameter("MPC_MAN_TILT_MAX"))
        roll, pitch = raw.right * tilt_max, -raw.forward * tilt_max
        tilt = math.hypot(roll, pitch)
        scale = min(1.0, tilt_max / tilt) if tilt > 0.0 else 1.0
        limited_tilt = tilt * scale
        sine_per_tilt = math.sin(0.5 * limited_tilt) / tilt if tilt > 1e-6 else 0.0
        qw, qx, qy = math.cos(0.5 * limited_tilt), roll * sine_per_tilt, pitch * sine_per_tilt
        yaw_rad, yaw_rate = self._turn()
        if math.isnan(yaw_rad):
            yaw_rad = self._view.estimate.yaw_ned_rad
        c, s = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
        hover_thrust = float(self._view.simulation.target.hover_thrust[self._view.row])
        self._setpoints.attitude(
            (c * qw, c * qx - s * qy, c * qy + s * qx, s * qw), self._sticks.thrust(hover_thrust), yaw_rate
        )

    def _fly(self, mode: NavState) -> None:
        yaw_rad, yaw_rate = self._turn()
        z, vz = self._vertical(mode)
        if mode in ALTITUDE_MODES:
            north, east = self._rotate_to_ne(*self._limited_stick())
            tilt_max = math.radians(self._view.parameter("MPC_MAN_TILT_MAX"))
            max_m_s2 = GRAVITY_M_S2 * math.tan(tilt_max)
            acceleration = (north * max_m_s2, east * max_m_s2, math.nan)
            self._setpoints.trajectory(
                (math.nan, math.nan, z), (math.nan, math.nan, vz), acceleration, yaw_rad, yaw_rate
            )
            return
        kept_position = self._horizontal(mode)
        n, e = kept_position if kept_position is not None else (math.nan, math.nan)
        (vn, ve), (an, ae) = self._velocity_m_s, self._acceleration_m_s2
        self._setpoints.trajectory((n, e, z), (vn, ve, vz), (an, ae, math.nan), yaw_rad, yaw_rate)

    # --- heading -------------------------------------------------------------------------------------------

    def _turn(self) -> tuple[float, float]:
        """Heading to keep, and yaw rate: the stick commands a rate; a centred stick keeps the heading."""
        parameter = self._view.parameter
        name = "MC_SLOW_DEF_YAWR" if self._mode is NavState.POSITION_SLOW else "MPC_MAN_Y_MAX"
        commanded_rate = self._sticks.shaped().yaw * math.radians(parameter(name))
        tau_s = parameter("MPC_MAN_Y_TAU")
        self._yaw_rate_rad_s += (commanded_rate - self._yaw_rate_rad_s) * TICK_S / (TICK_S + max(0.0, tau_s))
        turning = commanded_rate != 0.0 or abs(self._yaw_rate_rad_s) > math.radians(1.0)
        if turning:
            self._yaw_rad = None
            return math.nan, self._yaw_rate_rad_s
        self._yaw_rate_rad_s = 0.0
        if self._yaw_rad is None:
            self._yaw_rad = self._view.estimate.yaw_ned_rad
        return self._yaw_rad, 0.0

    def _rotate_to_ne(self, forward: float, right: float) -> tuple[float, float]:
        yaw = wrap_angle(self._yaw_rad if self._yaw_rad is not None else self._view.estimate.yaw_ned_rad)
        c, s = math.cos(yaw), math.sin(yaw)
        return c * forward - s * right, s * forward + c * right

    def _limited_stick(self) -> tuple[float, float]:
        """Pitch and roll sticks (forward, right); the length of this vector is limited to 1."""
        shaped = self._sticks.shaped()
        length = max(1.0, math.hypot(shaped.forward, shaped.right))
        return shaped.forward / length, shaped.right / length

    # --- horizontal ----------------------------------------------------------------------------------------

    def _horizontal(self, mode: NavState) -> tuple[float, float] | None:
        """Integrates the acceleration of the stick minus a drag to a velocity; both are equal at full speed.

        Returns:
            Position (north, east) to keep at standstill; None: the velocity is controlled.
        """
        parameter, estimate = self._view.parameter, self._view.estimate
        full_m_s = max(0.1, parameter("MPC_VEL_MANUAL"))
        max_m_s = min(full_m_s, parameter("MC_SLOW_DEF_HVEL")) if mode is NavState.POSITION_SLOW else full_m_s
        max_acceleration = DRAG_ACCELERATION_FACTOR * parameter("MPC_ACC_HOR") * max_m_s / full_m_s
        stick = self._limited_stick()
        centred = stick == (0.0, 0.0)
        boost = BRAKE_BOOST if centred else 1.0
        boost_gain = TICK_S / (TICK_S + BRAKE_BOOST_TIME_CONSTANT_S)
        self._brake_boost += boost_gain * (boost - self._brake_boost)
        if not centred and self._kept_position_m is not None:
            # The velocity starts from the last setpoint, so that the end of position control causes no jump.
            target, i = self._view.simulation.target, self._view.row
            vn, ve, _ = target.velocity_ned_m_s[i].tolist()
            self._velocity_m_s, self._kept_position_m = (vn, ve), None
        vn, ve = self._velocity_m_s
        speed = math.hypot(vn, ve)
        drag = self._brake_boost * max_acceleration / max_m_s
        if 0.0 < speed < 1.0:
            drag /= math.sqrt(speed)
        north, east = self._rotate_to_ne(*stick)
        commanded = (north * max_acceleration - drag * vn, east * max_acceleration - drag * ve)
        max_change = parameter("MPC_JERK_MAX") * TICK_S
        last_acceleration = self._acceleration_m_s2
        an, ae = (
            old + max(-max_change, min(max_change, new - old))
            for old, new in zip(last_acceleration, commanded, strict=True)
        )
        vn += 0.5 * (last_acceleration[0] + an) * TICK_S
        ve += 0.5 * (last_acceleration[1] + ae) * TICK_S
        if centred and (math.hypot(vn, ve) < STANDSTILL_M_S or self._would_reverse(vn, ve)):
            vn = ve = an = ae = 0.0
        self._velocity_m_s, self._acceleration_m_s2 = (vn, ve), (an, ae)
        if centred and vn == 0.0 and ve == 0.0 and self._kept_position_m is None:
            self._kept_position_m = estimate.position_ned_m[0], estimate.position_ned_m[1]
        return self._kept_position_m

    def _would_reverse(self, vn: float, ve: float) -> bool:
        """Whether this velocity setpoint is opposite to the last one."""
        old_n, old_e = self._velocity_m_s
        return vn * old_n + ve * old_e < 0.0

    # --- altitude ------------------------------------------------------------------------------------------

    def _vertical(self, mode: NavState) -> tuple[float, float]:
        """Setpoints of position and velocity down; a centred throttle keeps the altitude."""
        parameter, estimate = self._view.parameter, self._view.estimate
        throttle = self._sticks.shaped().throttle
        max_climb, max_descent = parameter("MPC_Z_VEL_MAX_UP"), parameter("MPC_Z_VEL_MAX_DN")
        if mode is NavState.POSITION_SLOW:
            slow_limit = parameter("MC_SLOW_DEF_VVEL")
            max_climb, max_descent = min(max_climb, slow_limit), min(max_descent, slow_limit)
        above_home_m = self._home.position_ned_m[2] - estimate.position_ned_m[2]
        low_m, high_m = parameter("MPC_LAND_ALT2"), parameter("MPC_LAND_ALT1")
        fraction = max(0.0, min(1.0, (above_home_m - low_m) / (high_m - low_m))) if high_m > low_m else 1.0
        land_speed = parameter("MPC_LAND_SPEED")
        max_descent = min(max_descent, land_speed + fraction * (max_descent - land_speed))
        commanded_m_s = -throttle * (max_climb if throttle > 0.0 else max(0.0, max_descent))
        climbing = commanded_m_s < self._z.velocity_m_s
        max_acceleration = parameter("MPC_ACC_UP_MAX" if climbing else "MPC_ACC_DOWN_MAX")
        advance_axis(self._z.row, TICK_S)
        plan(self._z.row, commanded_m_s, max_acceleration, parameter("MPC_JERK_MAX"))
        if throttle != 0.0 or abs(self._z.velocity_m_s) > STANDSTILL_M_S:
            self._kept_down_m = None
            return math.nan, self._z.velocity_m_s
        if self._kept_down_m is None:
            self._kept_down_m = estimate.position_ned_m[2]
        return self._kept_down_m, 0.0
