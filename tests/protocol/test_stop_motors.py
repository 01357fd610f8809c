"""Stop motors (kill) has priority: the server sends it until the vehicle reports that it is disarmed, and
refuses other commands meanwhile."""

import asyncio
import itertools
import random

import pytest

from gcs_server.api import control_models, control_routes
from gcs_server.errors import GcsError, NoReply, Refused, Rejected
from tests.protocol.api_calls import run_with_routes
from tests.protocol.command_numbers import (
    ARM_DISARM,
    DO_REPOSITION,
    DO_SET_MODE,
    FORCE,
    TAKEOFF_COMMAND,
)
from tests.protocol.fake_autopilot import HOLD_MODE, ON_GROUND
from tests.protocol.group_testbed import ANNA, position_setpoint, run_with_vehicles, start_group
from tests.protocol.offboard_testbed import run_offboard, sleep, stream_request
from tests.protocol.one_vehicle import PACKET_LOSS_CASES

ORBIT_MODE = 3 << 16 | 1 << 24
GOTO = {"lat_deg": 47.398, "lon_deg": 8.546, "alt_home_m": 12}
CALLS = {
    "hold": lambda v: v.command.hold(by="bob"),
    "land": lambda v: v.command.land(by="bob"),
    "rtl": lambda v: v.command.rtl(by="bob"),
    "mode": lambda v: v.command.set_mode("position", by="bob"),
    "arm": lambda v: v.command.arm(),
    "disarm": lambda v: v.command.disarm(),
    "goto": lambda v: v.guided.goto(**GOTO),
    "offboard": lambda v: v.offboard.start(stream_request()),
}
MOVING_COMMANDS = (TAKEOFF_COMMAND, DO_SET_MODE, DO_REPOSITION, ARM_DISARM)


def is_kill(message):
    return getattr(message, "command", None) == ARM_DISARM and message.param2 == FORCE


def other_commands(autopilot):
    """All other received commands that could move the vehicle: arm, modes, take-off, go to."""
    return [
        message
        for message in autopilot.received_messages
        if getattr(message, "command", None) in MOVING_COMMANDS and not is_kill(message)
    ]


def ignore_kill(autopilot, for_s):
    """Makes the autopilot ignore stop motors for this time; returns the times of its arrival."""
    until_s = autopilot.loop.time() + for_s
    kill_times_s = []

    def ignore(message):
        if is_kill(message):
            kill_times_s.append(autopilot.loop.time())
        return is_kill(message) and autopilot.loop.time() < until_s

    autopilot.handlers.append(ignore)
    return kill_times_s


@pytest.mark.parametrize("command", list(CALLS))
def test_a_later_command_is_refused_with_a_reason_and_does_not_end_stop_motors(run_simulated, command):
    async def scenario(testbed, vehicle, autopilot, link):
        kill_times_s = ignore_kill(autopilot, 3.0)
        kill = asyncio.ensure_future(vehicle.command.kill(by="anna"))
        await sleep(1.0)
        command_count = len(other_commands(autopilot))
        with pytest.raises(Refused, match="Stop motors was commanded by anna") as caught:
            await CALLS[command](vehicle)
        assert "disarmed" in caught.value.remedy
        await kill
        assert not autopilot.armed
        assert len(other_commands(autopilot)) == command_count
        assert all(b - a < 0.3 for a, b in itertools.pairwise(kill_times_s))
        await CALLS["hold"](vehicle)  # after stop motors, commands are accepted again

    run_offboard(run_simulated, scenario)


def test_stop_motors_ends_pending_commands(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.silent_commands.add(DO_SET_MODE)
        hold = asyncio.ensure_future(vehicle.command.hold())
        await sleep(0.2)
        ignore_kill(autopilot, 2.0)
        kill = asyncio.ensure_future(vehicle.command.kill())
        with pytest.raises(Refused, match="stop motors"):
            await hold
        mode_request_count = len(autopilot.received_commands(DO_SET_MODE))
        await kill
        assert len(autopilot.received_commands(DO_SET_MODE)) == mode_request_count

    run_offboard(run_simulated, scenario)


def test_the_end_of_a_stream_requests_no_mode_during_stop_motors(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request(valid_for_s=2.0, hold_for_s=0.5))
        ignore_kill(autopilot, 5.0)
        mode_request_count = len(autopilot.received_commands(DO_SET_MODE))
        await vehicle.command.kill()  # 2.5 s later the stream would request Hold
        assert not autopilot.armed
        await sleep(0.3)
        assert len(autopilot.received_commands(DO_SET_MODE)) == mode_request_count
        assert not vehicle.offboard.status().streaming

    run_offboard(run_simulated, scenario)


def test_a_stop_of_the_stream_waits_for_stop_motors(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        await vehicle.offboard.start(stream_request())
        mode_request_count = len(autopilot.received_commands(DO_SET_MODE))
        ignore_kill(autopilot, 2.0)
        kill = asyncio.ensure_future(vehicle.command.kill())
        await sleep(0.5)
        stop = asyncio.ensure_future(vehicle.offboard.stop())
        await sleep(1.0)
        assert not stop.done()
        assert len(autopilot.received_commands(DO_SET_MODE)) == mode_request_count
        await kill
        await stop
        assert not vehicle.offboard.status().streaming

    run_offboard(run_simulated, scenario)


def test_hold_and_guard_of_a_group_do_not_end_stop_motors_of_a_member(run_simulated):
    async def scenario(rig):
        await start_group(rig, {"1": position_setpoint(), "2": position_setpoint()})
        await sleep(2.0)
        kill_times_s = ignore_kill(rig.autopilots["1"], 3.0)
        mode_request_count = len(rig.autopilots["1"].received_commands(DO_SET_MODE))
        kill = asyncio.ensure_future(rig.vehicles["1"].command.kill())
        await sleep(0.3)
        rig.testbed.streamer._streams.force_hold("1", "the guard's finding")
        await rig.station.flights.groups.hold("1", ANNA)
        await kill
        assert not rig.autopilots["1"].armed
        assert all(b - a < 0.3 for a, b in itertools.pairwise(kill_times_s))
        # Hold follows when stop motors has ended.
        assert len(rig.autopilots["1"].received_commands(DO_SET_MODE)) - mode_request_count <= 1
        assert rig.vehicles["2"].status.mode == "hold"
        assert rig.autopilots["2"].armed

    run_with_vehicles(run_simulated, scenario, count=2)


def test_neither_a_refusal_nor_an_acceptance_without_effect_ends_stop_motors(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        results = itertools.cycle([2, 0, 4, 5])  # denied, accepted, failed, in progress
        began_s = testbed.loop.time()

        def acknowledge(message):
            if not is_kill(message) or testbed.loop.time() - began_s > 5.0:
                return False
            autopilot.send_ack(ARM_DISARM, next(results))
            return True

        autopilot.handlers.append(acknowledge)
        await vehicle.command.kill()
        assert not autopilot.armed
        autopilot.armed = True
        autopilot.handlers.append(lambda m: is_kill(m) and not autopilot.send_ack(ARM_DISARM, 2))
        await sleep(2.0)
        with pytest.raises(Rejected, match="refused to stop its motors"):
            await vehicle.command.kill()

    run_offboard(run_simulated, scenario)


def test_stop_motors_continues_after_its_caller_is_cancelled(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        ignore_kill(autopilot, 3.0)
        kill = asyncio.ensure_future(vehicle.command.kill())
        await sleep(0.5)
        kill.cancel()
        await sleep(1.0)
        with pytest.raises(Refused):
            await vehicle.command.hold()
        await sleep(2.0)
        assert not autopilot.armed
        await vehicle.command.hold()

    run_offboard(run_simulated, scenario)


def test_stop_motors_is_sent_to_a_lost_vehicle_until_the_deadline(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        send_raw = autopilot.send_raw
        autopilot.send_raw = lambda raw: None
        kill_times_s = ignore_kill(autopilot, 100.0)
        await sleep(1.0)  # no messages for 3.5 s, so it is lost during the command
        began_s = testbed.loop.time()
        with pytest.raises(NoReply):
            await vehicle.command.kill()
        assert vehicle.status.link_lost
        assert testbed.loop.time() - began_s == pytest.approx(6.0, abs=0.1)
        assert kill_times_s[-1] - kill_times_s[0] > 5.5
        autopilot.send_raw = send_raw

    run_offboard(run_simulated, scenario)


def test_a_late_arm_command_does_not_confirm_stop_motors(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        autopilot.armed, autopilot.landed_state = False, ON_GROUND
        await sleep(2.0)
        delayed = []

        def delay_first_arm(message):
            # The arm command is executed half a second late, after a heartbeat that shows disarmed.
            if getattr(message, "command", None) == ARM_DISARM and message.param1 == 1.0 and not delayed:
                delayed.append(message)
                testbed.loop.call_later(0.5, lambda: setattr(autopilot, "armed", True))
                return True
            return is_kill(message) and not autopilot.armed

        autopilot.handlers.append(delay_first_arm)
        arm = asyncio.ensure_future(vehicle.command.arm())
        await sleep(0.05)
        await vehicle.command.kill()
        assert not autopilot.armed
        with pytest.raises(Refused):
            await arm
        await sleep(2.0)
        assert not autopilot.armed

    run_offboard(run_simulated, scenario)


@pytest.mark.parametrize(("ignored_s", "mode_after"), [(2.0, None), (20.0, HOLD_MODE)])
def test_the_action_at_the_expiry_of_control_waits_for_stop_motors(run_simulated, ignored_s, mode_after):
    async def scenario(rig):
        rig.autopilot.mode = ORBIT_MODE
        await sleep(2.5)
        await control_routes.take("1", rig.station, ANNA, control_models.TakeControl(on_expiry="hold"))
        await sleep(28.5)
        ignore_kill(rig.autopilot, ignored_s)
        kill = asyncio.ensure_future(rig.vehicle.command.kill())
        await sleep(3.0)  # the 30 s control lease expires during stop motors
        assert not rig.autopilot.received_commands(DO_SET_MODE)
        await asyncio.gather(kill, return_exceptions=True)
        await sleep(3.0)
        assert bool(rig.autopilot.received_commands(DO_SET_MODE)) == (mode_after is not None)
        assert rig.autopilot.mode == (mode_after or ORBIT_MODE)

    run_with_routes(run_simulated, scenario)


def test_a_server_shutdown_waits_for_stop_motors(run_simulated):
    async def scenario(testbed, vehicle, autopilot, link):
        ignore_kill(autopilot, 2.0)
        kill = asyncio.ensure_future(vehicle.command.kill())
        await sleep(0.1)
        assert await testbed.streamer.stop_all() == []
        assert not autopilot.armed
        await kill

    run_offboard(run_simulated, scenario)


@pytest.mark.parametrize(("loss", "seed"), [*PACKET_LOSS_CASES, *((0.2, seed) for seed in range(20, 40))])
def test_the_motors_stop_in_any_order_of_commands_and_with_packet_loss(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot, link):
        rng = random.Random(seed)
        if rng.random() < 0.5:
            await vehicle.offboard.start(stream_request(valid_for_s=rng.uniform(0.5, 4.0), hold_for_s=0.2))
        other_calls = []

        async def call_after(call, after_s):
            await asyncio.sleep(after_s)
            try:
                await call(vehicle)
            except GcsError as error:
                return error

        calls = [call for name, call in CALLS.items() if name != "arm"]  # "arm" would arm the vehicle again
        for _ in range(8):
            other_calls.append(asyncio.ensure_future(call_after(rng.choice(calls), rng.uniform(0.0, 4.0))))
        other_calls.append(
            asyncio.ensure_future(call_after(lambda v: v.offboard.stop(), rng.uniform(0.0, 4.0)))
        )
        await sleep(rng.uniform(0.0, 2.0))
        ignore_kill(autopilot, rng.uniform(0.0, 3.0))
        received_before = len(autopilot.received_messages)
        kills = [asyncio.ensure_future(vehicle.command.kill()) for _ in range(rng.choice([1, 2]))]
        await asyncio.gather(*kills)
        assert not autopilot.armed
        received = autopilot.received_messages[received_before:]
        last_kill = max(i for i, m in enumerate(received) if is_kill(m))
        first_kill = next(i for i, m in enumerate(received) if is_kill(m))
        commands_between = [m for m in received[first_kill : last_kill + 1] if m in other_commands(autopilot)]
        assert not commands_between
        await asyncio.gather(*other_calls)

    run_offboard(run_simulated, scenario, loss=loss, seed=seed)
