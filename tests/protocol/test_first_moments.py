"""Requests to a new vehicle, and the values shown before it answers."""

import asyncio
import math

import pytest

from gcs_server.telemetry.hub import Encoded

INFORMATION, VERSION = 280, 148


def told(world, story_jump):
    async def run():
        w = world()
        try:
            await story_jump(w)
        finally:
            await w.close()

    return run


def asked(pilot, msg_id):
    return sum(int(m.param1) == msg_id for m in pilot.commands(512))


def answering(kit, pilot, lost=0):
    """PX4's answer after `lost` requests, with angles in degrees and an uninitialised roll limit."""
    left = [lost]

    def handler(message):
        if (
            message.get_type() != "COMMAND_LONG"
            or message.command != 512
            or int(message.param1) != INFORMATION
        ):
            return False
        left[0] -= 1
        if left[0] < 0:
            pilot.send(
                kit.sim.MAVLink_gimbal_manager_information_message(
                    pilot.boot_ms(), 132530, 1, 3e-41, 2e-44, -90.0, 90.0, -360.0, 360.0
                )
            )
        return True

    pilot.handlers.append(handler)


def test_gimbal_limits_are_requested_until_received_and_again_after_a_lost_link(kit, jump):
    async def story(world):
        pilot = world.pilot(world.link())
        answering(kit, pilot, lost=2)
        vehicle = await world.ready()
        pilot.gimbal_attitude()
        await asyncio.sleep(4)
        assert asked(pilot, INFORMATION) == 3
        gimbal = vehicle.topic("gimbal").value
        assert (gimbal.pitch_min_rad, gimbal.yaw_max_rad) == pytest.approx((-math.pi / 2, 2 * math.pi))
        await asyncio.sleep(10)
        assert asked(pilot, INFORMATION) == 3
        pilot.alive = False
        await asyncio.sleep(6)
        pilot.alive = True
        await asyncio.sleep(3)
        assert asked(pilot, INFORMATION) == 4

    jump(told(kit.World, story))


@pytest.mark.parametrize(("autopilot", "gimbal", "times"), [(12, False, 5), (3, False, 0), (3, True, 5)])
def test_gimbal_limits_are_requested_from_px4_always_and_from_others_if_they_have_a_gimbal_manager(
    kit, jump, autopilot, gimbal, times
):
    async def story(world):
        pilot = world.pilot(world.link())
        pilot.autopilot, pilot.gimbal = autopilot, gimbal
        await world.ready()
        await asyncio.sleep(30)
        assert asked(pilot, INFORMATION) == times

    jump(told(kit.World, story))


def test_whether_it_is_simulated_is_unknown_until_its_answer_and_requested_at_its_first_heartbeat(kit, jump):
    async def story(world):
        pilot = world.pilot(world.link())
        pilot.version = False
        heard = []
        world.fleet.on_vehicle_added(lambda v: heard.append((v.identity.simulated, asked(pilot, VERSION))))
        vehicle = await world.ready()
        assert heard[0][0] is None
        first = next(m for m in pilot.heard if m.get_type() == "COMMAND_LONG")
        assert int(first.param1) == VERSION
        assert vehicle.identity.simulated is None
        topics = Encoded(world.clock, world.fleet)
        seen = {}
        (told_json,) = topics.new_samples(vehicle, ["identity"], seen)
        assert b'"simulated":null' in told_json
        pilot.version = True
        await asyncio.sleep(35)
        assert vehicle.identity.simulated is True
        (again_json,) = topics.new_samples(vehicle, ["identity"], seen)  # sent again to every client
        assert b'"simulated":true' in again_json

    jump(told(kit.World, story))


@pytest.mark.parametrize(("autopilot", "simulated"), [(12, False), (3, None)])
def test_hardware_is_known_if_px4_reports_it_and_otherwise_unknown(kit, jump, autopilot, simulated):
    async def story(world):
        pilot = world.pilot(world.link(), uid=0x1122)
        pilot.autopilot = autopilot
        pilot.autopilot_version = lambda: pilot.send(
            kit.sim.MAVLink_autopilot_version_message(
                1, 0x011000FF, 0, 0, 56, [0] * 8, [0] * 8, [0] * 8, 0x26AC, 0x11, 0x1122, [0] * 18
            )
        )
        vehicle = await world.ready()
        assert vehicle.identity.firmware == "1.16.0"
        assert vehicle.identity.simulated is simulated

    jump(told(kit.World, story))
