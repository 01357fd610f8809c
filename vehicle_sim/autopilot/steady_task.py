"""Tasks that stay the same for many ticks, their end conditions, and the parameters of all steady ticks."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from vehicle_sim.autopilot.takeoff import TakeoffState
from vehicle_sim.vehicle_view import VehicleView


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


class SteadyLimits(NamedTuple):
    """Parameters that apply in every steady tick."""

    estimates_hover: float
    """1 if MPC_USE_HTE enables the hover thrust estimator, otherwise 0."""
    roll_failure_deg: float
    """FD_FAIL_R; infinite: not monitored."""
    pitch_failure_deg: float
    tilt_max_rad: float
    yaw_rate_max_rad_s: float
    land_alt1_m: float
    land_alt2_m: float
    land_alt3_m: float
    land_speed_m_s: float
    land_crawl_m_s: float
    takeoff_speed_m_s: float
    takeoff_ramp_s: float
    climb_max_m_s: float
    velocity_gain: float
    """MPC_Z_VEL_P_ACC."""

    @classmethod
    def for_vehicle(cls, view: VehicleView) -> SteadyLimits:
        """The limits of the vehicle's current parameters."""
        parameter = view.parameter
        roll_deg, pitch_deg = (
            limit if limit > 0.0 else math.inf for limit in (parameter("FD_FAIL_R"), parameter("FD_FAIL_P"))
        )
        return cls(
            float(view.choice("MPC_USE_HTE") != 0), roll_deg, pitch_deg,
            math.radians(parameter("MPC_TILTMAX_AIR")), math.radians(parameter("MPC_YAWRAUTO_MAX")),
            parameter("MPC_LAND_ALT1"), parameter("MPC_LAND_ALT2"), parameter("MPC_LAND_ALT3"),
            parameter("MPC_LAND_SPEED"), parameter("MPC_LAND_CRWL"), parameter("MPC_TKO_SPEED"),
            parameter("MPC_TKO_RAMP_T"), parameter("MPC_Z_VEL_MAX_UP"), parameter("MPC_Z_VEL_P_ACC"),
        )  # fmt: skip
