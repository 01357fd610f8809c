"""Offboard over ROS 2: OffboardControlMode and the setpoint topics, in Offboard and in other modes."""

from __future__ import annotations

import math

import pytest

from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.control.setpoints import ControlLevel

NAN = math.nan
NAN3 = [NAN, NAN, NAN]
SET_MODE, OFFBOARD = 176, (1.0, 6.0)
HOLD_MODE, RETURN_MODE, OFFBOARD_MODE, LAND_MODE = 4, 5, 14, 18
LAND = 21
CONTROL_MODE, TRAJECTORY = "/fmu/in/offboard_control_mode", "/fmu/in/trajectory_setpoint"
ATTITUDE, RATES = "/fmu/in/vehicle_attitude_setpoint", "/fmu/in/vehicle_rates_setpoint"
THRUST, TORQUE = "/fmu/in/vehicle_thrust_setpoint", "/fmu/in/vehicle_torque_setpoint"
MOTORS, GOTO = "/fmu/in/actuator_motors", "/fmu/in/goto_setpoint"
HOVER_THRUST = [0.0, 0.0, -0.49]


def control_mode(flag: str) -> tuple[str, dict[str, bool]]:
    return CONTROL_MODE, {flag: True}


def trajectory(position=NAN3, velocity=NAN3, acceleration=NAN3, yaw=0.0):
    fields = {"position": list(position), "velocity": list(velocity), "acceleration": list(acceleration)}
    return TRAJECTORY, {**fields, "jerk": NAN3, "yaw": yaw, "yawspeed": NAN}


SETPOINT_TYPES = {
    "position": (ControlLevel.TRAJECTORY, [trajectory((0.0, 0.0, -2.5))]),
    "velocity": (ControlLevel.TRAJECTORY, [trajectory(velocity=(0.0, 0.0, 0.0))]),
    "acceleration": (ControlLevel.TRAJECTORY, [trajectory(acceleration=(0.0, 0.0, 0.0))]),
    "attitude": (
        ControlLevel.ATTITUDE,
        [(ATTITUDE, {"q_d": [1.0, 0.0, 0.0, 0.0], "thrust_body": HOVER_THRUST})],
    ),
    "body_rate": (ControlLevel.RATES, [(RATES, {"thrust_body": HOVER_THRUST})]),
    "thrust_and_torque": (ControlLevel.THRUST_TORQUE, [(THRUST, {"xyz": HOVER_THRUST}), (TORQUE, {})]),
    "direct_actuator": (ControlLevel.MOTORS, [(MOTORS, {"control": [0.49] * 4 + [NAN] * 8})]),
}


def mode_and_failsafe(vehicle: Ros2Vehicle) -> tuple[int, bool]:
    last = vehicle.newest_fields("/fmu/out/vehicle_status")
    return last["nav_state"], last["failsafe"]


def switch_to_offboard(vehicle: Ros2Vehicle, *messages) -> None:
    vehicle.stream(0.2, 50.0, *messages)
    vehicle.command(SET_MODE, *OFFBOARD)
    vehicle.stream(0.1, 50.0, *messages)


@pytest.fixture
def hovering_vehicle() -> Ros2Vehicle:
    vehicle = Ros2Vehicle()
    vehicle.hover()
    return vehicle


@pytest.mark.flight
def test_every_setpoint_type_is_flown_as_selected_by_the_flag(hovering_vehicle):
    switch_to_offboard(hovering_vehicle, control_mode("position"), trajectory((0.0, 0.0, -2.5)))
    for name, (level, setpoints) in SETPOINT_TYPES.items():
        hovering_vehicle.stream(0.6, 100.0, control_mode(name), *setpoints)
        assert hovering_vehicle.sim.simulation.setpoints.level[0] == level, name
        assert -3.2 < hovering_vehicle.position_ned_m[2] < -1.8, name
        assert mode_and_failsafe(hovering_vehicle) == (OFFBOARD_MODE, False)
    # A setpoint of another level than the flag's changes nothing.
    hovering_vehicle.stream(2.0, 50.0, control_mode("position"), trajectory((0.0, 0.0, -2.5)))
    hovering_vehicle.stream(1.0, 50.0, control_mode("position"), *SETPOINT_TYPES["direct_actuator"][1])
    assert hovering_vehicle.sim.simulation.setpoints.level[0] == ControlLevel.TRAJECTORY
    assert hovering_vehicle.position_ned_m[2] == pytest.approx(-2.5, abs=0.3)


@pytest.mark.story
@pytest.mark.flight
def test_only_offboard_control_mode_keeps_the_vehicle_in_offboard(hovering_vehicle):
    switch_to_offboard(hovering_vehicle, control_mode("position"), trajectory((1.0, 0.0, -2.5)))
    hovering_vehicle.stream(5.0, 10.0, control_mode("position"))
    assert mode_and_failsafe(hovering_vehicle) == (OFFBOARD_MODE, False)
    assert hovering_vehicle.position_ned_m[0] == pytest.approx(1.0, abs=0.3)
    hovering_vehicle.stream(0.8, 10.0, trajectory((1.0, 0.0, -2.5)))
    assert mode_and_failsafe(hovering_vehicle) == (OFFBOARD_MODE, False)
    hovering_vehicle.stream(0.5, 10.0, trajectory((1.0, 0.0, -2.5)))
    assert mode_and_failsafe(hovering_vehicle) == (RETURN_MODE, True)
    hovering_vehicle.stream(0.5, 10.0, control_mode("position"))
    assert mode_and_failsafe(hovering_vehicle) == (OFFBOARD_MODE, False)


@pytest.mark.flight
def test_without_any_flag_the_offboard_signal_is_lost_at_once(hovering_vehicle):
    switch_to_offboard(hovering_vehicle, control_mode("position"), trajectory((0.0, 0.0, -2.5)))
    hovering_vehicle.stream(0.3, 20.0, (CONTROL_MODE, {}))
    assert mode_and_failsafe(hovering_vehicle) == (RETURN_MODE, True)


@pytest.mark.story
@pytest.mark.flight
def test_invalid_setpoints_do_not_replace_the_last_valid_setpoint(hovering_vehicle):
    level_attitude = (ATTITUDE, {"q_d": [1.0, 0.0, 0.0, 0.0], "thrust_body": HOVER_THRUST})
    switch_to_offboard(hovering_vehicle, control_mode("attitude"), level_attitude)
    for invalid_q in ([NAN, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]):
        hovering_vehicle.stream(
            0.3, 50.0, control_mode("attitude"), (ATTITUDE, {"q_d": invalid_q, "thrust_body": HOVER_THRUST})
        )
    assert hovering_vehicle.sim.simulation.setpoints.thrust[0] == pytest.approx(0.49)
    hovering_vehicle.stream(3.0, 20.0, control_mode("position"), trajectory())
    assert mode_and_failsafe(hovering_vehicle) == (OFFBOARD_MODE, False)
    assert math.dist(hovering_vehicle.position_ned_m, (0.0, 0.0, -2.5)) < 1.0


@pytest.mark.flight
def test_a_goto_setpoint_is_flown_in_hold_until_its_messages_stop(hovering_vehicle):
    goal = {"position": [0.0, 5.0, -2.5], "flag_set_max_horizontal_speed": True, "max_horizontal_speed": 4.0}
    hovering_vehicle.stream(8.0, 30.0, (GOTO, goal))
    assert mode_and_failsafe(hovering_vehicle) == (HOLD_MODE, False)
    assert hovering_vehicle.position_ned_m[1] == pytest.approx(5.0, abs=0.4)
    hovering_vehicle.stream(0.1, 30.0, (GOTO, {"position": NAN3}))
    hovering_vehicle.run(5.0)
    assert hovering_vehicle.position_ned_m[1] == pytest.approx(0.0, abs=0.5)


@pytest.mark.story
@pytest.mark.flight
def test_trajectory_setpoints_move_a_vehicle_in_hold_more_at_higher_rates(hovering_vehicle):
    moved_m = []
    for hz in (10.06, 50.3):  # not multiples of the mode's rate, which overwrites setpoints
        hovering_vehicle.stream(6.4, hz, trajectory((5.0, 0.0, -2.5)))
        moved_m.append(hovering_vehicle.position_ned_m[0])
        assert mode_and_failsafe(hovering_vehicle) == (HOLD_MODE, False)
        hovering_vehicle.run(4.0)
    assert 0.1 < moved_m[0] < 0.8
    assert 1.0 < moved_m[1] < 2.5  # PX4 overwrites two thirds of the setpoints before it uses them
    assert abs(hovering_vehicle.position_ned_m[0]) < 0.5


def test_a_stream_at_50_hz_that_goes_on_after_land_lets_the_vehicle_sink_but_not_land(hovering_vehicle):
    setpoint = control_mode("position"), trajectory((0.0, 0.0, -4.0))
    switch_to_offboard(hovering_vehicle, *setpoint)
    hovering_vehicle.stream(5.0, 50.0, *setpoint)
    hovering_vehicle.command(LAND, 0.0)
    hovering_vehicle.stream(20.0, 50.3, *setpoint)  # not in step with the vehicle's clock, as in a flight
    assert hovering_vehicle.position_ned_m[2] > -1.5
    hovering_vehicle.stream(10.0, 50.3, *setpoint)
    status = hovering_vehicle.newest_fields("/fmu/out/vehicle_status")
    assert (status["nav_state"], status["arming_state"]) == (LAND_MODE, 2)
    hovering_vehicle.run(15.0)
    assert hovering_vehicle.newest_fields("/fmu/out/vehicle_status")["arming_state"] == 1


def test_setpoints_do_not_move_a_disarmed_vehicle_and_are_not_flown_after_arming():
    vehicle = Ros2Vehicle()
    for _, setpoints in SETPOINT_TYPES.values():
        vehicle.stream(0.1, 50.0, *setpoints)
    assert vehicle.sim.simulation.setpoints.level[0] == ControlLevel.DISARMED
    vehicle.stream(0.3, 10.0, control_mode("position"))
    vehicle.command(SET_MODE, *OFFBOARD)
    vehicle.command(400, 1.0)
    vehicle.stream(2.0, 10.0, control_mode("position"))
    assert mode_and_failsafe(vehicle)[0] == OFFBOARD_MODE
    assert vehicle.sim.autopilots[0].offboard.awaits_setpoint
    assert vehicle.position_ned_m[2] == pytest.approx(0.0, abs=0.2)


def test_vehicle_control_mode_matches_the_flag_of_offboard_control_mode():
    vehicle = Ros2Vehicle()
    vehicle.stream(0.2, 20.0, control_mode("position"))
    vehicle.command(SET_MODE, *OFFBOARD)
    control_flags = {}
    for name in SETPOINT_TYPES:
        vehicle.stream(0.6, 20.0, control_mode(name))
        last = vehicle.newest_fields("/fmu/out/vehicle_control_mode")
        controllers = ("position", "attitude", "rates", "allocation")
        control_flags[name] = tuple(last[f"flag_control_{controller}_enabled"] for controller in controllers)
    assert (
        control_flags["position"]
        == control_flags["velocity"]
        == control_flags["acceleration"]
        == (True, True, True, True)
    )
    assert control_flags["attitude"] == (False, True, True, True)
    assert control_flags["body_rate"] == (False, False, True, True)
    assert control_flags["thrust_and_torque"] == (False, False, False, True)
    assert control_flags["direct_actuator"] == (False, False, False, False)
