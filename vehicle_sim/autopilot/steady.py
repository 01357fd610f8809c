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
from vehicle_sim.autopilot.path import TICK_S
from vehicle_sim.autopilot.smoothing import (
    CLIMB_MAX_M_S,
    NEXT,
    PITCH_FAILURE_DEG,
    PREVIOUS,
    ROLL_FAILURE_DEG,
    TAKEOFF_RAMP_S,
    TARGET,
    TILT_MAX_DEG,
    USES_HOVER_ESTIMATE,
    VELOCITY_GAIN,
    YAW_ACCELERATION_DEG_S2,
    YAW_RATE_MAX_DEG_S,
    climb,
    descend,
    fly_triplet,
    stay_at,
)
from vehicle_sim.autopilot.takeoff import TILT_LIMIT_RISE_RAD_S, TakeoffState, climb_limit
from vehicle_sim.autopilot.tick_arrays import (
    DOWN,
    RAMP,
    SETPOINT_DOWN,
    TILT,
    Motion,
    SteadyTask,
    TickArrays,
)
from vehicle_sim.autopilot.trajectory import (
    ACCELERATION,
    POSITION,
    VELOCITY,
    YAW,
    YAW_RATE,
    YAW_TARGET,
    follow_heading,
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
_DEGREE = math.pi / 180.0
_IS_CLIMB, _IS_DESCENT, _IS_STREAM = int(Motion.CLIMB), int(Motion.DESCENT), int(Motion.STREAM)
_IS_ON_GROUND = int(Motion.ON_GROUND)
_FLIGHT, _RAMPUP = int(TakeoffState.FLIGHT), int(TakeoffState.RAMPUP)
_TRAJECTORY = int(ControlLevel.TRAJECTORY)
_MARGIN = 1e-6
"""A vehicle this close to a threshold [m or degrees] gets a full tick, in which `Autopilot.update` compares
exactly."""


def task_row(task: SteadyTask, home_down_m: float, origin_alt_m: float) -> tuple[float, ...]:
    """A row of the tasks of `fly_tasks`.

    Args:
        task: the motion and its end conditions.
        home_down_m: position down of home.
        origin_alt_m: altitude AMSL of the origin.
    """
    return (*task, home_down_m, origin_alt_m)


class SteadyTicks:
    """Runs the ticks of all autopilots.

    Args:
        simulation: the vehicles.
        arrays: the arrays of their autopilots.
    """

    def __init__(self, simulation: Simulation, arrays: TickArrays) -> None:
        count = simulation.count
        self._simulation, self._arrays = simulation, arrays
        self._tasks = np.zeros((count, _TASK_SIZE))
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
        self._tasks[row] = task_row(task, autopilot.home.position_ned_m[2], autopilot.view.origin[2])
        self._reset_counts[row] = autopilot.navigator.path.reset_counts

    def _row_array(self, rows: list[int]) -> Integers:
        if rows != self._rows:
            self._rows, self._row_numbers = rows, np.array(rows, dtype=np.int64)
        return self._row_numbers

    def _detect(self, rows: list[int]) -> None:
        simulation, arrays = self._simulation, self._arrays
        estimate, fusion = simulation.estimate, simulation.fusion
        _detect(
            self._row_array(rows), simulation.time_s, self._tasks, arrays.settings, self._reset_counts,
            arrays.detector, arrays.detector_limits, arrays.motion, estimate.position_ned_m,
            estimate.velocity_ned_m_s, estimate.q_ned_frd, estimate.rates_frd_rad_s, estimate.alt_amsl_m,
            estimate.origin_alt_amsl_m, estimate.height_above_ground_m, estimate.valid_velocity,
            estimate.valid_altitude, fusion.resets, fusion.heading_reset_counter, simulation.setpoints.level,
            simulation.target.thrust, simulation.target.hover_thrust, self._stays_steady,
        )  # fmt: skip

    def _fly(self, rows: list[int]) -> None:
        simulation, arrays = self._simulation, self._arrays
        estimate, setpoints = simulation.estimate, simulation.setpoints
        fly_tasks(
            self._row_array(rows), self._tasks, arrays.axes, arrays.settings, arrays.triplet,
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
def _ramp_ends(task: Column, settings: Column, motion: Column) -> bool:
    return task[_TAKEOFF] == _RAMPUP and motion[RAMP] + TICK_S / settings[TAKEOFF_RAMP_S] >= 1.0


@formula
def _attitude_within_limits(settings: Column, q_ned_frd: Column) -> bool:
    roll, pitch, _ = angles_of(q_ned_frd)
    degrees = 180.0 / math.pi
    max_roll, max_pitch = settings[ROLL_FAILURE_DEG], settings[PITCH_FAILURE_DEG]
    roll_fails = max_roll > 0.0 and abs(roll * degrees) > max_roll - _MARGIN
    return not roll_fails and not (max_pitch > 0.0 and abs(pitch * degrees) > max_pitch - _MARGIN)


@kernel
def _detect(
    rows: Integers, now_s: float, tasks: Rows, settings: Rows, reset_counts: IntegerRows, detector: Rows,
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
            hover_thrust[r], takeoff == _FLIGHT and settings[r, USES_HOVER_ESTIMATE] != 0.0, vn, ve,
            velocity[r, 2], down_m_s, valid_altitude[r], rates[r, 0], rates[r, 1], height_m[r], True,
            motion[r, SETPOINT_DOWN],
        )  # fmt: skip
        stays_steady[r] = (
            level[r] == _TRAJECTORY
            and origin_alt_m[r] == tasks[r, _ORIGIN_ALT]
            and landing_stages(detector[r]) == tasks[r, _LANDING_STAGES]
            and not _ramp_ends(tasks[r], settings[r], motion[r])
            and not _was_reset(reset_counts[r], resets, heading_resets, r)
            and _attitude_within_limits(settings[r], q_ned_frd[r])
            and not _may_have_ended(tasks[r], now_s, position[r], alt_amsl_m[r])
        )


@formula
def _follow_altitude(axes: Rows, triplet: Column, position: Column) -> None:
    """Without a target altitude, the target follows the trajectory's altitude (`Path._triplet_to`)."""
    if triplet[TARGET + 2] != axes[2, POSITION]:
        for k in range(3):
            triplet[PREVIOUS + k], triplet[NEXT + k] = position[k], math.nan
        triplet[TARGET + 2] = axes[2, POSITION]


@formula
def _update_limits(
    task: Column, settings: Column, motion: Column, r: int, tilt_limit: Column, climb_limit_m_s: Column
) -> None:
    """Increases the tilt limit in flight, and the climb rate limit in the take-off ramp."""
    if task[_TAKEOFF] == _FLIGHT:
        motion[TILT] += TILT_LIMIT_RISE_RAD_S * TICK_S
        tilt_limit[r] = motion[TILT] if motion[TILT] < settings[TILT_MAX_DEG] * _DEGREE else math.nan
    elif task[_TAKEOFF] == _RAMPUP:
        motion[RAMP] += TICK_S / settings[TAKEOFF_RAMP_S]
        climb_limit_m_s[r] = climb_limit(motion[RAMP], settings[CLIMB_MAX_M_S], settings[VELOCITY_GAIN])


@formula
def _face(task: Column, axes: Rows, yaw: Column, smooths_heading: bool) -> None:
    """Sets the heading target towards the point of the task; near it as `Path.kept_heading_rad`."""
    north = task[_FACE_NORTH] - axes[0, POSITION]
    east = task[_FACE_EAST] - axes[1, POSITION]
    if math.hypot(north, east) > task[_FACE_MIN_DISTANCE]:
        yaw[YAW_TARGET] = math.atan2(east, north)
    elif smooths_heading and math.isfinite(task[_FACE_MIN_DISTANCE]):
        yaw[YAW_TARGET] = yaw[YAW]


@kernel
def fly_tasks(
    rows: Integers, tasks: Rows, axes: Blocks, settings: Rows, triplet: Rows,
    before_turn_m_s: Rows, yaw: Rows, last_heading_rad: Rows, motion: Rows, position: Rows, q_ned_frd: Rows,
    range_m: Column, heading_good: Flags, setpoint_position: Rows, setpoint_velocity: Rows,
    setpoint_acceleration: Rows, setpoint_yaw: Column, setpoint_yaw_rate: Column, tilt_limit: Column,
    climb_limit_m_s: Column,
) -> None:  # fmt: skip
    """Advances the trajectories by one tick and writes the setpoints, except those of streams."""
    for row in rows:
        r = int(row)
        _update_limits(tasks[r], settings[r], motion[r], r, tilt_limit, climb_limit_m_s)
        kind = tasks[r, _MOTION]
        if kind == _IS_STREAM:
            continue
        acceleration_rad_s2 = settings[r, YAW_ACCELERATION_DEG_S2] * _DEGREE
        last_heading_rad[r, 0] = angles_of(q_ned_frd[r])[2]
        if kind == _IS_ON_GROUND:
            stay_at(axes[r], position[r, 0], position[r, 1], position[r, 2])
            continue
        if kind == _IS_CLIMB:
            climb(
                axes[r], settings[r], triplet[r], before_turn_m_s[r], TICK_S, position[r, 0], position[r, 1],
                position[r, 2], True, tasks[r, _CRUISE], tasks[r, _TARGET_DOWN], tasks[r, _HOME_DOWN],
            )  # fmt: skip
        elif kind == _IS_DESCENT:
            if math.isnan(tasks[r, _TARGET_DOWN]):
                _follow_altitude(axes[r], triplet[r], position[r])
            descend(
                axes[r], settings[r], triplet[r], before_turn_m_s[r], TICK_S, position[r, 0], position[r, 1],
                position[r, 2], True, tasks[r, _CRUISE], range_m[r],
            )  # fmt: skip
        else:
            _face(tasks[r], axes[r], yaw[r], acceleration_rad_s2 > 0.0)
            fly_triplet(
                axes[r], settings[r], triplet[r], before_turn_m_s[r], TICK_S, position[r, 0], position[r, 1],
                tasks[r, _CRUISE], tasks[r, _CLIMB], tasks[r, _DESCENT],
            )  # fmt: skip
        if heading_good[r]:
            turn(yaw[r], TICK_S, settings[r, YAW_RATE_MAX_DEG_S] * _DEGREE, acceleration_rad_s2)
        else:
            follow_heading(yaw[r], last_heading_rad[r, 0])
        for k in range(3):
            setpoint_position[r, k] = axes[r, k, POSITION]
            setpoint_velocity[r, k] = axes[r, k, VELOCITY]
            setpoint_acceleration[r, k] = axes[r, k, ACCELERATION]
        setpoint_yaw[r], setpoint_yaw_rate[r] = yaw[r, YAW] if heading_good[r] else math.nan, yaw[r, YAW_RATE]
        motion[r, SETPOINT_DOWN] = axes[r, 2, VELOCITY]
