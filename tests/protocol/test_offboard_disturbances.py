"""Disturbances of a stream by the vehicle, by its links and by other commands; setpoints reach only their
vehicle."""

import asyncio
import errno

import pytest

from gcs_server.errors import NoReply, Refused, Rejected
from tests.protocol.command_numbers import ARM_DISARM, DO_SET_MODE
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.offboard_testbed import (
    OffboardTestbed,
    assert_nothing_sent,
    mode_requests,
    offboard_event_codes,
    run_offboard,
    setpoint_gaps_s,
    sleep,
    stream_request,
)


def is_hold_request(message):
    return getattr(message, "command", None) == DO_SET_MODE and message.param3 == 3  # AUTO_LOITER


# --- changes by the vehicle -----------------------------------------------------------------------


def test_after_a_change_of_the_local_origin_a_stream_of_positions_ends_in_hold(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request())
        await sleep(0.5)
        autopilot.position_ned_m = [80.0, -30.0, -5.0]
        await sleep(0.3)
        assert "jumped" in offboard_event_codes(vehicle)
        last_setpoints = [m for t, m in autopilot.setpoints if t > testbed.loop.time() - 0.1]
        assert {(round(m.x), round(m.y)) for m in last_setpoints} in ({(80, -30)}, set())
        await sleep(2)
        assert autopilot.mode == HOLD_MODE
        with pytest.raises(Refused):
            await vehicle.offboard.setpoint(stream_request())

    run_offboard(run_simulated, scenario)


def test_the_stream_does_not_restart_if_the_vehicle_reports_offboard_again_after_a_failsafe_landing(
    run_simulated,
):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=3600.0))
        await sleep(0.5)
        autopilot.failsafe_count, autopilot.mode = 1, POSITION_MODE
        autopilot.send_current_mode()
        await sleep(0.5)
        autopilot.land_and_disarm()
        await sleep(1)
        assert vehicle.status.mode == "offboard"
        status = vehicle.offboard.status()
        assert not status.streaming
        assert "Position" in status.ended or "position" in status.ended
        await assert_nothing_sent(autopilot, link)
        with pytest.raises(Refused, match="no setpoint stream"):
            await vehicle.offboard.setpoint(stream_request())

    run_offboard(run_simulated, scenario)


def test_a_vehicle_that_disarmed_during_a_lost_link_gets_no_setpoints(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=3600.0))
        await sleep(0.5)
        autopilot.alive = False
        await sleep(2.0)
        autopilot.alive = True
        autopilot.land_and_disarm()
        await assert_nothing_sent(autopilot, link, settle_s=1.2)
        assert offboard_event_codes(vehicle) == ["disarmed"]

    run_offboard(run_simulated, scenario)


def test_the_stream_to_a_lost_vehicle_ends_before_its_setpoint_expires(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=3600.0))
        autopilot.alive = False
        autopilot.silent_commands.add(DO_SET_MODE)
        await sleep(3.5 + 5 + 1.5)
        assert not vehicle.offboard.status().streaming
        assert offboard_event_codes(vehicle) == ["lost", "not_confirmed"]

    run_offboard(run_simulated, scenario)


def test_a_kill_in_flight_ends_the_stream(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=3600.0))
        await vehicle.command.kill()
        await assert_nothing_sent(autopilot, link, settle_s=0.2)
        assert offboard_event_codes(vehicle) == ["disarmed"]

    run_offboard(run_simulated, scenario)


def test_a_server_shutdown_puts_all_vehicles_into_hold_at_once_within_a_deadline(run_simulated):
    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilots = [
            testbed.offboard_autopilot(link, peer=f"p{i}", system=i, booted_at_s=900.0 - i) for i in (1, 2, 3)
        ]
        for autopilot in autopilots:
            autopilot.set_hovering()
        try:
            vehicles = [await testbed.wait_for_vehicle(str(i)) for i in (1, 2, 3)]
            await sleep(1.5)
            await asyncio.gather(*(vehicle.offboard.start(stream_request()) for vehicle in vehicles))
            autopilots[0].silent_commands.add(DO_SET_MODE)
            began_s = testbed.loop.time()
            stopped = {s.vehicle: s.error for s in await testbed.streamer.stop_all()}
            assert testbed.loop.time() - began_s < 3.5
            assert stopped["2"] is None
            assert stopped["3"] is None
            assert isinstance(stopped["1"], NoReply)
            assert [autopilot.mode for autopilot in autopilots] == [OFFBOARD_MODE, HOLD_MODE, HOLD_MODE]
        finally:
            await testbed.close()

    run_simulated(run)


def test_a_late_refusal_of_an_earlier_command_does_not_fail_hold(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.has_stream = lambda: False  # Offboard is accepted, and refused 0.3 s later
        autopilot.offboard_delay_s = 0.3
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        while not mode_requests(autopilot, OFFBOARD_MODE):
            await sleep(0.005)
        autopilot.mode = POSITION_MODE
        dropped = []

        def drop_first_hold_request(message):
            if is_hold_request(message) and not dropped:
                dropped.append(message)
            return message in dropped

        autopilot.handlers.append(drop_first_hold_request)
        await vehicle.command.hold()
        assert dropped
        assert autopilot.mode == HOLD_MODE
        with pytest.raises((Refused, Rejected)):
            await starting

    run_offboard(run_simulated, scenario)


def test_a_refused_hold_is_reported_although_it_replaced_another_command(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.offboard_delay_s = 0.3
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        while not mode_requests(autopilot, OFFBOARD_MODE):
            await sleep(0.005)
        autopilot.refusals[DO_SET_MODE] = 2
        autopilot.mode = POSITION_MODE
        with pytest.raises(Rejected, match="denied"):
            await vehicle.command.hold()
        with pytest.raises((Refused, Rejected)):
            await starting

    run_offboard(run_simulated, scenario)


@pytest.mark.parametrize("command", ["land", "rtl"])
def test_the_stream_does_not_request_hold_during_another_command(run_simulated, command):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.handlers.append(is_hold_request)
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, hold_for_s=0.2))
        while vehicle.offboard.status().state != "to_hold":
            await sleep(0.01)
        await sleep(0.9)
        ignore_until_s = testbed.loop.time() + 1.3
        autopilot.handlers.append(
            lambda m: getattr(m, "command", None) == DO_SET_MODE and testbed.loop.time() < ignore_until_s
        )
        request_count = len(mode_requests(autopilot, HOLD_MODE))
        await getattr(vehicle.command, command)()
        await sleep(2)
        assert len(mode_requests(autopilot, HOLD_MODE)) == request_count
        assert vehicle.status.mode == command
        assert autopilot.failsafe_count == 0

    run_offboard(run_simulated, scenario)


# --- receivers ------------------------------------------------------------------------------------


def test_two_vehicles_on_one_link_each_get_only_their_own_setpoints(run_simulated):
    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilots = [
            testbed.offboard_autopilot(link, peer=f"p{i}", system=i, booted_at_s=900.0 - i) for i in (1, 2)
        ]
        for autopilot in autopilots:
            autopilot.set_hovering()
        try:
            vehicles = [await testbed.wait_for_vehicle(str(i)) for i in (1, 2)]
            await sleep(1.5)
            for number, vehicle in enumerate(vehicles, 1):
                await vehicle.offboard.start(stream_request(position=(float(number), 0.0, -5.0)))
            await sleep(0.5)
            await vehicles[0].command.kill()
            for number, autopilot in enumerate(autopilots, 1):
                addressed = [m for m in autopilot.received_messages if hasattr(m, "target_system")]
                assert {m.target_system for m in addressed} == {number}
                assert {m.target_component for m in addressed} == {1}
                assert {m.x for _, m in autopilot.setpoints} == {float(number)}
            assert autopilots[1].armed
            assert not autopilots[0].armed
        finally:
            await testbed.close()

    run_simulated(run)


def test_vehicles_with_equal_ids_on_two_links_get_only_their_own_messages(run_simulated):
    async def run():
        testbed = OffboardTestbed()
        links = [testbed.link("one"), testbed.link("two")]
        autopilots = [
            testbed.offboard_autopilot(link, uid=i + 7, booted_at_s=900.0 - 50 * i)
            for i, link in enumerate(links)
        ]
        for autopilot in autopilots:
            autopilot.set_hovering()
        try:
            await testbed.wait_for_vehicle("1")
            await testbed.wait_for_vehicle("1~2")
            await sleep(1.5)
            vehicle_by_link = {testbed.fleet.get(i).links[0]: testbed.fleet.get(i) for i in ("1", "1~2")}
            await vehicle_by_link["two"].offboard.start(stream_request())
            await vehicle_by_link["two"].command.kill()
            assert autopilots[0].armed
            assert not autopilots[0].setpoints
            assert not autopilots[0].received_commands(ARM_DISARM)
            assert not autopilots[0].received_commands(DO_SET_MODE)
            assert not autopilots[1].armed
        finally:
            await testbed.close()

    run_simulated(run)


def raise_unreachable(data, peer):
    raise OSError(errno.ENETUNREACH, "Network is unreachable")


@pytest.mark.parametrize("failure", ["silent", "write_fails"])
def test_if_the_sending_link_fails_the_other_link_takes_over_before_px4s_failsafe(run_simulated, failure):
    async def run():
        testbed = OffboardTestbed()
        first, second = testbed.link("one"), testbed.link("two")
        autopilot = testbed.offboard_autopilot(first)
        autopilot.set_hovering()
        second.autopilots["peer"] = autopilot
        failed_links = []

        def send_on_both(raw):
            autopilot.mav.seq = (autopilot.mav.seq + 1) % 256
            for link in (first, second):
                if link.name not in failed_links:
                    link.inject(raw, "peer")

        autopilot.send_raw = send_on_both
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(5)
            assert set(vehicle.links) == {"one", "two"}
            await vehicle.offboard.start(stream_request())
            await sleep(1)
            used_link = max((first, second), key=lambda link: len(link.sent_packets))
            other_link = second if used_link is first else first
            sent_before = len(other_link.sent_packets)
            if failure == "silent":
                failed_links.append(used_link.name)
                used_link.autopilots.clear()
            else:
                used_link._link_writer._write = raise_unreachable
            await sleep(3)
            assert len(other_link.sent_packets) > sent_before + 100
            assert max(setpoint_gaps_s(autopilot)) < 0.5
            assert autopilot.failsafe_count == 0
            assert vehicle.offboard.status().state == "streaming"
        finally:
            await testbed.close()

    run_simulated(run)
