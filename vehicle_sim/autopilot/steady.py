"""Ticks of all autopilots; compiled loops run the ticks of vehicles in steady flight.

A tick is "steady" if it cannot change the state of the autopilot: no failsafe acts, no command is received,
and no mission item ends. Most ticks of an armed vehicle are steady. The compiled loops compute the steady
ticks of all vehicles together, with the same formulas and results as `Autopilot.update`, which runs all other
("full") ticks. The geofence and the arming checks run at their own rates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.land_detector import detect, landing_stages
from vehicle_sim.autopilot.path import GROUND_VELOCITY_DOWN_M_S, TICK_S
from vehicle_sim.autopilot.smoothing import NEXT, PREVIOUS, TARGET, fly_horizontal, fly_triplet, plan_vertical
from vehicle_sim.autopilot.steady_task import Motion, SteadyLimits
from vehicle_sim.autopilot.takeoff import TILT_LIMIT_RISE_RAD_S, TakeoffState, climb_limit
from vehicle_sim.autopilot.tick_arrays import DOWN, RAMP, SETPOINT_DOWN, TILT, TickArrays
from vehicle_sim.autopilot.trajectory import (
    ACCELERATION,
    POSITION,
    VELOCITY,
    YAW,
    YAW_RATE,
    YAW_TARGET,
    advance_axis,
    follow_heading,
    max_speed_for_distance,
    plan,
    turn,
)
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.kernels import Blocks, Column, Flags, IntegerRows, Integers, Rows, formula, kernel
from vehicle_sim.simulation import Simulation
from vehicle_sim.state import angles_of

(
    _MOTION, _CRUISE, _CLIMB, _DESCENT, _TARGET_DOWN, _FACE_NORTH, _FACE_EAST, _FACE_MIN_DISTANCE,
    _END_ALT_AMSL, _END_DOWN, _END_NORTH, _END_EAST, _END_RADIUS, _WAIT_START, _WAIT_DURATION,
    _TAKEOFF, _LANDING_STAGES, _HOME_DOWN, _ORIGIN_ALT, _TASK_SIZE,
) = range(20)  # fmt: skip
"""Columns of the tasks: `SteadyTask`, then the home position (down) and the altitude of the origin."""
(
    _ESTIMATES_HOVER, _ROLL_FAILURE, _PITCH_FAILURE, _TILT_MAX, _YAW_RATE_MAX, _LAND_ALT1, _LAND_ALT2,
    _LAND_ALT3, _LAND_SPEED, _LAND_CRAWL, _TAKEOFF_SPEED, _TAKEOFF_RAMP, _CLIMB_MAX, _VELOCITY_GAIN,
) = range(14)  # fmt: skip
"""Columns of the limits: `SteadyLimits`."""
_UP_SPEED, _DOWN_SPEED, _UP_ACCELERATION, _DOWN_ACCELERATION, _JERK = 2, 3, 5, 6, 7
"""Columns of `smoothing.SETTINGS`."""
_IS_CLIMB, _IS_DESCENT, _IS_STREAM = int(Motion.CLIMB), int(Motion.DESCENT), int(Motion.STREAM)
_IS_ON_GROUND = int(Motion.ON_GROUND)
_FLIGHT, _RAMPUP = int(TakeoffState.FLIGHT), int(TakeoffState.RAMPUP)
_TRAJECTORY = int(ControlLevel.TRAJECTORY)
_MARGIN = 1e-6
"""A vehicle this close to a threshold [m or degrees] gets a full tick, in which `Autopilot.update` compares
exactly."""


class SteadyTicks:
    """Runs the ticks of all autopilots.

    Args:
        simulation: the vehicles.
        arrays: the arrays of their autopilots.
    """

    def __init__(self, simulation: Simulation, arrays: TickArrays) -> None:
        count = simulation.count
        self._simulation, self._arrays = simulation, arrays
        self._tasks, self._limits = (
            np.zeros((count, _TASK_SIZE)),
            np.zeros((count, len(SteadyLimits._fields))),
        )
        self._reset_counts = np.zeros((count, 5), dtype=np.int64)
        self._stays_steady = np.zeros(count, dtype=np.bool_)
        self._rows: list[int] = []
        self._row_numbers = np.zeros(0, dtype=np.int64)

    def update(self, autopilots: Sequence[Autopilot]) -> None:
        """Runs one tick of these autopilots; call it at 50 Hz."""
        steady = [autopilot.row for autopilot in autopilots if autopilot.stays_steady()]
        if steady:
            self._detect(steady)
        steady_rows: list[int] = []
        stays_steady = self._stays_steady.tolist()  # plain values, because element access of arrays is slow
        for autopilot in autopilots:
            if not autopilot.steady:
                autopilot.update()
            elif not stays_steady[autopilot.row]:
                autopilot.update_after_detection()
            elif autopilot.update_steady():
                steady_rows.append(autopilot.row)
                continue
            self._begin(autopilot)
        if steady_rows:
            self._fly(steady_rows)

    def _begin(self, autopilot: Autopilot) -> None:
        """Begins a steady flight if the vehicle's next tick cannot change the state of its autopilot."""
        task = autopilot.begin_steady()
        if task is None:
            return
        row = autopilot.row
        home_down_m, origin_alt_m = autopilot.home.position_ned_m[2], autopilot.view.origin[2]
        self._tasks[row] = (*task, home_down_m, origin_alt_m)
        self._limits[row] = autopilot.steady_limits
        self._reset_counts[row] = autopilot.navigator.path.reset_counts

    def _row_array(self, rows: list[int]) -> Integers:
        if rows != self._rows:
            self._rows, self._row_numbers = rows, np.array(rows, dtype=np.int64)
        return self._row_numbers

    def _detect(self, rows: list[int]) -> None:
        simulation, arrays = self._simulation, self._arrays
        estimate, fusion = simulation.estimate, simulation.fusion
        _detect(
            self._row_array(rows), simulation.time_s, self._tasks, self._limits, self._reset_counts,
            arrays.detector, arrays.detector_limits, arrays.motion, estimate.position_ned_m,
            estimate.velocity_ned_m_s, estimate.q_ned_frd, estimate.rates_frd_rad_s, estimate.alt_amsl_m,
            estimate.origin_alt_amsl_m, estimate.height_above_ground_m, estimate.valid_velocity,
            estimate.valid_altitude, fusion.resets, fusion.heading_reset_counter, simulation.setpoints.level,
            simulation.target.thrust, simulation.target.hover_thrust, self._stays_steady,
        )  # fmt: skip

    def _fly(self, rows: list[int]) -> None:
        simulation, arrays = self._simulation, self._arrays
        estimate, setpoints = simulation.estimate, simulation.setpoints
        _fly(
            self._row_array(rows), self._tasks, self._limits, arrays.axes, arrays.settings, arrays.triplet,
            arrays.before_turn_m_s, arrays.yaw, arrays.last_heading_rad, arrays.motion,
            estimate.position_ned_m, estimate.q_ned_frd, estimate.height_above_ground_m,
            simulation.fusion.heading_good_for_control, setpoints.position_ned_m, setpoints.velocity_ned_m_s,
            setpoints.acceleration_ned_m_s2, setpoints.yaw_ned_rad, setpoints.yaw_rate_ned_rad_s,
            setpoints.tilt_limit_rad, setpoints.climb_limit_m_s,
        )  # fmt: skip


@formula
def _may_have_ended(task: Column, now_s: float, position: Column, alt_amsl_m: float) -> bool:
    """Whether the task may have reached one of its end conditions."""
    distance_m = math.hypot(task[_END_NORTH] - position[0], task[_END_EAST] - position[1])
    return (
        alt_amsl_m > task[_END_ALT_AMSL] - _MARGIN
        or position[2] <= task[_END_DOWN] + _MARGIN
        or distance_m <= task[_END_RADIUS] + _MARGIN
        or now_s - task[_WAIT_START] >= task[_WAIT_DURATION]
    )


@formula
def _was_reset(reset_counts: Integers, resets: IntegerRows, heading_resets: Integers, r: int) -> bool:
    for k in range(4):
        if resets[k, r] != reset_counts[k]:
            return True
    return heading_resets[r] != reset_counts[4]


@formula
def _ramp_ends(task: Column, limits: Column, motion: Column) -> bool:
    return task[_TAKEOFF] == _RAMPUP and motion[RAMP] + TICK_S / limits[_TAKEOFF_RAMP] >= 1.0


@formula
def _attitude_within_limits(limits: Column, q_ned_frd: Column) -> bool:
    roll, pitch, _ = angles_of(q_ned_frd)
    degrees = 180.0 / math.pi
    roll_fails = abs(roll * degrees) > limits[_ROLL_FAILURE] - _MARGIN
    return not roll_fails and not abs(pitch * degrees) > limits[_PITCH_FAILURE] - _MARGIN


@kernel
def _detect(
    rows: Integers, now_s: float, tasks: Rows, limits: Rows, reset_counts: IntegerRows, detector: Rows,
    detector_limits: Rows, motion: Rows, position: Rows, velocity: Rows, q_ned_frd: Rows, rates: Rows,
    alt_amsl_m: Column, origin_alt_m: Column, height_m: Column, valid_velocity: Flags, valid_altitude: Flags,
    resets: IntegerRows, heading_resets: Integers, level: Integers, thrust: Column, hover_thrust: Column,
    stays_steady: Flags,
) -> None:  # fmt: skip
    """Runs the land detectors; writes to `stays_steady` (N,) whether the vehicle's tick is steady."""
    for row in rows:
        r = int(row)
        down_m_s = (position[r, 2] - motion[r, DOWN]) / TICK_S
        motion[r, DOWN] = position[r, 2]
        vn, ve = 0.0, 0.0
        if valid_velocity[r]:
            vn, ve = velocity[r, 0], velocity[r, 1]
        takeoff = tasks[r, _TAKEOFF]
        detect(
            detector[r], detector_limits[r], now_s, True, thrust[r] if takeoff >= _RAMPUP else 0.0,
            hover_thrust[r], takeoff == _FLIGHT and limits[r, _ESTIMATES_HOVER] != 0.0, vn, ve,
            velocity[r, 2], down_m_s, valid_altitude[r], rates[r, 0], rates[r, 1], height_m[r], True,
            motion[r, SETPOINT_DOWN],
        )  # fmt: skip
        stays_steady[r] = (
            level[r] == _TRAJECTORY
            and origin_alt_m[r] == tasks[r, _ORIGIN_ALT]
            and landing_stages(detector[r]) == tasks[r, _LANDING_STAGES]
            and not _ramp_ends(tasks[r], limits[r], motion[r])
            and not _was_reset(reset_counts[r], resets, heading_resets, r)
            and _attitude_within_limits(limits[r], q_ned_frd[r])
            and not _may_have_ended(tasks[r], now_s, position[r], alt_amsl_m[r])
        )


@formula
def _climb(
    task: Column, limits: Column, axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column,
    position: Column,
) -> None:  # fmt: skip
    """One tick of `Climb.run`."""
    advanced_s = fly_horizontal(
        axes, settings, triplet, before_turn_m_s, TICK_S, position[0], position[1], True, task[_CRUISE]
    )
    axis = axes[2]
    near_home = task[_HOME_DOWN] - position[2] < limits[_LAND_ALT1]
    if near_home:
        axis[POSITION] = position[2]
    remaining_m = task[_TARGET_DOWN] - axis[POSITION]
    advance_axis(axis, advanced_s)
    max_speed, acceleration = settings[_UP_SPEED], settings[_UP_ACCELERATION]
    if remaining_m > 0.0:
        max_speed, acceleration = settings[_DOWN_SPEED], settings[_DOWN_ACCELERATION]
    elif near_home:
        max_speed = limits[_TAKEOFF_SPEED]
        if limits[_TAKEOFF_RAMP] > 0.0:
            acceleration = min(acceleration, max_speed / limits[_TAKEOFF_RAMP])
    speed_m_s = min(max_speed, max_speed_for_distance(settings[_JERK], acceleration, abs(remaining_m), 0.0))
    plan(axis, math.copysign(speed_m_s, remaining_m), acceleration, settings[_JERK])


@formula
def _land_speed(limits: Column, settings: Column, down_m: float, range_m: float) -> float:
    """Speed of `Descent` at this height above ground; without a range, at this position down."""
    height_m = -down_m if math.isnan(range_m) else range_m
    fast, slow = settings[_DOWN_SPEED], limits[_LAND_SPEED]
    high_m, low_m = limits[_LAND_ALT1], limits[_LAND_ALT2]
    if range_m <= limits[_LAND_ALT3]:
        return limits[_LAND_CRAWL]
    if height_m >= high_m:
        return fast
    if height_m > low_m and high_m > low_m:
        return slow + (fast - slow) * (height_m - low_m) / (high_m - low_m)
    return slow


@formula
def _descend(
    task: Column, limits: Column, axes: Rows, settings: Column, triplet: Column, before_turn_m_s: Column,
    position: Column, range_m: float,
) -> None:  # fmt: skip
    """One tick of `Descent.run`; without a target altitude, the target follows the trajectory's altitude."""
    if math.isnan(task[_TARGET_DOWN]) and triplet[TARGET + 2] != axes[2, POSITION]:
        for k in range(3):
            triplet[PREVIOUS + k], triplet[NEXT + k] = position[k], math.nan
        triplet[TARGET + 2] = axes[2, POSITION]
    advanced_s = fly_horizontal(
        axes, settings, triplet, before_turn_m_s, TICK_S, position[0], position[1], True, task[_CRUISE]
    )
    advance_axis(axes[2], advanced_s)
    plan_vertical(axes[2], settings, _land_speed(limits, settings, position[2], range_m))


@formula
def _stay_at_vehicle(axes: Rows, position: Column) -> None:
    """One tick of `Path.stay_at_vehicle`."""
    for k in range(3):
        axes[k, :] = 0.0
        axes[k, POSITION] = position[k]
    axes[2, VELOCITY] = GROUND_VELOCITY_DOWN_M_S


@formula
def _update_limits(
    task: Column, limits: Column, motion: Column, r: int, tilt_limit: Column, climb_limit_m_s: Column
) -> None:
    """Increases the tilt limit in flight, and the climb rate limit in the take-off ramp."""
    if task[_TAKEOFF] == _FLIGHT:
        motion[TILT] += TILT_LIMIT_RISE_RAD_S * TICK_S
        tilt_limit[r] = motion[TILT] if motion[TILT] < limits[_TILT_MAX] else math.nan
    elif task[_TAKEOFF] == _RAMPUP:
        motion[RAMP] += TICK_S / limits[_TAKEOFF_RAMP]
        climb_limit_m_s[r] = climb_limit(motion[RAMP], limits[_CLIMB_MAX], limits[_VELOCITY_GAIN])


@formula
def _face(task: Column, axes: Rows, yaw: Column) -> None:
    """Sets the heading target towards the point of the task."""
    north = task[_FACE_NORTH] - axes[0, POSITION]
    east = task[_FACE_EAST] - axes[1, POSITION]
    if math.hypot(north, east) > task[_FACE_MIN_DISTANCE]:
        yaw[YAW_TARGET] = math.atan2(east, north)


@kernel
def _fly(
    rows: Integers, tasks: Rows, limits: Rows, axes: Blocks, settings: Rows, triplet: Rows,
    before_turn_m_s: Rows, yaw: Rows, last_heading_rad: Rows, motion: Rows, position: Rows, q_ned_frd: Rows,
    range_m: Column, heading_good: Flags, setpoint_position: Rows, setpoint_velocity: Rows,
    setpoint_acceleration: Rows, setpoint_yaw: Column, setpoint_yaw_rate: Column, tilt_limit: Column,
    climb_limit_m_s: Column,
) -> None:  # fmt: skip
    """Advances the trajectories by one tick and writes the setpoints, except those of streams."""
    for row in rows:
        r = int(row)
        _update_limits(tasks[r], limits[r], motion[r], r, tilt_limit, climb_limit_m_s)
        kind = tasks[r, _MOTION]
        if kind == _IS_STREAM:
            continue
        last_heading_rad[r, 0] = angles_of(q_ned_frd[r])[2]
        if kind == _IS_ON_GROUND:
            _stay_at_vehicle(axes[r], position[r])
            continue
        if kind == _IS_CLIMB:
            _climb(tasks[r], limits[r], axes[r], settings[r], triplet[r], before_turn_m_s[r], position[r])
        elif kind == _IS_DESCENT:
            _descend(
                tasks[r],
                limits[r],
                axes[r],
                settings[r],
                triplet[r],
                before_turn_m_s[r],
                position[r],
                range_m[r],
            )
        else:
            _face(tasks[r], axes[r], yaw[r])
            fly_triplet(
                axes[r], settings[r], triplet[r], before_turn_m_s[r], TICK_S, position[r, 0], position[r, 1],
                tasks[r, _CRUISE], tasks[r, _CLIMB], tasks[r, _DESCENT],
            )  # fmt: skip
        if heading_good[r]:
            turn(yaw[r], TICK_S, limits[r, _YAW_RATE_MAX])
        else:
            follow_heading(yaw[r], last_heading_rad[r, 0])
        for k in range(3):
            setpoint_position[r, k] = axes[r, k, POSITION]
            setpoint_velocity[r, k] = axes[r, k, VELOCITY]
            setpoint_acceleration[r, k] = axes[r, k, ACCELERATION]
        setpoint_yaw[r], setpoint_yaw_rate[r] = yaw[r, YAW] if heading_good[r] else math.nan, yaw[r, YAW_RATE]
        motion[r, SETPOINT_DOWN] = axes[r, 2, VELOCITY]
