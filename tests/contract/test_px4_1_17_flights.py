"""Flights of a real PX4 v1.17 in Offboard and in its own modes, flown by the simulated one.

They are single runs on a loaded machine, in which PX4 also follows the noise of its GPS: the limits are those
by which two real flights of v1.16 differed.
"""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.contract.recordings import folder_of_1_17, python_value
from tests.contract.replay_vehicle import DO_SET_MODE, TAKEOFF, Vehicle
from vehicle_sim.geodesy import to_global
from vehicle_sim.px4_version import V1_17

FLIGHTS = (
    "att_pitch_m15_clean", "att_roll_10_clean", "pos_step_y_10", "rate_yaw_pulse_clean", "vel_x_8",
    "yaw_step_90",
)  # fmt: skip
POSITION_RMS_M, POSITION_RMS_SHARE, TOP_SPEED_M_S = 1.0, 0.06, 0.6
"""Limit of the difference of two tracks, and its part that grows with the distance flown."""
COMMANDED = (
    "takeoff_10m", "land_from_10m", pytest.param("reposition_60m_default_speed", marks=pytest.mark.broad),
    pytest.param("rtl_60m_15m", marks=pytest.mark.broad),
)  # fmt: skip
ARRIVAL_S = 1.5
"""By how much later or earlier the vehicle has gone nine tenths of its way, or of its height."""
STEP_S, SETTLE_S = 0.01, 6.0
REPOSITION = 192


def start(recording: dict) -> tuple[float, float]:
    """Where the recorded vehicle began: to the north of its origin [m], and above it [m]."""
    column = {name: number for number, name in enumerate(recording["columns"])}
    first_row = next(row for row in recording["rows"] if row[0] >= -0.05)
    return round(first_row[column["x"]]), round(-first_row[column["z"]])


def vehicle_in_offboard(north_m: float, height_m: float) -> Vehicle:
    """A vehicle that hovers there in Offboard."""
    vehicle = vehicle_on_the_ground()
    vehicle.hover_in_hold()
    vehicle.stream_setpoints(True)
    assert vehicle.background_setpoint is not None
    vehicle.background_setpoint |= {"x": north_m, "y": 0.0, "z": -height_m, "yaw": 0.0, "type_mask": 2552}
    vehicle.run(0.5)
    vehicle.command(DO_SET_MODE, 1, 6)
    vehicle.run(SETTLE_S + north_m / 5.0)
    return vehicle


def vehicle_on_the_ground() -> Vehicle:
    vehicle = Vehicle(1, {}, px4=V1_17)
    vehicle.run(3.0)
    vehicle.run_until(vehicle.ready, 15)
    vehicle.run(2.0)
    return vehicle


def fly(recording: dict) -> tuple[np.ndarray, np.ndarray]:
    """Times, and positions and velocities (n, 6), of the simulated vehicle since the first setpoint."""
    vehicle = vehicle_in_offboard(*start(recording))
    vehicle.stream_setpoints(False)
    begin_s = vehicle.now_s
    messages = [
        (begin_s + entry["t_s"] + number / entry["streamed_hz"], entry["message"], entry["fields"])
        for entry in recording["stimulus"]
        for number in range(round(entry["streamed_hz"] * entry["duration_s"]))
    ]
    times, states = [], []
    truth, end_s = (
        vehicle.sim.simulation.truth,
        begin_s + min(messages[-1][0] - begin_s, recording["rows"][-1][0]),
    )
    while vehicle.now_s < end_s:
        while messages and messages[0][0] <= vehicle.now_s:
            _, name, fields = messages.pop(0)
            target = {"target_system": 1, "target_component": 1}
            vehicle.send(name, target | {key: python_value(value) for key, value in fields.items()}, "api")
        vehicle.run_to(vehicle.now_s + STEP_S)
        times.append(vehicle.now_s - begin_s)
        states.append([*truth.position_ned_m[0].tolist(), *truth.velocity_ned_m_s[0].tolist()])
    return np.array(times), np.array(states)


@pytest.mark.flight
@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_of_v1_17_is_flown_alike(name: str, reference_data: Path) -> None:
    path = folder_of_1_17(reference_data) / "flights" / f"{name}.json.gz"
    recording = json.loads(gzip.decompress(path.read_bytes()))
    times, simulated = fly(recording)
    rows = np.array([[math.nan if v is None else v for v in row[:7]] for row in recording["rows"]])
    recorded = np.stack([np.interp(times, rows[:, 0], rows[:, k]) for k in range(1, 7)], axis=1)
    simulated[:, :3] -= simulated[0, :3]
    recorded[:, :3] -= recorded[0, :3]
    flown_m = float(np.linalg.norm(recorded[:, :3], axis=1).max())
    error_m = float(np.sqrt(np.mean(np.sum((simulated - recorded)[:, :3] ** 2, axis=1))))
    top_m_s = [float(np.linalg.norm(each[:, 3:], axis=1).max()) for each in (simulated, recorded)]
    assert error_m <= POSITION_RMS_M + POSITION_RMS_SHARE * flown_m
    assert abs(top_m_s[0] - top_m_s[1]) <= TOP_SPEED_M_S


def fly_command(name: str, recording: dict) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions (n, 3) of the simulated vehicle since the recorded command."""
    if name == "takeoff_10m":
        vehicle = vehicle_on_the_ground()
    else:
        vehicle = vehicle_in_offboard(*start(recording))
        vehicle.command(DO_SET_MODE, 1, 4, 3)
        vehicle.stream_setpoints(False)
        vehicle.run(2.0)
    for entry in recording["stimulus"]:
        fields = {key: python_value(value) for key, value in entry["fields"].items()} | {"target_system": 1}
        if fields["command"] == TAKEOFF:
            fields["param7"] = vehicle.autopilot.home.alt_amsl_m + 10.0
        if fields["command"] == REPOSITION:
            origin = vehicle.sim.simulation.origin
            fields["x"] = round(to_global(60.0, 0.0, origin.lat_deg, origin.lon_deg)[0] * 1e7)
            fields["y"], fields["z"] = round(origin.lon_deg * 1e7), math.nan
        vehicle.send(entry["message"], fields)
    begin_s, times, positions = vehicle.now_s, [], []
    while vehicle.now_s < begin_s + recording["rows"][-1][0]:
        vehicle.run_to(vehicle.now_s + 0.05)
        times.append(vehicle.now_s - begin_s)
        positions.append(vehicle.sim.simulation.truth.position_ned_m[0].tolist())
    return np.array(times), np.array(positions)


def arrival_s(times: np.ndarray, way_m: np.ndarray) -> float:
    """When nine tenths of a way were gone for the first time."""
    return float(times[np.flatnonzero(np.abs(way_m) >= 0.9 * np.abs(way_m).max())[0]])


@pytest.mark.flight
@pytest.mark.parametrize("name", COMMANDED)
def test_a_commanded_flight_of_v1_17_is_flown_alike(name: str, reference_data: Path) -> None:
    path = folder_of_1_17(reference_data) / "flights" / f"{name}.json.gz"
    recording = json.loads(gzip.decompress(path.read_bytes()))
    times, simulated = fly_command(name, recording)
    rows = np.array([[math.nan if v is None else v for v in row[:4]] for row in recording["rows"]])
    recorded = np.stack([np.interp(times, rows[:, 0], rows[:, k]) for k in range(1, 4)], axis=1)
    simulated, recorded = simulated - simulated[0], recorded - recorded[0]
    flown_m = float(np.linalg.norm(recorded, axis=1).max())
    error_m = float(np.sqrt(np.mean(np.sum((simulated - recorded) ** 2, axis=1))))
    axis = int(np.argmax(np.abs(recorded[-1])))
    late_s = arrival_s(times, simulated[:, axis]) - arrival_s(times, recorded[:, axis])
    assert error_m <= POSITION_RMS_M + POSITION_RMS_SHARE * flown_m
    assert abs(late_s) <= ARRIVAL_S
