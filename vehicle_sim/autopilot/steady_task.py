"""A motion that needs no decision for many ticks: a climb, a descent, the leg of a mission, a stream, or a
vehicle that is pressed to the ground."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from vehicle_sim.autopilot.takeoff import TakeoffState
from vehicle_sim.vehicle_view import VehicleView


class Motion(IntEnum):
    """The flight task."""

    CLIMB = 1
    DESCENT = 2
    LEG = 3
    STREAM = 4
    """Trajectory setpoints in Offboard; the autopilot writes the newest setpoint at each tick."""
    PRESSED = 5
    """The vehicle is pressed to the ground, before take-off or after ground contact."""


class SteadyTask(NamedTuple):
    """A motion and its end conditions; NED, SI units. A condition that does not apply has its default."""

    motion: Motion
    cruise_m_s: float
    """Speed; not finite: the parameter applies. The same for the next two."""
    climb_m_s: float
    descent_m_s: float
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
    """The climb ends when the position down is at or below this value, so at or above this altitude."""
    end_north_m: float = 0.0
    """The leg ends within `end_radius_m` of this point."""
    end_east_m: float = 0.0
    end_radius_m: float = -1.0
    wait_start_s: float = math.inf
    """The motion ends `wait_duration_s` after this time: end of a hold, of the spool-up, or disarming."""
    wait_duration_s: float = 0.0
    takeoff: TakeoffState = TakeoffState.FLIGHT
    """A change of the take-off state ends the motion; so does the end of the take-off ramp."""
    landing_stages: float = 0.0
    """`LandDetector.stages`; a change ends the motion."""


STREAM = SteadyTask(Motion.STREAM, math.nan, math.nan, math.nan)
"""A task without end conditions. It ends when the mode or the level of the setpoints changes, or when a
failsafe acts."""
PRESSED = SteadyTask(Motion.PRESSED, math.nan, math.nan, math.nan)


class SteadyLimits(NamedTuple):
    """Parameters that apply in every steady tick."""

    estimates_hover: float
    """1: the hover thrust is estimated (MPC_USE_HTE)."""
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
