"""Commands to a scripted autopilot at packet loss: a command succeeds when the vehicle's state shows the
result."""

import asyncio
import math
import struct

import pytest

from gcs_server.api.authorized import progress_reporter
from gcs_server.control.principal import Principal
from gcs_server.errors import Disconnected, InvalidRequest, NoReply, NotVerified, Refused, Rejected
from gcs_server.vehicle.px4.events import ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID
from tests.protocol.command_numbers import (
    ARM_DISARM,
    DO_REPOSITION,
    DO_SET_MODE,
    FORCE,
    RUN_PREARM_CHECKS,
    TAKEOFF_COMMAND,
)
from tests.protocol.fake_autopilot import HOLD_MODE, IN_AIR, ON_GROUND, POSITION_MODE
from tests.protocol.one_vehicle import PACKET_LOSS_CASES, run_scenario
from vehicle_sim.mavlink import generated_dialect as sim


@pytest.mark.parametrize(("loss", "seed"), PACKET_LOSS_CASES)
def test_each_command_of_a_flight_reaches_its_state_in_time(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        async def finish_within(limit_s, call):
            began_s = testbed.loop.time()
            await call
            assert testbed.loop.time() - began_s <= limit_s

        await finish_within(6, vehicle.command.arm())
        assert vehicle.status.armed
        await finish_within(6, vehicle.command.disarm())
        assert not vehicle.status.armed
        await finish_within(20, vehicle.command.takeoff(10))
        assert vehicle.status.armed
        assert vehicle.status.mode == "takeoff"
        assert autopilot.target[2] == pytest.approx(499.0, abs=0.01)
        assert len([m for m in autopilot.received_commands(ARM_DISARM) if m.param1 == 1]) >= 2
        autopilot.landed_state, autopilot.position[2] = IN_AIR, 499.0
        await finish_within(6, vehicle.command.hold())
        assert vehicle.status.mode == "hold"
        await finish_within(6, vehicle.guided.goto(47.398, 8.546, alt_home_m=12, yaw_ned_deg=90))
        assert autopilot.target == pytest.approx((47.398, 8.546, 501.0))
        command = autopilot.received_commands(DO_REPOSITION)[-1]
        assert command.get_type() == "COMMAND_INT"
        assert command.param4 == pytest.approx(math.pi / 2)
        await finish_within(6, vehicle.command.rtl())
        assert vehicle.status.mode == "rtl"
        await finish_within(6, vehicle.command.land())
        assert vehicle.status.mode == "land"
        await finish_within(6, vehicle.command.kill())
        assert not vehicle.status.armed
        assert autopilot.received_commands(ARM_DISARM)[-1].param2 == FORCE

    run_scenario(run_simulated, scenario, loss=loss, seed=seed)


@pytest.mark.parametrize("seed", range(8))
def test_commands_succeed_at_twenty_percent_loss_within_the_deadline(run_simulated, seed):
    async def scenario(testbed, vehicle, autopilot):
        for _ in range(5):
            await vehicle.command.arm()
            await vehicle.command.set_mode("position")
            await vehicle.command.set_mode("hold")
            await vehicle.command.disarm()

    run_scenario(run_simulated, scenario, loss=0.2, seed=100 + seed)


def test_the_confirmation_field_counts_repeats_and_nothing_is_sent_after_success(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        dropped = []

        def drop_first_two(m):
            if m.get_type() != "COMMAND_LONG" or m.command != ARM_DISARM or len(dropped) == 2:
                return False
            dropped.append(m)
            return True

        autopilot.handlers.append(drop_first_two)
        await vehicle.command.arm()
        assert [m.confirmation for m in autopilot.received_commands(ARM_DISARM)] == [0, 1, 2]
        await asyncio.sleep(10)
        assert len(autopilot.received_commands(ARM_DISARM)) == 3

    run_scenario(run_simulated, scenario)


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 1), (0.2, 11), (0.2, 12)])
def test_a_mode_that_is_accepted_and_then_refused_is_rejected_with_its_reason(run_simulated, loss, seed):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.armed, autopilot.landed_state = True, IN_AIR
        await asyncio.sleep(4)
        with pytest.raises(Rejected) as caught:
            await vehicle.command.set_mode("manual")
        if not loss:
            assert caught.value.mav_result == 1
            assert caught.value.reasons == ("Switching to Manual is currently not available",)
        assert vehicle.status.mode == "hold"

    run_scenario(run_simulated, scenario, loss=loss, seed=seed)


def test_a_refusal_to_arm_lists_the_failed_checks(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.arm_denied = True
        # The events of an arming report with failed checks.
        summary = struct.pack("<BIIII", 0, 1048576, 128, 0, 0)
        autopilot.send_event(ARMING_SUMMARY_ID, 0x88, summary)
        autopilot.send_event(30612409, 0x33, struct.pack("<IB", 8257660, 17))
        autopilot.send_event(19865031, 0x33, struct.pack("<IB", 16384, 20))
        autopilot.send_event(17231145, 0x44, struct.pack("<IB", 0xFFFFFFFF, 7))
        autopilot.send_event(HEALTH_SUMMARY_ID, 0x88)
        await asyncio.sleep(1)
        with pytest.raises(Rejected) as caught:
            await vehicle.command.arm()
        assert caught.value.mav_result == 1
        assert caught.value.reasons == (
            "Arming denied: Resolve system health failures first",
            "no valid position estimate",
        )
        with pytest.raises(Rejected):
            await vehicle.command.takeoff(5)
        assert autopilot.received_commands(RUN_PREARM_CHECKS)
        assert vehicle.status.mode == "hold"  # in Takeoff mode, the vehicle would climb when it is armed

    run_scenario(run_simulated, scenario)


def test_disarming_in_flight_is_refused(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.armed, autopilot.landed_state = True, IN_AIR
        await asyncio.sleep(3)
        with pytest.raises(Rejected, match="not landed"):
            await vehicle.command.disarm()

    run_scenario(run_simulated, scenario)


def test_an_acknowledgement_without_the_commanded_state_is_not_a_success(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        def only_acknowledge(m):
            if m.get_type() != "COMMAND_LONG" or m.command != ARM_DISARM:
                return False
            autopilot.send_ack(ARM_DISARM, 0)
            return True

        autopilot.handlers.append(only_acknowledge)
        with pytest.raises(Rejected, match="accepted the request to arm"):
            await vehicle.command.arm()

    run_scenario(run_simulated, scenario)


def test_the_commanded_state_without_an_acknowledgement_is_a_success(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.send_ack = lambda *_: None
        await vehicle.command.arm()
        await vehicle.command.set_mode("offboard")
        assert vehicle.status.mode == "offboard"

    run_scenario(run_simulated, scenario)


def test_a_command_without_a_reply_fails_at_its_deadline(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.silent_commands.add(ARM_DISARM)
        began_s = testbed.loop.time()
        with pytest.raises(NoReply) as caught:
            await vehicle.command.arm()
        assert testbed.loop.time() - began_s == pytest.approx(caught.value.deadline_s, abs=0.1)

    run_scenario(run_simulated, scenario)


def test_acknowledgements_to_other_stations_are_ignored(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        def acknowledge_to_another_station(m):
            if m.get_type() == "COMMAND_LONG" and m.command == ARM_DISARM:
                autopilot.send(
                    sim.MAVLink_command_ack_message(ARM_DISARM, sim.MAV_RESULT_DENIED, 0, 0, 42, 1)
                )
                return True
            return False

        autopilot.handlers.append(acknowledge_to_another_station)
        with pytest.raises(NoReply):
            await vehicle.command.arm()

    run_scenario(run_simulated, scenario)


def test_a_progress_report_extends_the_deadline_and_is_published(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        fractions = []

        def report_progress(m):
            if m.get_type() != "COMMAND_LONG" or m.command != ARM_DISARM:
                return False
            for second in range(1, 15):
                testbed.loop.call_later(
                    second, autopilot.send_ack, ARM_DISARM, sim.MAV_RESULT_IN_PROGRESS, second * 6
                )
            testbed.loop.call_later(15, lambda: setattr(autopilot, "armed", True))
            return True

        autopilot.handlers.append(report_progress)
        received_events = []
        vehicle.events.subscribe(received_events.append)

        client = Principal.from_identity("page-1", "a tab")

        def progress(text, fraction):
            fractions.append(fraction)
            progress_reporter(vehicle, client, "arm")(text, fraction)

        await vehicle.command.arm(progress=progress)
        assert vehicle.status.armed
        assert 0.84 in fractions  # of the last report
        progress_events = [e for e in received_events if e.kind == "progress"]
        assert progress_events[0].text == f"Commanding vehicle {vehicle.id} to arm"
        expected = {"command": "arm", "client": "page-1", "client_key": client.key, "fraction": 0.84}
        assert expected in [dict(e.data) for e in progress_events]
        assert not [e for e in vehicle.events.since() if e.kind == "progress"]  # not stored in any history

    run_scenario(run_simulated, scenario)


def test_command_int_is_sent_if_the_vehicle_does_not_accept_command_long(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        def refuse_command_long(m):
            if m.get_type() != "COMMAND_LONG" or m.command != ARM_DISARM:
                return False
            autopilot.send_ack(ARM_DISARM, sim.MAV_RESULT_COMMAND_INT_ONLY)
            return True

        autopilot.handlers.append(refuse_command_long)
        await vehicle.command.arm()
        assert [m.get_type() for m in autopilot.received_commands(ARM_DISARM)] == [
            "COMMAND_LONG",
            "COMMAND_INT",
        ]

    run_scenario(run_simulated, scenario)


def test_hold_goes_on_when_the_link_is_lost_meanwhile_and_arrives_when_it_is_back(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.mode = POSITION_MODE
        autopilot.silent_commands.add(DO_SET_MODE)
        await asyncio.sleep(2)
        autopilot.alive = False
        await asyncio.sleep(2)
        holding = asyncio.ensure_future(vehicle.command.hold(on_lost_link=True))
        await asyncio.sleep(3)
        assert vehicle.status.link_lost
        assert not holding.done()
        autopilot.silent_commands.clear()
        autopilot.alive = True
        await holding
        assert autopilot.mode == HOLD_MODE

    run_scenario(run_simulated, scenario)


def test_a_newer_command_ends_an_older_command(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.lift_off = lambda: None
        takeoff = asyncio.ensure_future(vehicle.command.takeoff(10))
        await asyncio.sleep(3)
        await vehicle.command.hold()
        with pytest.raises(Refused, match="hold"):
            await takeoff
        assert vehicle.status.mode == "hold"

    run_scenario(run_simulated, scenario)


def test_a_lost_link_fails_pending_commands_at_once(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.silent_commands.add(ARM_DISARM)
        arming = asyncio.ensure_future(vehicle.command.arm())
        await asyncio.sleep(0.5)
        began_s = testbed.loop.time()
        await testbed.router.remove_link("memory")
        with pytest.raises(Disconnected):
            await arming
        assert testbed.loop.time() - began_s < 0.1
        await asyncio.sleep(5)
        assert vehicle.status.link_lost
        with pytest.raises(Disconnected):
            await vehicle.command.hold()
        with pytest.raises(Disconnected, match="not connected") as no_link:
            await vehicle.command.hold(on_lost_link=True)
        assert "nothing was sent" in no_link.value.remedy
        assert testbed.fleet.get("1") is vehicle

    run_scenario(run_simulated, scenario)


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda v: v.command.takeoff(math.nan), "alt_home_m"),
        (lambda v: v.command.takeoff(0.2), "alt_home_m"),
        (lambda v: v.command.takeoff(500), "alt_home_m"),
        (lambda v: v.command.set_mode("fly"), "mode"),
        (lambda v: v.command.set_mode("termination"), "mode"),
        (lambda v: v.guided.goto(math.nan, 8, alt_home_m=5), "lat_deg"),
        (lambda v: v.guided.goto(95, 8, alt_home_m=5), "lat_deg"),
        (lambda v: v.guided.goto(47, math.inf, alt_home_m=5), "lon_deg"),
        (lambda v: v.guided.goto(47, 8), "alt_amsl_m"),
        (lambda v: v.guided.goto(47, 8, alt_home_m=5, alt_amsl_m=500), "alt_amsl_m"),
        (lambda v: v.guided.goto(47, 8, alt_home_m=math.nan), "alt_home_m"),
        (lambda v: v.guided.goto(47, 8, alt_home_m=5, yaw_ned_deg=math.nan), "yaw_ned_deg"),
        (lambda v: v.guided.goto(47, 8, alt_home_m=5, max_distance_m=math.nan), "max_distance_m"),
        (lambda v: v.guided.change_altitude(), "alt_amsl_m"),
        (lambda v: v.guided.change_altitude(alt_home_m=math.inf), "alt_home_m"),
        (lambda v: v.guided.change_heading(math.nan), "yaw_ned_deg"),
        (lambda v: v.guided.orbit(math.nan, 8, alt_home_m=5, radius_m=9, speed_m_s=1), "lat_deg"),
        (lambda v: v.guided.set_home((47, 999, 489)), "lon_deg"),
    ],
)
def test_the_error_about_an_invalid_value_names_its_field_and_nothing_is_sent(run_simulated, call, field):
    async def scenario(testbed, vehicle, autopilot):
        count = len([m for m in autopilot.received_messages if m.get_type().startswith("COMMAND_")])
        with pytest.raises(InvalidRequest) as caught:
            await call(vehicle)
        assert caught.value.field == field
        assert len([m for m in autopilot.received_messages if m.get_type().startswith("COMMAND_")]) == count

    run_scenario(run_simulated, scenario)


def test_the_server_refuses_commands_that_px4_would_accept(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        with pytest.raises(Refused, match="is not flying"):
            await vehicle.guided.goto(47.3978, 8.5456, alt_home_m=10)
        autopilot.armed, autopilot.landed_state = True, IN_AIR
        await asyncio.sleep(3)
        with pytest.raises(Refused, match="m away"):
            await vehicle.guided.goto(47.85, 8.5456, alt_home_m=10)
        with pytest.raises(Refused, match="m away"):
            await vehicle.guided.goto(47.3978, 8.5456, alt_amsl_m=5000)
        with pytest.raises(Refused, match="is already flying"):
            await vehicle.command.takeoff(10)
        autopilot.has_position, autopilot.armed, autopilot.landed_state = False, False, ON_GROUND
        await asyncio.sleep(5)
        with pytest.raises(Refused, match="no global position"):
            await vehicle.command.takeoff(10)
        assert not [c for c in (DO_REPOSITION, TAKEOFF_COMMAND) if autopilot.received_commands(c)]

    run_scenario(run_simulated, scenario)


def test_a_take_off_to_an_altitude_below_the_vehicle_is_refused_with_the_field_and_the_fix(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.home = (*autopilot.home[:2], autopilot.position[2] - 30.4)
        await asyncio.sleep(3)
        with pytest.raises(InvalidRequest, match=r"is 30\.4 m above home") as caught:
            await vehicle.command.takeoff(10)
        assert caught.value.field == "alt_home_m"
        assert "Use at least 32 m" in caught.value.remedy
        assert not autopilot.received_commands(TAKEOFF_COMMAND)
        assert not vehicle.status.armed
        await vehicle.command.takeoff(32)
        assert vehicle.status.mode == "takeoff"

    run_scenario(run_simulated, scenario)


# ArduPilot; PX4 in a fixed wing and in a rover.
@pytest.mark.parametrize(("autopilot_type", "vehicle_type"), [(3, 2), (12, 1), (12, 10)])
def test_unverified_vehicles_are_shown_and_commands_to_them_are_refused(
    run_simulated, autopilot_type, vehicle_type
):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.autopilot_type, autopilot.vehicle_type = autopilot_type, vehicle_type
        await asyncio.sleep(2)
        count = len(autopilot.received_commands(ARM_DISARM))
        for call in (vehicle.command.arm, vehicle.command.kill, vehicle.gimbal.take_control):
            with pytest.raises(NotVerified):
                await call()
        assert len(autopilot.received_commands(ARM_DISARM)) == count
        (shown,) = testbed.fleet.all()
        assert (shown.identity.autopilot, shown.identity.vehicle_type) == (autopilot_type, vehicle_type)

    run_scenario(run_simulated, scenario)
