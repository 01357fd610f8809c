"""How fast a recorded vehicle really was, by its motors and its attitude: without the wander of GPS.

The velocity in a recording is PX4's estimate. The body that was flown is known (PX4's SIH; its numbers stand
in every flight's header): its motion follows from the recorded motor signals and attitude. It starts from the
estimate; drag forgets a wrong start within SIH_MASS / SIH_KDV (one second).
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


def without_gps(airframe: Airframe, flight: Recording | Replay) -> dict[str, FloatArray]:
    """The columns of a flight with the velocity [m/s] that its motors and its attitude give such a body."""
    t_s, columns = flight.t_s, flight.columns
    grid = np.arange(t_s[0], t_s[-1] + STEP_S, STEP_S)

    def taken(names: tuple[str, ...]) -> FloatArray:
        return np.stack([np.interp(grid, t_s, columns[name]) for name in names], axis=1)

    q = taken(_ATTITUDE)
    thrust_axis = rotation_matrix(q / np.linalg.norm(q, axis=1, keepdims=True))[:, :, 2]
    signals = np.clip((taken(_MOTORS) - _IDLE_US) / _SPAN_US, 0.0, 1.0)
    force_n = airframe.wrench_table()[:, 0]
    lag = min(1.0, STEP_S / airframe.rotor_time_constant_s)
    gravity = np.array([0.0, 0.0, GRAVITY_M_S2])
    rotors = signals[0]
    speed = np.array([columns[name][0] for name in _VELOCITY])
    speeds = []
    for signal, axis in zip(signals, thrust_axis, strict=True):
        speeds.append(speed)
        rotors = rotors + lag * (signal - rotors)
        drag = airframe.drag_n_per_m_s * speed
        speed = speed + STEP_S * (gravity - (axis * (rotors @ force_n) + drag) / airframe.mass_kg)
    table = np.array(speeds)
    return columns | {name: np.interp(t_s, grid, table[:, k]) for k, name in enumerate(_VELOCITY)}
