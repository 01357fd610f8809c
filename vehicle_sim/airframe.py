"""Mass, inertia, rotors and drag of the simulated aircraft, PX4's SIH quadrotor (airframe 10040).

Rotor order and geometry are PX4's quad X: 1 front right, 2 rear left, 3 front left, 4 rear right;
1 and 2 turn counter-clockwise seen from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.parameters import Parameters
from vehicle_sim.state import ROTOR_COUNT

FloatArray = NDArray[np.float64]

ROLL_SIGN = np.array([-1.0, 1.0, 1.0, -1.0])
"""Sign of each rotor's roll moment (thrust right of the centre rolls left)."""
PITCH_SIGN = np.array([1.0, -1.0, 1.0, -1.0])
"""Sign of each rotor's pitch moment (thrust ahead of the centre pitches up)."""
YAW_SIGN = np.array([1.0, 1.0, -1.0, -1.0])
"""Sign of each rotor's reaction moment (a counter-clockwise rotor yaws the body clockwise)."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """Mass, inertia, rotors and drag of one vehicle."""

    mass_kg: float
    """SIH_MASS."""
    inertia_kg_m2: FloatArray
    """(3, 3) about the body axes, SIH_IXX…SIH_IYZ."""
    rotor_thrust_max_n: float
    """SIH_T_MAX, thrust of one rotor at full signal."""
    rotor_torque_max_nm: float
    """SIH_Q_MAX, reaction moment of one rotor at full signal."""
    arm_roll_m: float
    """SIH_L_ROLL."""
    arm_pitch_m: float
    """SIH_L_PITCH."""
    drag_n_per_m_s: float
    """SIH_KDV, drag proportional to the velocity."""
    drag_nm_per_rad_s: float
    """SIH_KDW, drag moment proportional to the angular velocity."""
    rotor_time_constant_s: float
    """SIH_T_TAU."""

    @classmethod
    def from_parameters(cls, parameters: Parameters) -> Airframe:
        """Reads SIH_*.

        Raises:
            ValueError: mass, a moment of inertia or the thrust is not positive.
        """

        def value(name: str) -> float:
            return parameters.finite_value(name)

        for name in ("SIH_MASS", "SIH_IXX", "SIH_IYY", "SIH_IZZ", "SIH_T_MAX"):
            if not value(name) > 0.0:
                raise ValueError(f"{name} is {value(name)}; the simulated airframe needs a value above zero")
        ixy, ixz, iyz = value("SIH_IXY"), value("SIH_IXZ"), value("SIH_IYZ")
        return cls(
            mass_kg=value("SIH_MASS"),
            inertia_kg_m2=np.array(
                [[value("SIH_IXX"), ixy, ixz], [ixy, value("SIH_IYY"), iyz], [ixz, iyz, value("SIH_IZZ")]]
            ),
            rotor_thrust_max_n=value("SIH_T_MAX"),
            rotor_torque_max_nm=value("SIH_Q_MAX"),
            arm_roll_m=value("SIH_L_ROLL"),
            arm_pitch_m=value("SIH_L_PITCH"),
            drag_n_per_m_s=value("SIH_KDV"),
            drag_nm_per_rad_s=value("SIH_KDW"),
            rotor_time_constant_s=value("SIH_T_TAU"),
        )

    def wrench_table(self) -> FloatArray:
        """(4, 4): one row per rotor at full signal; columns: thrust [N], roll, pitch and yaw moments [Nm]."""
        thrust_max_n = self.rotor_thrust_max_n
        return np.stack(
            [
                np.full(ROTOR_COUNT, thrust_max_n),
                self.arm_roll_m * thrust_max_n * ROLL_SIGN,
                self.arm_pitch_m * thrust_max_n * PITCH_SIGN,
                self.rotor_torque_max_nm * YAW_SIGN,
            ],
            axis=1,
        )
