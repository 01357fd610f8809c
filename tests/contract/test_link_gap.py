"""Gaps in the Offboard stream: when PX4 leaves Offboard, what it does meanwhile, and that it comes back."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.contract.plan_dialogues import explained
from tests.contract.replay_vehicle import DO_SET_MODE, Vehicle

STREAM_HZ, SPEED_M_S, HEIGHT_M = 50.0, 3.0, 10.0
POSITION_MASK, VELOCITY_MASK = 2552, 3527
BEFORE_S, AFTER_S = 3.0, 6.0
SAMPLE_S = 2.1
"""CURRENT_MODE comes at 1 Hz, and the recording machine was up to a second late."""
SPEED_TOLERANCE_M_S, HEIGHT_TOLERANCE_M, SINK_TOLERANCE_M_S = 2.0, 0.7, 0.2
"""The estimated height drifts with the noise of the GPS."""
OFFBOARD = 0x60000
NORMAL_RUN = ("position", 3.3, 196608)


def recorded_cases(reference_data: Path) -> list[dict[str, Any]]:
    path = reference_data / "px4" / "items" / "link_gap.json"
    if not path.is_file():
        pytest.skip("the recorded gaps of a stream are not beside this checkout")
    return [case for case in json.loads(path.read_text(encoding="utf-8"))["cases"] if case["clean"]]


def differences(case: dict[str, Any]) -> list[str]:
    vehicle = Vehicle(1, dict(case["parameters"]))
    vehicle.run(3.0)
    vehicle.run_until(vehicle.ready, 15)
    vehicle.run(2.5)
    vehicle.hover_in_hold()
    begin_s, north_m = vehicle.now_s, vehicle.autopilot.view.estimate.position_ned_m[0]

    def stream(seconds: float) -> None:
        end_s = vehicle.now_s + seconds
        while vehicle.now_s < end_s - 1e-6:
            fields = {"target_system": 1, "target_component": 1, "coordinate_frame": 1}
            if case["stream"] == "position":
                x = north_m + SPEED_M_S * (vehicle.now_s - begin_s)
                fields |= {"type_mask": POSITION_MASK, "x": x, "z": -HEIGHT_M}
            else:
                fields |= {"type_mask": VELOCITY_MASK, "vx": SPEED_M_S}
            vehicle.send("SET_POSITION_TARGET_LOCAL_NED", fields, "api")
            vehicle.run_to(vehicle.now_s + 1.0 / STREAM_HZ)

    stream(0.5)
    vehicle.command(DO_SET_MODE, 1, 6)
    stream(BEFORE_S)
    vehicle.heartbeats = case["heartbeats_during_gap"]
    view = vehicle.autopilot.view
    stopped_s, down_m = vehicle.now_s, view.estimate.position_ned_m[2]
    vehicle.run(case["true_gap_s"])
    vehicle.heartbeats = True
    sunk_m = down_m - view.estimate.position_ned_m[2]
    top_speed_m_s, end_s = 0.0, vehicle.now_s + AFTER_S
    while vehicle.now_s < end_s:
        stream(0.2)
        top_speed_m_s = max(top_speed_m_s, float(vehicle.sim.simulation.truth.velocity_ned_m_s[0, 0]))
    modes = [(at_s - stopped_s, s["custom_mode"]) for at_s, s in vehicle.states if at_s > stopped_s]
    left = [(at_s, mode) for at_s, mode in modes if mode != OFFBOARD]
    found: list[str] = []
    if case["left_offboard_s"] is None:
        if left and left[0][0] < case["true_gap_s"] - SAMPLE_S:
            found.append(f"left Offboard after {left[0]}")
    elif not left or left[0][1] != case["mode_after_leaving"]:
        found.append(f"mode {case['mode_after_leaving']} | {left}")
    elif not left[0][0] - 0.1 <= case["left_offboard_s"] <= left[0][0] + SAMPLE_S:
        found.append(f"left after {case['left_offboard_s']} | {left[0][0]}")
    if vehicle.state()["custom_mode"] != case["mode_at_end"]:
        found.append(f"mode at end {case['mode_at_end']} | {vehicle.state()}")
    tolerance_m = HEIGHT_TOLERANCE_M + SINK_TOLERANCE_M_S * case["true_gap_s"]
    if abs(sunk_m - case["height_change_in_gap_m"]) > tolerance_m:
        found.append(f"height {case['height_change_in_gap_m']} | {sunk_m:.2f}")
    if abs(top_speed_m_s - case["top_speed_after_back_m_s"]) > SPEED_TOLERANCE_M_S:
        found.append(f"speed {case['top_speed_after_back_m_s']} | {top_speed_m_s:.2f}")
    return found


def name_of(case: dict[str, Any]) -> str:
    action = case["parameters"].get("COM_OBL_RC_ACT", 0)
    return f"gap_{case['stream']}_{case['gap_s']}_action{action}_heartbeats{case['heartbeats_during_gap']}"


def test_a_gap_of_three_seconds_is_as_recorded(reference_data: Path) -> None:
    case = next(
        each
        for each in recorded_cases(reference_data)
        if (each["stream"], each["gap_s"], each["mode_after_leaving"]) == NORMAL_RUN
    )
    assert differences(case) == []


@pytest.mark.broad
@pytest.mark.timeout(300)
def test_all_gaps_are_as_recorded(reference_data: Path) -> None:
    cases = recorded_cases(reference_data)
    assert len(cases) == 19
    found = {name_of(case): differences(case) for case in cases}
    assert {name for name, rows in found.items() if rows} == found.keys() & explained().keys()
