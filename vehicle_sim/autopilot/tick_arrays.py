"""Data of the ticks, as arrays with a row for each autopilot. An autopilot uses its own row; the compiled
ticks (`steady.py`) use all rows together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vehicle_sim.autopilot.land_detector import LIMIT_COUNT, new_state
from vehicle_sim.autopilot.smoothing import SETTINGS, TRIPLET_SIZE
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
