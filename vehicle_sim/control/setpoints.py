"""Setpoints of the controllers: the only data that flight modes pass to the controllers.

A mode writes rows of `Setpoints` between two steps; the controllers change only `override_level`. NaN in a
trajectory setpoint means "not controlled".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


class ControlLevel(IntEnum):
    """The controller that receives a vehicle's setpoint, from the lowest level (motors) to the highest."""

    DISARMED = 0
    """No controller runs. The motors idle while the vehicle is armed, otherwise they stop."""
    MOTORS = 1
    """`motors` go to the motors unchanged."""
    THRUST_TORQUE = 2
    """`torque_frd` and `thrust` go to the mixer."""
    RATES = 3
    """`rates_frd_rad_s` and `thrust`."""
    ATTITUDE = 4
    """`q_ned_frd`, `thrust`, optionally `yaw_rate_ned_rad_s`."""
    TRAJECTORY = 5
    """Position, velocity, acceleration, yaw and yaw rate, each NaN where not controlled."""


def _nan(*shape: int) -> FloatArray:
    return np.full(shape, np.nan)


@dataclass(slots=True)
class Setpoints:
    """Setpoints of N vehicles; the autopilot writes the arrays in place.

    NED metres and radians; `q_ned_frd` is (w, x, y, z); thrust is collective, 0..1, up positive.
    """

    level: IntArray
    """(N,) values of ControlLevel."""
    armed: BoolArray
    """(N,)."""
    position_ned_m: FloatArray
    """(N, 3)."""
    velocity_ned_m_s: FloatArray
    """(N, 3); feed-forward if the position is also controlled."""
    acceleration_ned_m_s2: FloatArray
    """(N, 3); feed-forward if position or velocity is also controlled."""
    yaw_ned_rad: FloatArray
    """(N,)."""
    yaw_rate_ned_rad_s: FloatArray
    """(N,)."""
    q_ned_frd: FloatArray
    """(N, 4)."""
    thrust: FloatArray
    """(N,) 0..1, levels ATTITUDE, RATES and THRUST_TORQUE."""
    rates_frd_rad_s: FloatArray
    """(N, 3), level RATES."""
    torque_frd: FloatArray
    """(N, 3) normalised -1..1, level THRUST_TORQUE; NaN counts as zero."""
    motors: FloatArray
    """(N, 4) 0..1, level MOTORS; a motor with NaN or a negative value stops."""
    override_level: IntArray
    """(N,) level of a setpoint that was received while the vehicle is controlled at a higher level; DISARMED:
    no such setpoint. ATTITUDE and RATES apply until the outer controllers write again, THRUST_TORQUE and
    MOTORS for one step. The cascade resets the value to DISARMED."""
    ramp_thrust: BoolArray
    """(N,) vehicles in the take-off ramp: the hover thrust is MPC_THR_HOVER, and the feed-forward of the
    vertical acceleration is ignored."""
    thrust_limit: FloatArray
    """(N,) upper limit of the collective thrust at level TRAJECTORY, 0..1."""
    min_thrust: FloatArray
    """(N,) lower limit of the collective thrust at level TRAJECTORY; NaN: MPC_THR_MIN."""
    climb_limit_m_s: FloatArray
    """(N,) upper limit of the climb rate; NaN: MPC_Z_VEL_MAX_UP; the take-off ramp reduces this limit."""
    descent_limit_m_s: FloatArray
    """(N,) upper limit of the descent rate; NaN: MPC_Z_VEL_MAX_DN; automatic modes increase this limit."""
    tilt_limit_rad: FloatArray
    """(N,) upper limit of the tilt; NaN: MPC_TILTMAX_AIR; near the ground it is MPC_TILTMAX_LND."""
    landed: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(N,) vehicles that are landed or in ground contact; their rate integrators are not updated."""
    in_air: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(N,) vehicles that are not landed; the estimator uses the range finder of these vehicles."""

    @classmethod
    def idle(cls, count: int) -> Setpoints:
        """Setpoints of disarmed vehicles without commands."""
        return cls(
            level=np.zeros(count, dtype=np.int64),
            armed=np.zeros(count, dtype=np.bool_),
            position_ned_m=_nan(count, 3),
            velocity_ned_m_s=_nan(count, 3),
            acceleration_ned_m_s2=_nan(count, 3),
            yaw_ned_rad=_nan(count),
            yaw_rate_ned_rad_s=_nan(count),
            q_ned_frd=np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1)),
            thrust=np.zeros(count),
            rates_frd_rad_s=np.zeros((count, 3)),
            torque_frd=np.zeros((count, 3)),
            motors=_nan(count, 4),
            override_level=np.zeros(count, dtype=np.int64),
            ramp_thrust=np.zeros(count, dtype=np.bool_),
            thrust_limit=np.ones(count),
            min_thrust=_nan(count),
            climb_limit_m_s=_nan(count),
            descent_limit_m_s=_nan(count),
            tilt_limit_rad=_nan(count),
            landed=np.zeros(count, dtype=np.bool_),
            in_air=np.zeros(count, dtype=np.bool_),
        )

    def clear(self, i: int) -> None:
        """Clears every setpoint of vehicle `i`, but not its level, its flags or its limits."""
        for row in (self.position_ned_m, self.velocity_ned_m_s, self.acceleration_ned_m_s2):
            row[i] = np.nan
        self.yaw_ned_rad[i] = np.nan
        self.yaw_rate_ned_rad_s[i] = np.nan
        self.q_ned_frd[i] = (1.0, 0.0, 0.0, 0.0)
        self.thrust[i] = 0.0
        self.rates_frd_rad_s[i] = 0.0
        self.torque_frd[i] = 0.0
        self.motors[i] = np.nan
        self.override_level[i] = ControlLevel.DISARMED
