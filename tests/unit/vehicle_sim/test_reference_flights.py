"""The simulated vehicle responds to the recorded stimuli as a real PX4 did.

The recordings drift with the GPS noise, so the shape of the response is compared (rise, overshoot, steady
value). The simulated sensors have no noise. All flights are vehicles of one simulation.
"""

import gzip
import json
import math
from dataclasses import dataclass

import numpy as np
import pytest

from vehicle_sim import frames
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16
from vehicle_sim.simulation import ControlLevel, Simulation

FLIGHTS = (
    "pos_step_x_p5",
    "pos_step_z_up3",
    "vel_x_1",
    "vel_x_8",
    "yaw_step_90",
    "att_roll_10_clean",
    "rate_roll_pulse_clean",
    "rate_yaw_pulse_clean",
)
SETTLE_S = 8.0
CLOCK_TOLERANCE_S = 0.03
"""The recordings' stimulus and vehicle clocks agree to about 20 ms; a sample is 10 ms."""


@dataclass
class Flight:
    """A recording and its replay, both as columns over `t_s`."""

    real_t_s: np.ndarray
    real: dict[str, np.ndarray]
    t_s: np.ndarray
    sim: dict[str, np.ndarray]

    def on_grid(self, column: str, start_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, real and simulated values on one grid."""
        grid = np.arange(start_s, end_s, 0.01)
        return (
            grid,
            np.interp(grid, self.real_t_s, self.real[column]),
            np.interp(grid, self.t_s, self.sim[column]),
        )


def _columns_by_name(position, velocity, q, rates) -> dict[str, np.ndarray]:
    euler = np.unwrap(frames.euler_of(q), axis=0)
    values = np.concatenate([position, velocity, euler, rates], axis=1)
    names = ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")
    return dict(zip(names, values.T, strict=True))


def _apply_setpoint(sim: Simulation, i: int, entry: dict) -> None:
    fields, setpoints = entry["fields"], sim.setpoints
    mask = fields["type_mask"]
    setpoints.clear(i)
    if entry["message"] == "SET_ATTITUDE_TARGET":
        setpoints.thrust[i] = fields["thrust"]
        if mask & 128:
            setpoints.level[i] = ControlLevel.RATES
            setpoints.rates_frd_rad_s[i] = [fields[f"body_{axis}_rate"] for axis in ("roll", "pitch", "yaw")]
        else:
            setpoints.level[i] = ControlLevel.ATTITUDE
            setpoints.q_ned_frd[i] = fields["q"]
        return
    setpoints.level[i] = ControlLevel.TRAJECTORY
    field_names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz")
    values = [math.nan if mask & (1 << k) else fields[name] for k, name in enumerate(field_names)]
    setpoints.position_ned_m[i] = values[:3]
    setpoints.velocity_ned_m_s[i] = values[3:6]
    setpoints.acceleration_ned_m_s2[i] = values[6:]
    setpoints.yaw_ned_rad[i] = math.nan if mask & 1024 else fields["yaw"]
    setpoints.yaw_rate_ned_rad_s[i] = math.nan if mask & 2048 else fields["yaw_rate"]


@pytest.fixture(scope="module")
def flights(reference_data) -> dict[str, Flight]:
    recordings = [
        json.loads(gzip.decompress((reference_data / "px4" / "flights" / f"{name}.json.gz").read_bytes()))
        for name in FLIGHTS
    ]
    tables = [
        np.array([[math.nan if v is None else v for v in row] for row in recording["rows"]], dtype=float)
        for recording in recordings
    ]
    stores = [Parameters(recording["header"]["parameters"], px4=V1_16) for recording in recordings]
    count = len(FLIGHTS)
    sim = Simulation(count, parameters=stores, sensor_noise=False, start_ned_m=np.zeros((count, 3)))
    sim.setpoints.armed[:] = True
    for _ in range(round(1.0 / sim.dt_s)):
        sim.step()
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    for i, (recording, table) in enumerate(zip(recordings, tables, strict=True)):
        column = {name: k for k, name in enumerate(recording["columns"])}
        initial_row = table[np.searchsorted(table[:, 0], -0.1)]
        start = [initial_row[column[name]] for name in ("x", "y", "z")]
        setpoint = [initial_row[column[name]] for name in ("sx", "sy", "sz")]
        sim.setpoints.position_ned_m[i] = np.round(np.where(np.isnan(setpoint), start, setpoint))
    sim.setpoints.yaw_ned_rad[:] = 0.0
    for _ in range(round(SETTLE_S / sim.dt_s)):
        sim.step()
    end_s = max(float(table[-1, 0]) for table in tables)
    steps = round(end_s / sim.dt_s)
    position, velocity, rates = (np.empty((steps, count, 3)) for _ in range(3))
    q = np.empty((steps, count, 4))
    applied_index = [-1] * count
    for k in range(steps):
        for i, recording in enumerate(recordings):
            due_index = sum(entry["t_s"] <= k * sim.dt_s for entry in recording["stimulus"]) - 1
            if due_index > applied_index[i]:
                _apply_setpoint(sim, i, recording["stimulus"][due_index])
                applied_index[i] = due_index
        sim.step()
        position[k], velocity[k] = sim.estimate.position_ned_m, sim.estimate.velocity_ned_m_s
        q[k], rates[k] = sim.estimate.q_ned_frd, sim.estimate.rates_frd_rad_s
    result = {}
    for i, (name, recording, table) in enumerate(zip(FLIGHTS, recordings, tables, strict=True)):
        column = {each: k for k, each in enumerate(recording["columns"])}

        def take(*names: str, table=table, column=column) -> np.ndarray:
            return table[:, [column[each] for each in names]]

        real = _columns_by_name(
            take("x", "y", "z"), take("vx", "vy", "vz"), take("qw", "qx", "qy", "qz"), take("p", "q", "r")
        )
        simulated = _columns_by_name(position[:, i], velocity[:, i], q[:, i], rates[:, i])
        result[name] = Flight(table[:, 0], real, sim.dt_s * np.arange(1, steps + 1), simulated)
    return result


def crossing_s(times: np.ndarray, values: np.ndarray, level: float) -> float:
    """First time that the values pass a level upwards."""
    return float(times[np.argmax(values >= level)])


@pytest.mark.parametrize(
    ("name", "column", "size"), [("pos_step_x_p5", "x", 5.0), ("pos_step_z_up3", "z", -3.0)]
)
def test_position_steps_rise_and_overshoot_as_recorded(flights, name, column, size):
    times, real, sim = flights[name].on_grid(column, 0.0, 7.5)
    real, sim = ((values - values[0]) / size for values in (real, sim))
    assert crossing_s(times, sim, 0.5) == pytest.approx(crossing_s(times, real, 0.5), abs=0.25)
    assert crossing_s(times, sim, 0.9) == pytest.approx(crossing_s(times, real, 0.9), abs=0.5)
    assert sim.max() == pytest.approx(real.max(), abs=0.08)
    assert sim[-1] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("name", "size", "end_s"), [("vel_x_1", 1.0, 4.5), ("vel_x_8", 8.0, 5.5)])
def test_velocity_steps_settle_below_the_setpoint_as_recorded(flights, name, size, end_s):
    times, real, sim = flights[name].on_grid("vx", 0.0, end_s)
    settled = times > end_s - 1.0
    assert sim[settled].mean() / size == pytest.approx(real[settled].mean() / size, abs=0.04)
    assert crossing_s(times, sim, 0.6 * size) == pytest.approx(crossing_s(times, real, 0.6 * size), abs=0.15)
    _, real_pitch, sim_pitch = flights[name].on_grid("pitch", 0.0, 1.5)
    assert math.degrees(sim_pitch.min()) == pytest.approx(math.degrees(real_pitch.min()), abs=5.0)


def test_a_yaw_step_peaks_and_overshoots_as_recorded(flights):
    times, real, sim = flights["yaw_step_90"].on_grid("yaw", 0.0, 5.0)
    half = math.radians(45.0)
    assert crossing_s(times, sim, half) == pytest.approx(crossing_s(times, real, half), abs=0.05)
    assert math.degrees(sim.max()) == pytest.approx(math.degrees(real.max()), abs=2.0)
    _, real_rate, sim_rate = flights["yaw_step_90"].on_grid("r", 0.0, 5.0)
    assert sim_rate.max() == pytest.approx(real_rate.max(), rel=0.05)


def test_an_attitude_step_rises_and_overshoots_as_recorded(flights):
    times, real, sim = flights["att_roll_10_clean"].on_grid("roll", 1.2, 2.6)
    half = math.radians(5.0)
    assert crossing_s(times, sim, half) == pytest.approx(crossing_s(times, real, half), abs=CLOCK_TOLERANCE_S)
    assert math.degrees(sim.max()) == pytest.approx(math.degrees(real.max()), abs=0.6)
    assert math.degrees(np.sqrt(np.mean((sim - real) ** 2))) < 0.6


def test_a_roll_rate_is_followed_as_recorded(flights):
    times, real, sim = flights["rate_roll_pulse_clean"].on_grid("p", 1.2, 1.5)
    assert crossing_s(times, sim, 0.63) == pytest.approx(crossing_s(times, real, 0.63), abs=CLOCK_TOLERANCE_S)
    _, real, sim = flights["rate_roll_pulse_clean"].on_grid("p", 1.2, 2.3)
    assert np.sqrt(np.mean((sim - real) ** 2)) < 0.2, (
        "more than the gyro noise of the recording, which is 0.1"
    )


def test_a_yaw_rate_is_followed_as_recorded(flights):
    _, real, sim = flights["rate_yaw_pulse_clean"].on_grid("r", 1.2, 2.7)
    assert np.sqrt(np.mean((sim - real) ** 2)) < 0.06
