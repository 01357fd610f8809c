"""Several vehicles start together as a group, or none moves; each refusal names its vehicle."""

import asyncio
from dataclasses import replace

import pytest

from gcs_server.api import command_routes, group_routes, offboard_routes
from gcs_server.api.setpoints import SetpointRequest, StartRequest
from gcs_server.errors import InvalidRequest, NotInControl, NotTogether, Refused, UnknownGroup, UnknownVehicle
from gcs_server.streamer.values.limit_values import OperatorLimits
from tests.protocol.api_calls import journal_entries, json_of
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE, ON_GROUND, POSITION_MODE
from tests.protocol.group_testbed import (
    ANNA,
    BOB,
    SETPOINTS_NORTH,
    STREAM_PERIOD_S,
    assert_no_vehicle_moved,
    autopilot_modes,
    first_setpoint_s,
    group_changes,
    path_setpoint,
    position_setpoint,
    run_with_vehicles,
    setpoints_request,
    start_group,
    start_request,
)
from tests.protocol.offboard_testbed import mode_requests, sleep


def test_all_vehicles_are_switched_to_offboard_first_and_start_within_one_period(run_simulated):
    async def scenario(rig):
        rig.autopilots["2"].offboard_delay_s = 1.4
        started = await start_group(rig, SETPOINTS_NORTH)
        assert started["state"] == "waiting"
        assert set(autopilot_modes(rig).values()) == {OFFBOARD_MODE}
        assert not [m for a in rig.autopilots.values() for _, m in a.setpoints if m.x != 0]
        ahead_s = started["start_unix_s"] - rig.testbed.clock.unix_s()
        assert 0.3 < ahead_s <= 0.5
        expected_start_s = rig.testbed.loop.time() + ahead_s
        await sleep(2.0)
        start_times_s = [first_setpoint_s(autopilot, 4.0) for autopilot in rig.autopilots.values()]
        assert max(start_times_s) - min(start_times_s) < STREAM_PERIOD_S
        assert min(start_times_s) == pytest.approx(expected_start_s, abs=STREAM_PERIOD_S)
        group = json_of(await group_routes.show("1", rig.station))
        assert (group["state"], [m["mode"] for m in group["members"]]) == ("flying", ["offboard"] * 3)
        assert group["nearest"]["distance_m"] == pytest.approx(10.0, abs=0.1)
        assert 57 < group["valid_left_s"] < 60
        assert [state for _, state, _ in group_changes(rig)] == ["starting", "waiting", "flying"]
        assert journal_entries(rig.station)[-3:] == [("anna", "group/start", v, "ok") for v in "321"]

    run_with_vehicles(run_simulated, scenario)


def test_the_start_returns_each_members_limits(run_simulated):
    async def scenario(rig):
        await rig.vehicles["2"].offboard.operator_limits.set(OperatorLimits(speed_max_m_s=4.0), by="bob")
        limits = (await start_group(rig, SETPOINTS_NORTH))["limits"]
        assert {v: member["operator"]["speed_max_m_s"] for v, member in limits.items()} == {
            "1": None,
            "2": 4.0,
            "3": None,
        }
        assert (limits["2"]["origin"]["set_by"], limits["2"]["origin"]["restored"]) == ("bob", False)

    run_with_vehicles(run_simulated, scenario)


def test_a_group_starts_at_the_start_time_of_the_request(run_simulated):
    async def scenario(rig):
        unix_s = rig.testbed.clock.unix_s()
        expected_start_s = rig.testbed.loop.time() + 8.0
        started = await start_group(rig, SETPOINTS_NORTH, start_at_unix_s=unix_s + 8.0)
        assert started["start_unix_s"] == pytest.approx(unix_s + 8.0, abs=1e-3)
        await sleep(10.0)
        start_times_s = [first_setpoint_s(autopilot, 4.0) for autopilot in rig.autopilots.values()]
        assert max(start_times_s) - min(start_times_s) < STREAM_PERIOD_S
        assert min(start_times_s) == pytest.approx(expected_start_s, abs=STREAM_PERIOD_S)

    run_with_vehicles(run_simulated, scenario)


@pytest.mark.parametrize("ahead_s", [-5.0, 1.0, 400.0])
def test_an_impossible_start_time_is_refused(run_simulated, ahead_s):
    async def scenario(rig):
        with pytest.raises(InvalidRequest, match="must be 3 to 300 s ahead") as refused:
            await start_group(rig, SETPOINTS_NORTH, start_at_unix_s=rig.testbed.clock.unix_s() + ahead_s)
        assert refused.value.field == "start_at_unix_s"
        assert not any(mode_requests(autopilot, OFFBOARD_MODE) for autopilot in rig.autopilots.values())

    run_with_vehicles(run_simulated, scenario)


def test_no_vehicle_moves_if_the_start_time_is_before_all_vehicles_are_in_offboard(run_simulated):
    async def scenario(rig):
        rig.autopilots["3"].offboard_delay_s = 3.0
        with pytest.raises(InvalidRequest, match="still ahead when all vehicles are in Offboard"):
            await start_group(rig, SETPOINTS_NORTH, start_at_unix_s=rig.testbed.clock.unix_s() + 3.1)
        await sleep(3)
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert_no_vehicle_moved(rig)

    run_with_vehicles(run_simulated, scenario)


def test_a_vehicle_that_refuses_offboard_cancels_the_start_and_is_named_with_its_reason(run_simulated):
    async def scenario(rig):
        rig.autopilots["2"].has_stream = lambda: False  # the vehicle refuses Offboard
        with pytest.raises(NotTogether, match=r"so none moves\. Vehicle 2: ") as refused:
            await start_group(rig, SETPOINTS_NORTH)
        assert refused.value.vehicles == ("2",)
        await sleep(3)
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert_no_vehicle_moved(rig)
        assert not any(v.offboard.status().streaming for v in rig.vehicles.values())
        ended_group = json_of(await group_routes.show("1", rig.station))
        assert ended_group["state"] == "ended"
        assert "Vehicle 2" in ended_group["ended"]
        assert journal_entries(rig.station)[-1][1:] == ("group/start", "1", "not_together")

    run_with_vehicles(run_simulated, scenario)


def test_a_vehicle_that_never_confirms_offboard_cancels_the_start(run_simulated):
    async def scenario(rig):
        rig.autopilots["3"].offboard_delay_s = 30.0
        with pytest.raises(NotTogether, match="Vehicle 3: "):
            await start_group(rig, SETPOINTS_NORTH)
        await sleep(3)
        assert (rig.autopilots["1"].mode, rig.autopilots["2"].mode) == (HOLD_MODE, HOLD_MODE)
        assert_no_vehicle_moved(rig)

    run_with_vehicles(run_simulated, scenario)


def test_setpoints_that_one_vehicle_cannot_fly_are_refused_before_anything_is_sent(run_simulated):
    async def scenario(rig):
        with pytest.raises(NotTogether, match=r"Vehicle 2: The path begins 30\.0 m away"):
            far_path = path_setpoint((0, [30, 0, -5]), (5, [35, 0, -5]))
            await start_group(rig, {"1": position_setpoint(4), "2": far_path})
        rig.autopilots["1"].has_estimates = False
        await sleep(1.5)
        with pytest.raises(NotTogether, match="Vehicle 1: "):
            await start_group(rig, SETPOINTS_NORTH)
        rig.autopilots["1"].has_estimates = True
        rig.autopilots["3"].armed, rig.autopilots["3"].landed_state = False, ON_GROUND
        await sleep(2.5)
        with pytest.raises(NotTogether, match="Vehicle 3 is not flying"):
            await start_group(rig, SETPOINTS_NORTH)
        with pytest.raises(UnknownVehicle):
            await start_group(rig, {"1": position_setpoint(), "9": position_setpoint()})
        with pytest.raises(UnknownGroup, match="no group '7'"):
            await group_routes.show("7", rig.station)
        assert not any(mode_requests(autopilot, OFFBOARD_MODE) for autopilot in rig.autopilots.values())

    run_with_vehicles(run_simulated, scenario)


def test_a_vehicle_that_already_has_a_stream_or_a_group_is_refused_and_continues_its_flight(run_simulated):
    async def scenario(rig):
        single_start = StartRequest.model_validate({"setpoint": position_setpoint(1), "valid_for_s": 60})
        await offboard_routes.start("3", single_start, rig.station, ANNA)
        with pytest.raises(NotTogether, match="Vehicle 3 already has a setpoint stream"):
            await start_group(rig, SETPOINTS_NORTH)
        assert rig.vehicles["3"].offboard.status().state == "streaming"
        await start_group(rig, {"1": position_setpoint(4), "2": position_setpoint(4)})
        with pytest.raises(NotTogether, match="Vehicle 2 is already in group 1"):
            await start_group(rig, {"2": position_setpoint(4), "3": position_setpoint(4)})
        await sleep(1)
        assert set(autopilot_modes(rig).values()) == {OFFBOARD_MODE}

    run_with_vehicles(run_simulated, scenario)


def test_a_group_is_refused_if_another_client_has_control_of_a_member(run_simulated):
    async def scenario(rig):
        await command_routes.hold("2", rig.station, BOB)  # Hold needs no control, and takes no control
        rig.station.authority.control("2").lease.take(BOB)
        with pytest.raises(NotInControl, match="bob has control of vehicle 2, not you"):
            await start_group(rig, SETPOINTS_NORTH)
        assert not rig.station.authority.controlled_by(ANNA)
        assert not any(mode_requests(autopilot, OFFBOARD_MODE) for autopilot in rig.autopilots.values())
        assert journal_entries(rig.station)[-3:] == [
            ("anna", "group/start", v, "not_in_control") for v in "123"
        ]
        rig.station.authority.control("2").lease.release(BOB)
        await start_group(rig, SETPOINTS_NORTH)
        assert rig.station.authority.controlled_by(ANNA) == ["1", "2", "3"]
        with pytest.raises(NotInControl, match="anna has control of vehicle 1"):
            await group_routes.setpoints(
                "1", setpoints_request({"1": position_setpoint(5)}), rig.station, BOB
            )
        group = json_of(await group_routes.hold("1", rig.station, BOB))
        assert (group["state"], group["ended"]) == ("ended", "bob commanded Hold.")
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert journal_entries(rig.station)[-3:] == [("bob", "hold", v, "ok") for v in "321"]

    run_with_vehicles(run_simulated, scenario)


def test_vehicles_that_are_too_near_or_would_come_too_near_are_refused_with_their_distance(run_simulated):
    async def scenario(rig):
        with pytest.raises(NotTogether, match=r"Vehicles 1 and 2 are 10.0 m apart now") as refused:
            await start_group(rig, SETPOINTS_NORTH, minimum_separation_m=12)
        assert refused.value.distance_m == pytest.approx(10.0, abs=0.1)
        with pytest.raises(NotTogether, match=r"vehicles 1 and 2 would come within .* m of each other"):
            await start_group(rig, {"1": position_setpoint(0, 9), "2": position_setpoint(0, 0)})
        crossing_paths = {  # both vehicles arrive at the same point at the same time
            "1": path_setpoint((0, [0, 0, -5]), (10, [20, 10, -5])),
            "2": path_setpoint((0, [0, 0, -5]), (10, [20, 0, -5])),
        }
        with pytest.raises(NotTogether, match="vehicles 1 and 2 would come within") as refused:
            await start_group(rig, crossing_paths, minimum_separation_m=4)
        assert refused.value.vehicles == ("1", "2")
        assert not any(mode_requests(autopilot, OFFBOARD_MODE) for autopilot in rig.autopilots.values())
        await start_group(
            rig, {"1": path_setpoint((0, [0, 0, -5]), (10, [20, 0, -5])), "2": position_setpoint(20)}
        )

    run_with_vehicles(run_simulated, scenario)


def test_a_pilot_who_takes_over_a_member_before_the_common_start_prevents_all_motion(run_simulated):
    async def scenario(rig):
        starting = asyncio.ensure_future(
            group_routes.start(
                start_request(
                    SETPOINTS_NORTH, start_at_unix_s=rig.testbed.clock.unix_s() + 6.0, others_go_on=True
                ),
                rig.station,
                ANNA,
            )
        )
        await starting
        rig.autopilots["1"].mode = rig.autopilots["1"].requested_mode = POSITION_MODE
        rig.autopilots["1"].send_current_mode()
        await sleep(12)
        assert autopilot_modes(rig) == {"1": POSITION_MODE, "2": HOLD_MODE, "3": HOLD_MODE}
        assert_no_vehicle_moved(rig)

    run_with_vehicles(run_simulated, scenario)


def test_hold_before_the_common_start_prevents_all_motion(run_simulated):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH, start_at_unix_s=rig.testbed.clock.unix_s() + 6.0)
        await group_routes.hold("1", rig.station, ANNA)
        await sleep(8)
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert_no_vehicle_moved(rig)
        assert json_of(await group_routes.show("1", rig.station))["findings"] == []

    run_with_vehicles(run_simulated, scenario)


def test_a_setpoint_for_a_single_member_is_refused_and_the_group_continues(run_simulated):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH)
        await sleep(1)
        member = rig.vehicles["1"].offboard
        single_request = SetpointRequest.model_validate(
            {"setpoint": position_setpoint(0, 0, -6), "valid_for_s": 60}
        )
        with pytest.raises(Refused, match="Vehicle 1 is already in a group") as refused:
            await member.setpoint(single_request.to_stream_request(ANNA))
        assert "hold the group first" in refused.value.remedy
        assert member.status().owner == "group"
        await sleep(1)
        assert json_of(await group_routes.show("1", rig.station))["findings"] == []
        await group_routes.hold("1", rig.station, ANNA)
        assert member.status().owner is None
        await member.start(single_request.to_stream_request(ANNA))
        assert member.status().owner == "operator"

    run_with_vehicles(run_simulated, scenario)


def test_another_setpoint_for_a_member_before_the_start_prevents_all_motion(run_simulated):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH, start_at_unix_s=rig.testbed.clock.unix_s() + 6.0)
        other = SetpointRequest.model_validate({"setpoint": position_setpoint(0, 0, -6), "valid_for_s": 60})
        # Sent as the group's own setpoint: the server would refuse an operator's setpoint earlier.
        await rig.vehicles["1"].offboard.setpoint(replace(other.to_stream_request(ANNA), owner="group"))
        await sleep(12)
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert_no_vehicle_moved(rig)
        finding = json_of(await group_routes.show("1", rig.station))["findings"][0]
        assert "Vehicle 1 received another setpoint before the common start" in finding["text"]

    run_with_vehicles(run_simulated, scenario)
