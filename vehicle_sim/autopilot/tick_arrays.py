"""Data of the ticks, as arrays with a row for each autopilot. An autopilot uses its own row; the compiled
ticks (`steady.py`) use all rows together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from vehicle_sim.autopilot.land_detector import LIMIT_COUNT, new_state
from vehicle_sim.autopilot.smoothing import SETTINGS, TRIPLET_SIZE
from vehicle_sim.autopilot.takeoff import TakeoffState
from vehicle_sim.autopilot.trajectory import SIZE, YAW_SIZE
from vehicle_sim.kernels import Blocks, Rows

DOWN, SETPOINT_DOWN, TILT, RAMP, MOTION_SIZE = range(5)
"""Columns of `motion`: estimated position down at the last tick [m]; velocity down of the last trajectory
setpoint [m/s] (NaN: none yet; setpoints on the ground are not stored); tilt limit after take-off [rad];
progress of the take-off ramp, 0 to 1."""


@dataclass(frozen=True, slots=True)
class TickArrays:
    """Arrays of N vehicles, NED."""

    axes: Blocks
    """(N, 3, `trajectory.SIZE`) axes of the trajectory."""
    settings: Rows
    """(N, `len(SETTINGS)`) parameters of the trajectory."""
    triplet: Rows
    """(N, `TRIPLET_SIZE`) waypoints of the trajectory (`smoothing.WaypointTriplet`)."""
    before_turn_m_s: Rows
    """(N, 1) speed of the trajectory before a turn."""
    yaw: Rows
    """(N, `YAW_SIZE`) heading of the trajectory."""
    last_heading_rad: Rows
    """(N, 1) estimated heading at the last check for resets of the estimate."""
    detector: Rows
    """(N, 9) conditions of the land detector (`land_detector.new_state`)."""
    detector_limits: Rows
    """(N, `LIMIT_COUNT`) thresholds of the land detector."""
    motion: Rows
    """(N, `MOTION_SIZE`) state between ticks; columns from `DOWN` to `RAMP`."""

    @classmethod
    def for_count(cls, count: int) -> TickArrays:
        """Arrays for this number of vehicles on the ground."""
        motion = np.zeros((count, MOTION_SIZE))
        motion[:, SETPOINT_DOWN] = np.nan
        return cls(
            axes=np.zeros((count, 3, SIZE)),
            settings=np.zeros((count, len(SETTINGS))),
            triplet=np.zeros((count, TRIPLET_SIZE)),
            before_turn_m_s=np.zeros((count, 1)),
            yaw=np.zeros((count, YAW_SIZE)),
            last_heading_rad=np.zeros((count, 1)),
            detector=np.tile(new_state(), (count, 1)),
            detector_limits=np.zeros((count, LIMIT_COUNT)),
            motion=motion,
        )


class Motion(IntEnum):
    """Kind of motion in a steady task."""

    CLIMB = 1
    DESCENT = 2
    LEG = 3
    STREAM = 4
    """Trajectory setpoints in Offboard; the autopilot writes the newest setpoint at each tick."""
    ON_GROUND = 5
    """On the ground with a downward acceleration setpoint, before take-off or after ground contact."""


class SteadyTask(NamedTuple):
    """A motion and its end conditions; NED, SI units. A condition that does not apply has its default."""

    motion: Motion
    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float
    """Three speed limits; NaN or infinite: the parameter applies (`smoothing.SpeedLimits`)."""
    target_down_m: float = math.nan
    """Target of a climb or descent, down in the local frame; NaN: a descent without a target altitude."""
    face_north_m: float = 0.0
    """The nose points to this position while the trajectory is farther away than `face_min_distance_m`."""
    face_east_m: float = 0.0
    face_min_distance_m: float = math.inf
    """Infinite: the heading does not change."""
    end_alt_amsl_m: float = math.inf
    """The climb ends above this estimated altitude."""
    end_down_m: float = -math.inf
    """The climb also ends at or above this altitude, given as position down."""
    end_north_m: float = 0.0
    """The leg ends within `end_radius_m` of this point."""
    end_east_m: float = 0.0
    end_radius_m: float = -1.0
    wait_start_s: float = math.inf
    """The motion ends `wait_duration_s` after this time, when a hold or the spool-up ends or the vehicle
    disarms."""
    wait_duration_s: float = 0.0
    takeoff: TakeoffState = TakeoffState.FLIGHT
    """Take-off state; a change ends the motion."""
    landing_stages: float = 0.0
    """`LandDetector.stages`; a change ends the motion."""


STREAM = SteadyTask(Motion.STREAM, math.nan, math.nan, math.nan)
"""Its fields contain no end condition: a change of mode or setpoint level, or a failsafe, ends the stream."""
ON_GROUND = SteadyTask(Motion.ON_GROUND, math.nan, math.nan, math.nan)
