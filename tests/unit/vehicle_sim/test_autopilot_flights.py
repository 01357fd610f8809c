"""Take-offs and go-tos of the simulated vehicle compared with recordings of a real PX4, with sensor noise.

One simulation with four vehicles flies all take-offs and go-tos. Go-tos begin in Hold.
"""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.geodesy import to_global
from vehicle_sim.px4_version import V1_16

pytestmark = [pytest.mark.flight, pytest.mark.story]

TICK_S = 0.02
HEIGHTS_M = (10.0, 10.0, 10.0, math.nan)
TAKEOFFS = {"takeoff_10m": 0, "takeoff_2p5m": 3}
"""Row of the vehicle, by the name of the recording."""
GOTOS = {
    # recording: (vehicle, north m, east m, cruise speed before, {time s: new cruise speed})
    "reposition_60m_default_speed": (0, 60.1, 0.0, math.nan, {}),
    "reposition_50m_then_stop": (1, 0.0, -50.2, 8.0, {}),
    "change_speed_mid_reposition": (2, 0.0, 59.8, math.nan, {4.0: 2.0, 10.0: 8.0}),
}
AXIS = {
    "reposition_60m_default_speed": ("x", 1.0),
    "reposition_50m_then_stop": ("y", -1.0),
    "change_speed_mid_reposition": ("y", 1.0),
}


class Curve:
    """One coordinate relative to its start, over time."""

    def __init__(self, t_s: np.ndarray, value: np.ndarray, speed: np.ndarray) -> None:
        self.t_s, self.value, self.speed = t_s, value, speed

    def time_reached_s(self, level: float) -> float:
        """Time at which the value first reaches the level."""
        assert self.value.max() >= level, f"never reaches {level}; maximum {self.value.max():.2f}"
        return float(self.t_s[np.argmax(self.value >= level)])


def recording(reference_data: Path, name: str) -> dict[str, np.ndarray]:
    data = json.loads(gzip.decompress((reference_data / "px4" / "flights" / f"{name}.json.gz").read_bytes()))
    table = np.array([[math.nan if v is None else v for v in row] for row in data["rows"]], dtype=float)
    table = table[table[:, 0] >= 0.0]
    return {name: table[:, k] for k, name in enumerate(data["columns"])}


def coordinate_curve(columns: dict[str, np.ndarray], axis: str, sign: float) -> Curve:
    position, speed = sign * columns[axis], sign * columns["v" + axis]
    return Curve(columns["t_s"], position - position[0], speed)


def fly(
    sim: SimulatedFleet, seconds: float, actions: dict[float, list] | None = None
) -> tuple[np.ndarray, ...]:
    """Flies, and executes the actions at their times [s].

    Returns:
        Times, estimated positions and velocities (steps, N, 3).
    """
    times, positions, velocities = [], [], []
    due_actions = dict(actions or {})
    for k in range(round(seconds / TICK_S)):
        for time_s in [time_s for time_s in due_actions if time_s <= k * TICK_S + 1e-9]:
            for action in due_actions.pop(time_s):
                action()
        times.append(k * TICK_S)
        positions.append(sim.simulation.estimate.position_ned_m.copy())
        velocities.append(sim.simulation.estimate.velocity_ned_m_s.copy())
        sim.step(TICK_S)
    return np.array(times), np.array(positions), np.array(velocities)


@pytest.fixture(scope="module")
def simulated_curves() -> dict[str, Curve]:
    sim = SimulatedFleet(4, links=(), px4=V1_16)
    sim.step(8)
    result: dict[str, Curve] = {}
    for autopilot, height_m in zip(sim.autopilots, HEIGHTS_M, strict=True):
        assert autopilot.commander.arm()
        autopilot.navigator.request_takeoff(autopilot.home.alt_amsl_m + height_m)
        assert autopilot.commander.set_mode(NavState.TAKEOFF)
    t_s, position, velocity = fly(sim, 18)
    for name, row in TAKEOFFS.items():
        result[name] = Curve(t_s, -(position[:, row, 2] - position[0, row, 2]), -velocity[:, row, 2])
    actions: dict[float, list] = {}
    for row, north, east, cruise, changes in GOTOS.values():
        autopilot = sim.autopilots[row]
        assert autopilot.commander.active is NavState.HOLD
        navigator, view = autopilot.navigator, autopilot.view
        lat0, lon0, _ = view.origin
        x, y, _ = view.estimate.position_ned_m
        lat, lon = to_global(np.float64(x + north), np.float64(y + east), np.float64(lat0), np.float64(lon0))
        navigator.path.cruise_m_s = cruise
        navigator.goto(float(lat), float(lon), math.nan, math.nan)
        for time_s, speed in changes.items():
            actions.setdefault(time_s, []).append(
                lambda p=navigator.path, v=speed: setattr(p, "cruise_m_s", v)
            )
    # The vehicle is already in Hold, so the recorded DO_SET_MODE Hold does not stop it.
    actions[5.0] = [lambda: sim.autopilots[1].commander.set_mode(NavState.HOLD)]
    t_s, position, velocity = fly(sim, 26, actions)
    for name, (row, *_rest) in GOTOS.items():
        axis, sign = AXIS[name]
        axis_index = "xyz".index(axis)
        distance_m = sign * (position[:, row, axis_index] - position[0, row, axis_index])
        result[name] = Curve(t_s, distance_m, sign * velocity[:, row, axis_index])
    return result


@pytest.mark.parametrize("name", TAKEOFFS)
def test_take_offs_lift_off_and_climb_as_recorded(
    reference_data: Path, simulated_curves: dict[str, Curve], name: str
) -> None:
    real, sim = coordinate_curve(recording(reference_data, name), "z", -1.0), simulated_curves[name]
    for height_m in (1.0, 2.0) if name == "takeoff_2p5m" else (1.0, 2.0, 5.0, 9.0):
        # The recordings differ by 0.6 s, because the estimated height of the ground drifts by decimetres.
        assert sim.time_reached_s(height_m) == pytest.approx(real.time_reached_s(height_m), abs=0.9), height_m
    # Both are maxima of estimated speeds, which vary by 0.1 m/s with the GPS noise.
    assert sim.speed.max() == pytest.approx(real.speed.max(), abs=0.25)


def test_the_vehicle_leaves_the_ground_at_the_recorded_time_after_arming() -> None:
    sim = SimulatedFleet(1, links=(), seed=5)
    sim.step(8)
    autopilot = sim.autopilots[0]
    autopilot.commander.arm()
    autopilot.commander.set_mode(NavState.TAKEOFF)
    armed_s = sim.time_s
    while sim.simulation.truth.position_ned_m[0, 2] > -0.02:
        sim.step(TICK_S)
        assert sim.time_s - armed_s < 8.0
        if autopilot.commander.landed:
            landed_until_s = sim.time_s - armed_s
    assert 3.5 < sim.time_s - armed_s < 4.8, "recorded: 0.2 m at 4.5, 4.6 and 5.1 s"
    assert 1.6 < landed_until_s < 2.2, "recorded: 1.8, 1.9 and 2.0 s"


@pytest.mark.parametrize("name", GOTOS)
def test_gotos_accelerate_brake_and_overshoot_as_recorded(
    reference_data: Path, simulated_curves: dict[str, Curve], name: str
) -> None:
    axis, sign = AXIS[name]
    real, sim = coordinate_curve(recording(reference_data, name), axis, sign), simulated_curves[name]
    until_s = min(real.t_s[-1], sim.t_s[-1])
    grid = np.arange(0.0, until_s, TICK_S)
    simulated_m, recorded_m = (np.interp(grid, c.t_s, c.value) for c in (sim, real))
    distance_m = {"reposition_50m_then_stop": 50.2}.get(name, 60.0)
    for fraction in (0.1, 0.5, 0.9):
        assert sim.time_reached_s(fraction * distance_m) == pytest.approx(
            real.time_reached_s(fraction * distance_m), abs=0.6
        ), fraction
    assert sim.speed.max() == pytest.approx(real.speed.max(), abs=0.35)
    assert np.abs(simulated_m - recorded_m).max() < 2.6, "2.6 m are less than half a second at 8 m/s"
    if name != "reposition_50m_then_stop":  # its recording ends before the vehicle has stopped
        assert simulated_m.max() == pytest.approx(recorded_m.max(), abs=0.7), "overshoot"
        assert simulated_m[-1] == pytest.approx(recorded_m[-1], abs=0.7)


def test_a_goto_ends_at_its_target(simulated_curves: dict[str, Curve]) -> None:
    sim = simulated_curves["reposition_60m_default_speed"]
    assert sim.value[sim.t_s > 22.0] == pytest.approx(60.1, abs=1.2)
