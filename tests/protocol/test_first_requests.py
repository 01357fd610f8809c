"""Requests to a new vehicle, and the values that the server shows before the vehicle replies."""

import asyncio
import math

import pytest

from gcs_server.telemetry.hub import EncodedSamples
from tests.protocol.command_numbers import REQUEST_MESSAGE
from tests.protocol.memory_testbed import run_test
from vehicle_sim.mavlink import generated_dialect as sim

INFORMATION, VERSION = 280, 148


def requests_for(autopilot, msg_id):
    return sum(int(m.param1) == msg_id for m in autopilot.commands(REQUEST_MESSAGE))


def reply_with_limits(autopilot, lost=0):
    """Replies as PX4 after `lost` lost requests: angles in degrees, and an uninitialised roll limit."""
    lost_count = [lost]

    def handler(message):
        if (
            message.get_type() != "COMMAND_LONG"
            or message.command != REQUEST_MESSAGE
            or int(message.param1) != INFORMATION
        ):
            return False
        lost_count[0] -= 1
        if lost_count[0] < 0:
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
        reply_with_limits(autopilot, lost=2)
        vehicle = await testbed.ready()
        autopilot.gimbal_attitude()
        await asyncio.sleep(4)
        assert requests_for(autopilot, INFORMATION) == 3
        gimbal = vehicle.topic("gimbal").value
        assert (gimbal.pitch_min_rad, gimbal.yaw_max_rad) == pytest.approx((-math.pi / 2, 2 * math.pi))
        await asyncio.sleep(10)
        assert requests_for(autopilot, INFORMATION) == 3
        autopilot.alive = False
        await asyncio.sleep(6)
        autopilot.alive = True
        await asyncio.sleep(3)
        assert requests_for(autopilot, INFORMATION) == 4

    run_test(run_simulated, scenario)


@pytest.mark.parametrize(("autopilot_type", "gimbal", "times"), [(12, False, 5), (3, False, 0), (3, True, 5)])
def test_gimbal_limits_are_requested_from_px4_always_and_from_other_autopilots_if_they_have_a_gimbal_manager(
    run_simulated, autopilot_type, gimbal, times
):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        autopilot.autopilot_type, autopilot.has_gimbal = autopilot_type, gimbal
        await testbed.ready()
        await asyncio.sleep(30)
        assert requests_for(autopilot, INFORMATION) == times

    run_test(run_simulated, scenario)


def test_whether_a_vehicle_is_simulated_is_requested_at_its_first_heartbeat_and_unknown_before_its_reply(
    run_simulated,
):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link())
        autopilot.sends_version = False
        received = []
        testbed.fleet.on_vehicle_added(
            lambda v: received.append((v.identity.simulated, requests_for(autopilot, VERSION)))
        )
        vehicle = await testbed.ready()
        assert received[0][0] is None
        first = next(m for m in autopilot.received if m.get_type() == "COMMAND_LONG")
        assert int(first.param1) == VERSION
        assert vehicle.identity.simulated is None
        topics = EncodedSamples(testbed.clock, testbed.fleet)
        sent_versions = {}
        (first_json,) = topics.new_samples(vehicle, ["identity"], sent_versions)
        assert b'"simulated":null' in first_json
        autopilot.sends_version = True
        await asyncio.sleep(35)
        assert vehicle.identity.simulated is True
        (second_json,) = topics.new_samples(
            vehicle, ["identity"], sent_versions
        )  # sent again to every client
        assert b'"simulated":true' in second_json

    run_test(run_simulated, scenario)


@pytest.mark.parametrize(("autopilot_type", "simulated"), [(12, False), (3, None)])
def test_hardware_is_known_if_px4_reports_it_and_otherwise_unknown(run_simulated, autopilot_type, simulated):
    async def scenario(testbed):
        autopilot = testbed.autopilot(testbed.link(), uid=0x1122)
        autopilot.autopilot_type = autopilot_type
        autopilot.autopilot_version = lambda: autopilot.send(
            sim.MAVLink_autopilot_version_message(
                1, 0x011000FF, 0, 0, 56, [0] * 8, [0] * 8, [0] * 8, 0x26AC, 0x11, 0x1122, [0] * 18
            )
        )
        vehicle = await testbed.ready()
        assert vehicle.identity.firmware == "1.16.0"
        assert vehicle.identity.simulated is simulated

    run_test(run_simulated, scenario)
