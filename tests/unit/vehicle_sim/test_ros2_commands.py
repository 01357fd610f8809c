"""VehicleCommand over ROS 2: effects and acknowledgements."""

from __future__ import annotations

import pytest

from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.ros2.topics import COMMAND, COMMAND_ACK, SERVICE_REPLY, SERVICE_REQUEST

ARM, SET_MODE, SET_NAV_STATE, REQUEST_MESSAGE = 400, 176, 100_001, 512
HOLD_PARAMETERS = (1.0, 4.0, 3.0)


@pytest.fixture
def vehicle() -> Ros2Vehicle:
    return Ros2Vehicle()


def test_arming_and_disarming_are_acknowledged_within_the_recorded_time(vehicle):
    for arm, arming_state in ((1.0, 2), (0.0, 1)):
        sent_s = vehicle.sim.time_s
        vehicle.command(ARM, arm)
        vehicle.run(0.036)
        assert vehicle.acks(sent_s) == [(ARM, 0)]
        vehicle.run(0.2)  # the status is sent five times a second at most
        assert vehicle.newest_fields("/fmu/out/vehicle_status")["arming_state"] == arming_state


@pytest.mark.parametrize(
    ("address", "acknowledged"),
    [({"target_system": 0}, True), ({"target_component": 0}, True), ({"from_external": False}, True),
     ({"target_system": 2}, False), ({"target_component": 50}, False)],
)  # fmt: skip
def test_a_command_to_another_system_or_component_is_not_acknowledged(vehicle, address, acknowledged):
    vehicle.command(SET_MODE, *HOLD_PARAMETERS, **address)
    vehicle.run(0.1)
    assert vehicle.acks() == ([(SET_MODE, 0)] if acknowledged else [])


def test_the_acknowledgement_is_addressed_to_the_sender(vehicle):
    vehicle.command(SET_MODE, *HOLD_PARAMETERS, source_system=7, source_component=1003)
    vehicle.run(0.1)
    ack = vehicle.newest_fields(COMMAND_ACK)
    assert (ack["target_system"], ack["target_component"], ack["from_external"]) == (7, 1003, False)


def test_unknown_commands_are_unsupported_and_commands_only_for_mavlink_are_not_acknowledged(vehicle):
    vehicle.command(31999)
    vehicle.run(0.1)
    vehicle.command(REQUEST_MESSAGE, 148.0)
    vehicle.run(0.1)
    vehicle.command(0)
    vehicle.run(0.1)
    assert vehicle.acks() == [(31999, 3)]


def test_the_last_four_commands_of_a_burst_are_executed(vehicle):
    for number in range(31990, 31999):
        vehicle.command(number)
    vehicle.run(0.2)
    assert [number for number, _ in vehicle.acks()] == [31995, 31996, 31997, 31998]


def test_a_service_request_gets_a_reply_and_an_acknowledgement(vehicle):
    vehicle.command(SET_MODE, *HOLD_PARAMETERS, topic=SERVICE_REQUEST)
    vehicle.command(31999)
    vehicle.run(0.1)
    assert [(reply["command"], reply["result"]) for reply in vehicle.all_fields(SERVICE_REPLY)] == [
        (SET_MODE, 0)
    ]
    assert vehicle.acks() == [(SET_MODE, 0), (31999, 3)]


def test_set_nav_state_uses_the_nav_state_numbers_of_vehicle_status(vehicle):
    vehicle.command(SET_NAV_STATE, 14.0)
    vehicle.run(0.1)
    assert vehicle.newest_fields("/fmu/out/vehicle_status")["nav_state"] == 14
    vehicle.command(SET_NAV_STATE, 200.0)
    vehicle.run(0.1)
    assert vehicle.acks() == [(SET_NAV_STATE, 0), (SET_NAV_STATE, 0)]


@pytest.mark.parametrize(
    ("topic", "data"), [(COMMAND, b""), (COMMAND, b"\0\1\0\0" + bytes(20)), (COMMAND, bytes(99))]
)
def test_a_malformed_message_is_reported_once_and_ignored(vehicle, topic, data):
    for _ in range(3):
        vehicle.send_bytes(topic, data)
    vehicle.command(ARM, 1.0)
    vehicle.run(0.1)
    assert vehicle.acks() == [(ARM, 0)]
    assert len(vehicle.reports) == 1
    assert COMMAND in vehicle.reports[0]


def test_the_last_command_of_a_flood_is_executed(vehicle):
    for number in range(1000):
        vehicle.command(ARM, float(number % 2))
    vehicle.run(0.2)
    assert len(vehicle.acks()) <= 6
    assert vehicle.newest_fields("/fmu/out/vehicle_status")["arming_state"] == 2


def test_messages_before_the_dds_client_has_connected_are_lost():
    vehicle = Ros2Vehicle(time_since_boot_s=1.0)
    vehicle.command(ARM, 1.0)
    vehicle.run(2.0)
    assert vehicle.acks() == []


def test_only_valid_sticks_over_ros2_count_as_manual_control(vehicle):
    vehicle.stream(1.0, 10.0, ("/fmu/in/manual_control_input", {"valid": True, "data_source": 2}))
    assert not vehicle.newest_fields("/fmu/out/failsafe_flags")["manual_control_signal_lost"]
    vehicle.stream(1.0, 10.0, ("/fmu/in/manual_control_input", {"valid": True, "roll": float("nan")}))
    assert vehicle.newest_fields("/fmu/out/failsafe_flags")["manual_control_signal_lost"]
