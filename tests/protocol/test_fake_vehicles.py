"""Heartbeats of many vehicles that do not exist: the server limits and reports such vehicles; they never
replace a real vehicle."""

import asyncio
import tracemalloc

import pytest

from gcs_server.errors import Refused, UnknownVehicle
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_frame, encode_payload
from gcs_server.vehicle.population import (
    MAX_VEHICLES,
    MAX_VEHICLES_ON_LINK,
    MAX_WITH_SAME_ID,
    REMOVABLE_AFTER_S,
)
from tests.protocol.memory_testbed import run_test
from tests.protocol.offboard_testbed import OffboardTestbed, stream_request

HEARTBEAT = encode_payload(d.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))


def send_heartbeat(link, system, peer):
    link.inject(encode_frame(d.MAVLINK_MSG_ID_HEARTBEAT, HEARTBEAT, 0, system, 1), peer)


def test_many_sources_with_one_system_id_are_limited_and_reported(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        tracemalloc.start()
        for _ in range(10):
            for n in range(200):
                send_heartbeat(link, 9, f"10.0.0.1:{n}")
            await asyncio.sleep(1.0)
        growth_bytes = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        assert len(testbed.fleet.all()) == MAX_WITH_SAME_ID
        assert growth_bytes < 10e6, f"{growth_bytes / 1e6:.1f} MB"
        (warning,) = [each for each in testbed.fleet.warnings() if each.kind == "too_many"]
        assert (warning.link, "system id 9" in warning.text) == ("memory", True)
        assert len([event for event in testbed.fleet.events.since() if event.kind == "warning"]) == 1, (
            "the warning was not reported, or more than once"
        )
        await asyncio.sleep(70.0)
        assert not [each for each in testbed.fleet.warnings() if each.kind == "too_many"], (
            "the warning is still shown"
        )

    run_test(run_simulated, scenario, OffboardTestbed)


@pytest.mark.story
def test_a_flood_of_fake_vehicles_is_limited_and_replaces_no_known_vehicle(run_simulated):
    async def scenario(testbed):
        links = [testbed.link(name) for name in ("a", "b")]
        autopilot = testbed.offboard_autopilot(links[0], peer="real")
        autopilot.set_hovering()
        real_vehicle = await testbed.wait_for_vehicle()
        autopilot.alive = False  # the vehicle is silent, and may return on any link
        for _ in range(2):
            for n, link in enumerate(links):
                for system in range(2 + 120 * n, 2 + 120 * (n + 1)):
                    send_heartbeat(link, system, f"10.0.0.2:{system}")
            await asyncio.sleep(REMOVABLE_AFTER_S + 5.0)
        assert len(testbed.fleet.all()) == MAX_VEHICLES
        assert testbed.fleet.get("1") is real_vehicle
        autopilot.alive = True
        await asyncio.sleep(4.0)
        assert not real_vehicle.status.link_lost

    run_test(run_simulated, scenario, OffboardTestbed)


@pytest.mark.story
def test_a_new_vehicle_replaces_a_fake_vehicle_that_stopped_sending(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        for system in range(2, 255):
            send_heartbeat(link, system, f"10.0.0.2:{system}")
        await asyncio.sleep(3.0)
        assert len(testbed.fleet.all()) == MAX_VEHICLES_ON_LINK
        testbed.autopilot(link, peer="real", system=1)
        await asyncio.sleep(10.0)
        assert "1" not in [vehicle.id for vehicle in testbed.fleet.all()], (
            "the new vehicle replaced a connected vehicle"
        )
        await asyncio.sleep(REMOVABLE_AFTER_S)
        assert (await testbed.wait_for_vehicle()).id == "1"
        assert len(testbed.fleet.all()) <= MAX_VEHICLES_ON_LINK

    run_test(run_simulated, scenario, OffboardTestbed)


def test_a_silent_vehicle_can_be_removed_and_returns_as_a_new_vehicle(run_simulated):
    async def scenario(testbed):
        testbed.fleet.on_vehicle_removed(testbed.streamer.detach)
        link = testbed.link()
        autopilot = testbed.offboard_autopilot(link)
        autopilot.set_hovering()
        vehicle = await testbed.wait_for_vehicle()
        with pytest.raises(Refused, match="is connected"):
            testbed.fleet.remove("1", "test")
        await vehicle.offboard.start(stream_request(valid_for_s=600.0))
        autopilot.alive = False
        await asyncio.sleep(3.6)
        with pytest.raises(Refused, match="streamed"):
            testbed.fleet.remove("1", "test")
        await asyncio.sleep(15.0)  # the stream has ended
        testbed.fleet.remove("1", "test")
        assert testbed.fleet.all() == []
        assert testbed.fleet.events.since()[-1].text == "Vehicle 1 was removed: test removed it"
        with pytest.raises(UnknownVehicle):
            testbed.streamer._find("1")
        autopilot.alive = True
        new_vehicle = await testbed.wait_for_vehicle()
        assert new_vehicle is not vehicle
        await new_vehicle.offboard.start(stream_request(valid_for_s=60.0))
        assert new_vehicle.status.mode == "offboard"

    run_test(run_simulated, scenario, OffboardTestbed)


def test_equal_system_ids_give_one_warning_for_each_vehicle(run_simulated):
    async def scenario(testbed):
        link = testbed.link()
        for elapsed_s in range(60):
            for n in range(MAX_WITH_SAME_ID):
                if elapsed_s > 8 * n:  # a further source every 8 s
                    send_heartbeat(link, 9, f"10.0.0.1:{n}")
            await asyncio.sleep(1.0)
        assert [len(vehicle.identity.warnings) for vehicle in testbed.fleet.all()] == [1] * MAX_WITH_SAME_ID

    run_test(run_simulated, scenario, OffboardTestbed)
