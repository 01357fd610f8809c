"""Offboard flights from start to end, from the call to the received setpoints."""

import asyncio

import pytest

from gcs_server.errors import Disconnected, Interrupted, NoReply, Refused, Rejected
from tests.protocol.api_calls import MISSION_MODE
from tests.protocol.command_numbers import DO_SET_MODE
from tests.protocol.fake_autopilot import HOLD_MODE, LAND_MODE, OFFBOARD_MODE, POSITION_MODE, REAL32
from tests.protocol.offboard_testbed import (
    assert_nothing_sent,
    mode_requests,
    offboard_event_codes,
    run_offboard,
    setpoint_gaps_s,
    sleep,
    stream_request,
)

POSITION_AND_YAW = 0b100111111000  # a type_mask

# --- whole flights --------------------------------------------------------------------------------


def test_nothing_is_sent_after_stop(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request())
        await sleep(2)
        await vehicle.offboard.stop()
        assert autopilot.mode == HOLD_MODE
        await assert_nothing_sent(autopilot, link)
        assert max(setpoint_gaps_s(autopilot)) < 0.05
        assert autopilot.failsafe_count == 0

    run_offboard(run_simulated, scenario)


def test_nothing_is_sent_after_the_vehicle_left_offboard(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request())
        await sleep(1)
        autopilot.mode = autopilot.requested_mode = POSITION_MODE
        autopilot.send_current_mode()
        await assert_nothing_sent(autopilot, link, settle_s=0.15)
        assert offboard_event_codes(vehicle) == ["left_offboard"]

    run_offboard(run_simulated, scenario)


@pytest.mark.parametrize("seed", range(21))
def test_a_stream_starts_changes_and_stops_at_20_percent_loss(run_simulated, seed):
    async def scenario(testbed, vehicle, autopilot, link):
        began_s = testbed.loop.time()
        await vehicle.offboard.start(stream_request())
        assert testbed.loop.time() - began_s < 12
        for north in range(5):
            await vehicle.offboard.setpoint(stream_request(position=(float(north), 0.0, -5.0)))
            await sleep(0.2)
        began_s = testbed.loop.time()
        await vehicle.offboard.stop()
        assert testbed.loop.time() - began_s < 6
        assert autopilot.mode == HOLD_MODE
        assert autopilot.failsafe_count == 0
        await assert_nothing_sent(autopilot, link)

    run_offboard(run_simulated, scenario, loss=0.2, seed=seed)


@pytest.mark.parametrize("seed", range(21))
def test_each_command_ends_in_time_at_20_percent_loss(run_simulated, seed):
    async def scenario(testbed, vehicle, autopilot, link):
        command = vehicle.command
        for call in (command.hold, command.land, command.hold, command.rtl, command.kill):
            began_s = testbed.loop.time()
            await call()
            assert testbed.loop.time() - began_s <= 6
        assert not autopilot.armed

    run_offboard(run_simulated, scenario, loss=0.2, seed=seed)


# --- starting -------------------------------------------------------------------------------------


def test_one_of_two_simultaneous_starts_flies_and_the_other_is_refused(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        first_start = asyncio.ensure_future(vehicle.offboard.start(stream_request(client="a")))
        await asyncio.sleep(0)
        with pytest.raises(Refused, match="already has a setpoint stream"):
            await vehicle.offboard.start(stream_request(client="b"))
        assert (await first_start).client == "a"
        assert autopilot.mode == OFFBOARD_MODE

    run_offboard(run_simulated, scenario)


def test_a_stop_before_the_offboard_request_prevents_the_request(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        await sleep(0.5)
        await vehicle.offboard.stop()
        with pytest.raises(Refused, match="stopped"):
            await starting
        await sleep(8)
        assert not mode_requests(autopilot, OFFBOARD_MODE)
        assert autopilot.mode == HOLD_MODE

    run_offboard(run_simulated, scenario)


def test_a_stop_during_the_offboard_switch_ends_in_hold(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.offboard_delay_s = 0.4
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        while not mode_requests(autopilot, OFFBOARD_MODE):
            await sleep(0.01)
        await vehicle.offboard.stop(vehicle.tickets.open("stop"))
        with pytest.raises(Interrupted):
            await starting
        await sleep(8)
        assert autopilot.failsafe_count == 0
        assert autopilot.mode == HOLD_MODE
        await assert_nothing_sent(autopilot, link)

    run_offboard(run_simulated, scenario)


def test_a_stopped_start_affects_no_later_start(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        first_start = asyncio.ensure_future(vehicle.offboard.start(stream_request(client="a")))
        await sleep(0.5)
        await vehicle.offboard.stop()
        second_start = asyncio.ensure_future(vehicle.offboard.start(stream_request(client="b")))
        with pytest.raises(Refused):
            await first_start
        assert (await second_start).client == "b"
        await sleep(2)
        assert vehicle.offboard.status().state == "streaming"
        assert autopilot.failsafe_count == 0

    run_offboard(run_simulated, scenario)


def test_another_command_during_a_start_never_leaves_the_vehicle_in_offboard_without_a_stream(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.offboard_delay_s = 0.6
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        while not mode_requests(autopilot, OFFBOARD_MODE):
            await sleep(0.01)
        await vehicle.command.arm()
        with pytest.raises(Refused, match="arm"):
            await starting
        await sleep(6)
        assert autopilot.failsafe_count == 0
        assert autopilot.mode == HOLD_MODE
        assert not vehicle.offboard.status().streaming

    run_offboard(run_simulated, scenario)


def test_a_cancelled_start_never_leaves_the_vehicle_in_offboard_without_a_stream(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.offboard_delay_s = 0.4
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        while not mode_requests(autopilot, OFFBOARD_MODE):
            await sleep(0.01)
        starting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await starting
        await sleep(6)
        assert autopilot.failsafe_count == 0
        assert autopilot.mode == HOLD_MODE
        await assert_nothing_sent(autopilot, link)

    run_offboard(run_simulated, scenario)


def test_a_vehicle_that_switches_to_offboard_late_does_not_stay_in_offboard_without_a_stream(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.offboard_delay_s = 7.0
        with pytest.raises((NoReply, Rejected)) as caught:
            await vehicle.offboard.start(stream_request())
        assert not vehicle.offboard.status().streaming or isinstance(caught.value, NoReply)
        await sleep(10)
        assert autopilot.failsafe_count == 0 or isinstance(caught.value, Rejected)

    run_offboard(run_simulated, scenario)


def test_after_a_refused_switch_to_offboard_the_stream_ends_at_once(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.has_stream = lambda: False
        with pytest.raises(Rejected):
            await vehicle.offboard.start(stream_request())
        await assert_nothing_sent(autopilot, link)
        assert autopilot.mode == HOLD_MODE

    run_offboard(run_simulated, scenario)


def test_a_vehicle_lost_before_the_offboard_request_ends_the_stream(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        starting = asyncio.ensure_future(vehicle.offboard.start(stream_request()))
        await sleep(0.3)
        autopilot.alive = False
        with pytest.raises((Disconnected, NoReply, Refused)):
            await starting
        await sleep(9)
        assert not vehicle.offboard.status().streaming
        assert autopilot.mode == HOLD_MODE, "the vehicle stayed in Offboard"
        assert autopilot.failsafe_count == 0
        await assert_nothing_sent(autopilot, link)

    run_offboard(run_simulated, scenario)


def test_a_rate_too_low_for_the_vehicles_timeout_is_refused(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.params["COM_OF_LOSS_T"] = (REAL32, 0.4)
        with pytest.raises(Refused, match="too few"):
            await vehicle.offboard.start(stream_request(), rate_hz=2.0)
        await assert_nothing_sent(autopilot, link)
        await vehicle.offboard.start(stream_request(), rate_hz=5.0)

    run_offboard(run_simulated, scenario)


def test_a_stream_can_be_started_in_mission_mode(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.mode = autopilot.requested_mode = MISSION_MODE
        await sleep(2)
        assert vehicle.status.mode == "mission"
        await vehicle.offboard.start(stream_request())
        assert autopilot.mode == OFFBOARD_MODE

    run_offboard(run_simulated, scenario)


def test_a_stream_to_a_disarmed_vehicle_ends_in_hold_at_expiry(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=1.0, hold_for_s=1.0))
        await sleep(4)
        assert autopilot.mode == HOLD_MODE, "the vehicle stayed in Offboard: it would climb when it is armed"
        assert not vehicle.offboard.status().streaming

    run_offboard(run_simulated, scenario, flying=False)


# --- expiry ---------------------------------------------------------------------------------------


def test_after_expiry_the_stream_holds_the_position_estimated_at_that_moment(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        async def move():
            while True:
                await sleep(0.01)
                autopilot.position_ned_m[0] += 0.1
                autopilot.velocity = (10.0, 0.0, 0.0)

        moving = asyncio.ensure_future(move())
        await vehicle.offboard.start(stream_request(velocity=(10.0, 0.0, 0.0), valid_for_s=0.5))
        while vehicle.offboard.status().state == "streaming":
            await sleep(0.004)
        north_m = autopilot.position_ned_m[0]
        await sleep(0.05)
        hold_setpoint = autopilot.setpoints[-1][1]
        assert hold_setpoint.type_mask == POSITION_AND_YAW
        assert hold_setpoint.x == pytest.approx(north_m, abs=0.6), (
            "the held position is more than 60 ms old at 10 m/s"
        )
        moving.cancel()

    run_offboard(run_simulated, scenario)


def test_expiry_on_a_lost_link_requests_hold_and_sends_no_old_position(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(velocity=(10.0, 0.0, 0.0), valid_for_s=1.6))
        autopilot.send_raw = lambda raw: None  # the vehicle receives, the server does not
        await sleep(2)
        assert autopilot.mode == HOLD_MODE
        assert not mode_requests(autopilot, LAND_MODE)
        hold_setpoints = [m for t, m in autopilot.setpoints if m.type_mask == POSITION_AND_YAW]
        assert not hold_setpoints, "the server sent a position that is one second old and behind the vehicle"
        await sleep(8)
        assert not vehicle.offboard.status().streaming

    run_offboard(run_simulated, scenario)


def test_after_expiry_a_vehicle_that_lost_its_position_lands(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(velocity=(1.0, 0.0, 0.0), valid_for_s=2.0))
        autopilot.has_estimates = False
        await sleep(3)
        assert autopilot.mode == LAND_MODE
        assert not mode_requests(autopilot, HOLD_MODE)

    run_offboard(run_simulated, scenario)


@pytest.mark.parametrize("seed", range(5))
def test_hold_is_requested_until_confirmed_while_the_stream_continues(run_simulated, seed):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, hold_for_s=0.5))
        await sleep(9)
        assert autopilot.mode == HOLD_MODE
        assert autopilot.failsafe_count == 0
        assert offboard_event_codes(vehicle) == ["expired", "held"]

    run_offboard(run_simulated, scenario, loss=0.2, seed=seed)


def test_if_hold_is_always_refused_the_vehicles_own_failsafe_follows(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, hold_for_s=0.5))
        autopilot.refusals[DO_SET_MODE] = 1
        await sleep(9)
        assert offboard_event_codes(vehicle) == ["expired", "not_confirmed"]
        assert len(mode_requests(autopilot, HOLD_MODE)) == 5
        assert autopilot.failsafe_count == 1
        await assert_nothing_sent(autopilot, link)

    run_offboard(run_simulated, scenario)


def test_a_setpoint_resumes_the_stream_in_position_hold_but_not_after_hold_is_requested(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, hold_for_s=1.0))
        await sleep(0.8)
        assert vehicle.offboard.status().state == "holding"
        resumed = await vehicle.offboard.setpoint(stream_request(valid_for_s=0.5, hold_for_s=0.2))
        assert resumed.state == "streaming"
        autopilot.silent_commands.add(DO_SET_MODE)
        await sleep(1.0)
        assert vehicle.offboard.status().state == "to_hold"
        with pytest.raises(Refused, match="ending"):
            await vehicle.offboard.setpoint(stream_request())

    run_offboard(run_simulated, scenario)


def test_a_start_during_the_position_hold_after_an_expiry_is_refused(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, hold_for_s=5.0))
        await sleep(1)
        with pytest.raises(Refused, match="already has a setpoint stream"):
            await vehicle.offboard.start(stream_request())

    run_offboard(run_simulated, scenario)


def test_a_stop_does_not_replace_the_landing_after_an_expiry_by_hold(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=0.5, action="land"))
        autopilot.silent_commands.add(DO_SET_MODE)
        await sleep(1)
        assert vehicle.offboard.status().state == "landing"
        assert (await vehicle.offboard.stop()).state == "landing"
        autopilot.silent_commands.clear()
        await sleep(3)
        assert autopilot.mode == LAND_MODE

    run_offboard(run_simulated, scenario)


def test_a_stop_that_the_vehicle_does_not_acknowledge_is_repeated(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(hold_for_s=3600.0))
        autopilot.silent_commands.add(DO_SET_MODE)
        with pytest.raises(NoReply):
            await vehicle.offboard.stop()
        assert autopilot.failsafe_count == 0
        autopilot.silent_commands.clear()
        await sleep(3)
        assert autopilot.mode == HOLD_MODE
        await assert_nothing_sent(autopilot, link)

    run_offboard(run_simulated, scenario)


def test_the_last_setpoint_of_two_clients_applies_and_each_client_may_stop(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(client="a"))
        for number in range(10):
            client = "ab"[number % 2]
            position_ned_m = (float(number), 0.0, -5.0)
            status = await vehicle.offboard.setpoint(stream_request(position=position_ned_m, client=client))
            assert (status.client, status.setpoint["position_ned_m"]) == (client, position_ned_m)
            await sleep(0.05)
            assert autopilot.setpoints[-1][1].x == number
        await vehicle.offboard.stop()
        with pytest.raises(Refused, match="stopped"):
            await vehicle.offboard.setpoint(stream_request(client="a"))

    run_offboard(run_simulated, scenario)
