"""The velocity of a recorded vehicle, calculated from its motor signals and attitude: without GPS drift.

The velocity in a recording is PX4's estimate. The airframe is known (PX4's SIH; its parameters are in the
header of every flight), so its velocity follows from the recorded motor signals and attitude. It starts
at the estimate; drag reduces an initial error with the time constant SIH_MASS / SIH_KDV (one second).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.airframe import Airframe
from vehicle_sim.frames import GRAVITY_M_S2, rotation_matrix
from vehicle_sim.simulation import STEP_S

from .flight_recordings import Recording
from .flight_replay import Replay

FloatArray = NDArray[np.float64]

_ATTITUDE = ("qw", "qx", "qy", "qz")
_MOTORS = ("m1_us", "m2_us", "m3_us", "m4_us")
_VELOCITY = ("vx", "vy", "vz")
_IDLE_US, _SPAN_US = 1000.0, 1000.0


def with_motor_velocity(airframe: Airframe, flight: Recording | Replay) -> dict[str, FloatArray]:
    """The columns of a flight, with the velocity [m/s] calculated from motor signals and attitude."""
    t_s, columns = flight.t_s, flight.columns
    grid = np.arange(t_s[0], t_s[-1] + STEP_S, STEP_S)

    def on_grid(names: tuple[str, ...]) -> FloatArray:
        return np.stack([np.interp(grid, t_s, columns[name]) for name in names], axis=1)

    q = on_grid(_ATTITUDE)
    thrust_axis = rotation_matrix(q / np.linalg.norm(q, axis=1, keepdims=True))[:, :, 2]
    signals = np.clip((on_grid(_MOTORS) - _IDLE_US) / _SPAN_US, 0.0, 1.0)
    force_n = airframe.wrench_table()[:, 0]
    rotor_step = min(1.0, STEP_S / airframe.rotor_time_constant_s)
    gravity = np.array([0.0, 0.0, GRAVITY_M_S2])
    rotors = signals[0]
    velocity = np.array([columns[name][0] for name in _VELOCITY])
    velocities = []
    for signal, axis in zip(signals, thrust_axis, strict=True):
        velocities.append(velocity)
        rotors = rotors + rotor_step * (signal - rotors)
        drag = airframe.drag_n_per_m_s * velocity
        velocity = velocity + STEP_S * (gravity - (axis * (rotors @ force_n) + drag) / airframe.mass_kg)
    table = np.array(velocities)
    return columns | {name: np.interp(t_s, grid, table[:, k]) for k, name in enumerate(_VELOCITY)}
