"""Limits of a trajectory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from missions.errors import PlanError
from missions.vehicle import GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits that a trajectory never exceeds; the defaults are those of the PX4 v1.17 parameters."""

    speed_m_s: float = 12.0  # MPC_XY_VEL_MAX
    """Horizontal speed."""
    climb_m_s: float = 3.0  # MPC_Z_VEL_MAX_UP
    descent_m_s: float = 1.5  # MPC_Z_VEL_MAX_DN
    acceleration_m_s2: float = 3.0  # MPC_ACC_HOR
    """Horizontal acceleration."""
    acceleration_up_m_s2: float = 4.0  # MPC_ACC_UP_MAX
    acceleration_down_m_s2: float = 3.0  # MPC_ACC_DOWN_MAX
    jerk_m_s3: float = 4.0  # MPC_JERK_AUTO
    """Magnitude of the jerk vector."""
    tilt_rad: float = math.radians(45.0)  # MPC_TILTMAX_AIR
    yaw_rate_rad_s: float = math.radians(60.0)  # MPC_YAWRAUTO_MAX
    yaw_acceleration_rad_s2: float = math.radians(20.0)  # MPC_YAWRAUTO_ACC

    def __post_init__(self) -> None:
        """Checks each limit.

        Raises:
            PlanError: A limit is not finite, not positive, or the tilt is not below 90°.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if not 1e-3 <= value <= 1e4:
                reason = f"{value} is not between 0.001 and 10000"
                raise PlanError(f"limit {field.name}", reason, "Give a positive number.")
        if self.tilt_rad > math.radians(89.0):
            raise PlanError("limit tilt_rad", f"{self.tilt_rad:.3f} rad is above 89°", "Give a smaller tilt.")

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float]) -> MotionLimits:
        """The limits from the vehicle's parameters; the default for a parameter that is missing, not finite
        or not positive."""
        values: dict[str, float] = {}
        for field, name in PARAMETERS.items():
            value = parameters.get(name, math.nan)
            value = math.radians(value) if field.endswith(("_rad", "_rad_s", "_rad_s2")) else value
            if 1e-3 <= value <= 1e4:
                values[field] = min(value, math.radians(89.0)) if field == "tilt_rad" else value
        return cls(**values)

    @property
    def vertical_acceleration_m_s2(self) -> float:
        """The smaller of the limits upwards and downwards."""
        return min(self.acceleration_up_m_s2, self.acceleration_down_m_s2)

    @property
    def horizontal_acceleration_m_s2(self) -> float:
        """The smaller of MPC_ACC_HOR and the acceleration at maximum tilt while the vehicle accelerates
        downwards."""
        lift_m_s2 = GRAVITY_M_S2 - min(self.vertical_acceleration_m_s2, 0.9 * GRAVITY_M_S2)
        return min(self.acceleration_m_s2, lift_m_s2 * math.tan(self.tilt_rad))

    @property
    def yaw_jerk_rad_s3(self) -> float:
        """Yaw jerk that reaches the yaw acceleration limit in a quarter of a second."""
        return 4.0 * self.yaw_acceleration_rad_s2


PARAMETERS = {
    "speed_m_s": "MPC_XY_VEL_MAX",
    "climb_m_s": "MPC_Z_VEL_MAX_UP",
    "descent_m_s": "MPC_Z_VEL_MAX_DN",
    "acceleration_m_s2": "MPC_ACC_HOR",
    "acceleration_up_m_s2": "MPC_ACC_UP_MAX",
    "acceleration_down_m_s2": "MPC_ACC_DOWN_MAX",
    "jerk_m_s3": "MPC_JERK_AUTO",
    "tilt_rad": "MPC_TILTMAX_AIR",
    "yaw_rate_rad_s": "MPC_YAWRAUTO_MAX",
    "yaw_acceleration_rad_s2": "MPC_YAWRAUTO_ACC",
}
"""The PX4 parameter of each field of `MotionLimits`; PX4's angles are degrees."""
