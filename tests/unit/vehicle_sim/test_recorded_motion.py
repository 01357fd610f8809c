"""The velocity calculated from motor signals and attitude, compared with known results."""

import math

import numpy as np
import pytest

from tests.bench import flight_recordings, flight_replay, recorded_motion
from tests.bench.flight_replay import Replay
from vehicle_sim.airframe import Airframe
from vehicle_sim.frames import GRAVITY_M_S2, quaternion_from_euler
from vehicle_sim.parameters import Parameters

pytestmark = pytest.mark.flight

AIRFRAME = Airframe.from_parameters(Parameters())


def level_flight(pitch_rad: float, seconds: float = 10.0) -> Replay:
    """Level flight at this pitch from rest."""
    t_s = np.arange(0.0, seconds, 0.02)
    motor_signal = AIRFRAME.mass_kg * GRAVITY_M_S2 / math.cos(pitch_rad) / (4.0 * AIRFRAME.rotor_thrust_max_n)
    columns = {name: np.zeros_like(t_s) for name in ("vx", "vy", "vz")}
    columns |= {f"m{n}_us": np.full_like(t_s, 1000.0 + 1000.0 * motor_signal) for n in (1, 2, 3, 4)}
    q = quaternion_from_euler(0.0, pitch_rad, 0.0)
    columns |= {name: np.full_like(t_s, q[k]) for k, name in enumerate(("qw", "qx", "qy", "qz"))}
    return Replay(t_s, columns)


def test_a_constant_pitch_leads_to_the_terminal_speed():
    calculated = recorded_motion.with_motor_velocity(AIRFRAME, level_flight(-0.1))
    terminal_m_s = AIRFRAME.mass_kg * GRAVITY_M_S2 * math.tan(0.1) / AIRFRAME.drag_n_per_m_s
    assert calculated["vx"][-1] == pytest.approx(terminal_m_s, rel=1e-3)
    speed_after_time_constant = calculated["vx"][round(AIRFRAME.mass_kg / AIRFRAME.drag_n_per_m_s / 0.02)]
    assert speed_after_time_constant == pytest.approx(terminal_m_s * (1.0 - math.exp(-1.0)), rel=0.01)
    assert np.abs(calculated["vy"]).max() < 1e-9
    assert np.abs(calculated["vz"]).max() < 1e-9


@pytest.mark.story
def test_the_calculated_velocity_equals_the_estimated_velocity_without_noise(reference_data):
    recording = flight_recordings.load("vel_z_up1p5")
    replay = flight_replay.fly([recording])[recording.name]
    calculated = recorded_motion.with_motor_velocity(AIRFRAME, replay)
    for name in ("vx", "vy", "vz"):
        assert np.abs(calculated[name] - replay.columns[name]).max() < 0.1
