"""Requests to a new vehicle, and the values that the server shows before the vehicle replies."""

import asyncio
import math

import pytest

from gcs_server.telemetry.hub import EncodedSamples
from tests.protocol.command_numbers import REQUEST_MESSAGE
from tests.protocol.memory_testbed import run_test
from vehicle_sim.mavlink import generated_dialect as sim

GIMBAL_INFORMATION_ID = sim.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION
VERSION_ID = sim.MAVLINK_MSG_ID_AUTOPILOT_VERSION
PX4, ARDUPILOT = sim.MAV_AUTOPILOT_PX4, sim.MAV_AUTOPILOT_ARDUPILOTMEGA


def requests_for(autopilot, msg_id):
    return sum(int(m.param1) == msg_id for m in autopilot.received_commands(REQUEST_MESSAGE))


def reply_with_gimbal_limits(autopilot, lost_requests):
    """Replies like PX4 after `lost_requests` lost requests: angles in degrees, roll limits uninitialised."""
    requests_to_lose = [lost_requests]

    def handler(message):
        if (
            message.get_type() != "COMMAND_LONG"
            or message.command != REQUEST_MESSAGE
            or int(message.param1) != GIMBAL_INFORMATION_ID
        ):
            return False
        requests_to_lose[0] -= 1
        if requests_to_lose[0] < 0:
            autopilot.send(
                sim.MAVLink_gimbal_manager_information_message(
                    autopilot.boot_ms(), 132530, 1, 3e-41, 2e-44, -90.0, 90.0, -360.0, 360.0
                )
            )
        return True

    autopilot.handlers.append(handler)


def test_gimbal_limits_are_requested_until_received_and_again_after_a_lost_link(run_simulated):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        reply_with_gimbal_limits(autopilot, lost_requests=2)
        vehicle = await testbed.wait_for_vehicle()
        autopilot.send_gimbal_attitude()
        await asyncio.sleep(4)
        assert requests_for(autopilot, GIMBAL_INFORMATION_ID) == 3
        gimbal = vehicle.topic("gimbal").value
        assert (gimbal.pitch_min_rad, gimbal.yaw_max_rad) == pytest.approx((-math.pi / 2, 2 * math.pi))
        await asyncio.sleep(10)
        assert requests_for(autopilot, GIMBAL_INFORMATION_ID) == 3
        autopilot.alive = False
        await asyncio.sleep(6)
        autopilot.alive = True
        await asyncio.sleep(3)
        assert requests_for(autopilot, GIMBAL_INFORMATION_ID) == 4

    run_test(run_simulated, scenario)


@pytest.mark.parametrize(
    ("autopilot_type", "has_gimbal", "request_count"),
    [(PX4, False, 5), (ARDUPILOT, False, 0), (ARDUPILOT, True, 5)],
)
def test_gimbal_limits_are_requested_from_px4_always_and_from_other_autopilots_if_they_have_a_gimbal_manager(
    run_simulated, autopilot_type, has_gimbal, request_count
):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        autopilot.autopilot_type, autopilot.has_gimbal = autopilot_type, has_gimbal
        await testbed.wait_for_vehicle()
        await asyncio.sleep(30)
        assert requests_for(autopilot, GIMBAL_INFORMATION_ID) == request_count

    run_test(run_simulated, scenario)


def test_the_version_is_requested_at_the_first_heartbeat_and_simulated_is_null_before_the_reply(
    run_simulated,
):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        autopilot.sends_version = False
        states_when_added = []
        testbed.fleet.on_vehicle_added(
            lambda v: states_when_added.append((v.identity.simulated, requests_for(autopilot, VERSION_ID)))
        )
        vehicle = await testbed.wait_for_vehicle()
        assert states_when_added[0][0] is None
        first_command = next(m for m in autopilot.received_messages if m.get_type() == "COMMAND_LONG")
        assert int(first_command.param1) == VERSION_ID
        assert vehicle.identity.simulated is None
        encoded_samples = EncodedSamples(testbed.clock, testbed.fleet)
        sent_versions = {}
        (first_json,) = encoded_samples.new_samples(vehicle, ["identity"], sent_versions)
        assert b'"simulated":null' in first_json
        autopilot.sends_version = True
        await asyncio.sleep(35)
        assert vehicle.identity.simulated is True
        # The identity is sent again to every client.
        (second_json,) = encoded_samples.new_samples(vehicle, ["identity"], sent_versions)
        assert b'"simulated":true' in second_json

    run_test(run_simulated, scenario)


@pytest.mark.parametrize(("autopilot_type", "simulated"), [(PX4, False), (ARDUPILOT, None)])
def test_simulated_is_false_for_a_px4_board_and_unknown_for_another_autopilot(
    run_simulated, autopilot_type, simulated
):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link(), uid=0x1122)
        autopilot.autopilot_type = autopilot_type
        autopilot.send_autopilot_version = lambda: autopilot.send(
            sim.MAVLink_autopilot_version_message(
                1, 0x011000FF, 0, 0, 56, [0] * 8, [0] * 8, [0] * 8, 0x26AC, 0x11, 0x1122, [0] * 18
            )
        )
        vehicle = await testbed.wait_for_vehicle()
        assert vehicle.identity.firmware == "1.16.0"
        assert vehicle.identity.simulated is simulated

    run_test(run_simulated, scenario)
