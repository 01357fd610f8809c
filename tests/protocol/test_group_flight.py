"""Vehicles in flight as a group: setpoints for several vehicles, the minimum distance, Hold for all."""

import asyncio
import itertools
import math
import random
from dataclasses import replace
from types import SimpleNamespace

import pytest

from gcs_server.api import group_routes
from gcs_server.api.setpoints import SetpointRequest
from gcs_server.errors import InvalidRequest, NotTogether, Refused
from tests.protocol.api_calls import json_of, new_station
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.group_testbed import (
    ANNA,
    METRES_PER_DEGREE,
    SETPOINTS_NORTH,
    STREAM_PERIOD_S,
    autopilot_modes,
    first_setpoint_s,
    group_changes,
    path_setpoint,
    position_setpoint,
    run_with_vehicles,
    setpoints_request,
    start_group,
    velocity_setpoint,
)
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until


def test_setpoints_of_several_vehicles_change_together_and_expire_together(run_simulated):
    async def scenario(rig):
        await start_group(
            rig,
            {
                "1": position_setpoint(4),
                "2": path_setpoint((0, [0, 0, -5]), (6, [6, 0, -5])),
                "3": position_setpoint(4),
            },
        )
        await sleep(1)
        new_setpoints = setpoints_request(
            {"1": position_setpoint(7), "3": position_setpoint(7)}, valid_for_s=2.0
        )
        group = json_of(await group_routes.setpoints("1", new_setpoints, rig.station, ANNA))
        assert (group["client"], group["client_key"]) == ("anna", ANNA.key)
        assert group["valid_left_s"] == pytest.approx(2.0 + 5.5, abs=0.2)  # the path continues to its end
        await sleep(0.1)
        start_times_s = [first_setpoint_s(rig.autopilots[v], 7.0) for v in "13"]
        assert max(start_times_s) - min(start_times_s) < STREAM_PERIOD_S
        with pytest.raises(NotTogether, match="would come within"):
            too_near = setpoints_request({"1": position_setpoint(0, 8)})
            await group_routes.setpoints("1", too_near, rig.station, ANNA)
        with pytest.raises(InvalidRequest, match="vehicle 9 is not in group 1"):
            await group_routes.setpoints(
                "1", setpoints_request({"9": position_setpoint()}), rig.station, ANNA
            )
        await sleep(6.0)
        assert json_of(await group_routes.show("1", rig.station))["state"] == "flying"
        await sleep(8.5)
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        ended_group = json_of(await group_routes.show("1", rig.station))
        assert (ended_group["ended"], ended_group["findings"]) == ("The setpoints expired.", [])
        with pytest.raises(Refused, match="is ended: it accepts no setpoints"):
            await group_routes.setpoints("1", new_setpoints, rig.station, ANNA)

    run_with_vehicles(run_simulated, scenario)


def test_a_request_without_setpoints_renews_the_setpoints_of_all_members(run_simulated):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH, valid_for_s=3.0)
        for _ in range(3):
            await sleep(2)
            group = json_of(
                await group_routes.setpoints("1", setpoints_request({}, valid_for_s=3.0), rig.station, ANNA)
            )
            assert group["valid_left_s"] == pytest.approx(3.0, abs=0.1)
        assert json_of(await group_routes.show("1", rig.station))["state"] == "flying"
        await sleep(12.0)
        ended_group = json_of(await group_routes.show("1", rig.station))
        assert (ended_group["ended"], ended_group["findings"]) == ("The setpoints expired.", [])

    run_with_vehicles(run_simulated, scenario)


@pytest.mark.parametrize("others_go_on", [False, True])
def test_a_member_that_leaves_offboard_puts_the_others_into_hold_unless_others_go_on(
    run_simulated, others_go_on
):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH, others_go_on=others_go_on)
        await sleep(1)
        rig.autopilots["2"].mode = rig.autopilots["2"].requested_mode = POSITION_MODE  # by its pilot
        rig.autopilots["2"].send_current_mode()
        await sleep(7.5)  # after a mode request the server tolerates another mode
        others_mode = OFFBOARD_MODE if others_go_on else HOLD_MODE
        assert autopilot_modes(rig) == {"1": others_mode, "2": POSITION_MODE, "3": others_mode}
        group = json_of(await group_routes.show("1", rig.station))
        assert group["state"] == ("flying" if others_go_on else "ended")
        finding = group["findings"][0]
        assert (finding["code"], finding["vehicles"]) == ("left", ["2"])
        assert finding["held"] == ([] if others_go_on else ["1", "3"]), (
            "vehicle 2 was put into Hold although its pilot flies it"
        )
        assert (
            "Vehicle 2 no longer follows the group's setpoints: The vehicle left Offboard" in finding["text"]
        )
        assert [text for text, _, warning in group_changes(rig) if warning]
        if others_go_on:
            with pytest.raises(Refused, match="Vehicle 2 is held and no longer follows group 1"):
                await group_routes.setpoints(
                    "1", setpoints_request({"2": position_setpoint(5)}), rig.station, ANNA
                )

    run_with_vehicles(run_simulated, scenario)


def test_a_lost_member_puts_the_others_into_hold_within_two_seconds(run_simulated):
    async def scenario(rig):
        await start_group(
            rig, {"1": velocity_setpoint(1), "2": velocity_setpoint(1), "3": velocity_setpoint(1)}
        )
        await sleep(2)
        rig.autopilots["3"].alive = False
        await sleep(2.0)
        group = json_of(await group_routes.show("1", rig.station))
        assert group["findings"][0]["code"] == "place_unknown"
        assert "The position of vehicle 3 is not known" in group["findings"][0]["text"]
        last_setpoints = {v: rig.autopilots[v].setpoints[-1][1] for v in "12"}
        # Position setpoints: the vehicles stop.
        assert all(m.type_mask & 7 == 0 for m in last_setpoints.values())
        await sleep(8)
        assert (rig.autopilots["1"].mode, rig.autopilots["2"].mode) == (HOLD_MODE, HOLD_MODE)

    run_with_vehicles(run_simulated, scenario)


def test_a_member_can_follow_another_member_of_the_group(run_simulated):
    async def scenario(rig):
        follow_10_m_east = {"type": "follow", "vehicle": "1", "offset_ned_m": [0, 10, 0]}
        await start_group(rig, {"1": position_setpoint(4), "2": follow_10_m_east})
        await sleep(2)
        group = json_of(await group_routes.show("1", rig.station))
        assert [m["ordered_type"] for m in group["members"]] == ["position", "follow"]
        assert group["state"] == "flying"
        last_setpoint = rig.autopilots["2"].setpoints[-1][1]
        assert (last_setpoint.x, last_setpoint.y) == (pytest.approx(0, abs=0.2), pytest.approx(0, abs=0.2))
        follow_3_m_east = {"type": "follow", "vehicle": "1", "offset_ned_m": [0, 3, 0]}
        with pytest.raises(NotTogether, match="would come within"):
            await group_routes.setpoints("1", setpoints_request({"2": follow_3_m_east}), rig.station, ANNA)

    run_with_vehicles(run_simulated, scenario, count=2)


def test_a_server_shutdown_puts_a_group_into_hold_without_findings(run_simulated):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH)
        await sleep(1)
        stopped = await rig.station.flights.stop_streams()
        assert [s.error for s in stopped] == [None] * 3
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        await sleep(0.3)
        group = json_of(await group_routes.show("1", rig.station))
        assert (group["ended"], group["findings"]) == ("The server was shut down.", [])

    run_with_vehicles(run_simulated, scenario)


# Seed 0 is not used: it loses the first three heartbeats of vehicle 1, one per second. After 3.5 s without a
# heartbeat the server regards a vehicle as lost, and no vehicle of the group moves.
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_group_starts_gets_new_setpoints_and_is_put_into_hold_at_20_percent_loss(run_simulated, seed):
    async def scenario(rig):
        for index, autopilot in enumerate(rig.autopilots.values()):
            autopilot.loss, autopilot.random = 0.2, random.Random(seed * 10 + index)
        await start_group(rig, SETPOINTS_NORTH)
        await sleep(2)
        start_times_s = [next(t for t, m in a.setpoints if m.x > 1) for a in rig.autopilots.values()]
        # The first setpoints may have been lost.
        assert max(start_times_s) - min(start_times_s) < 10 * STREAM_PERIOD_S
        await group_routes.setpoints("1", setpoints_request({"1": position_setpoint(6)}), rig.station, ANNA)
        group = json_of(await group_routes.hold("1", rig.station, ANNA))
        assert (group["state"], group["findings"]) == ("ended", [])
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert sum(autopilot.failsafe_count for autopilot in rig.autopilots.values()) == 0

    run_with_vehicles(run_simulated, scenario)


@pytest.mark.parametrize(("stall_s", "code"), [(0.4, None), (1.2, "place_unknown")])
def test_the_guard_puts_all_into_hold_if_the_event_loop_stalls_for_more_than_a_second(
    run_simulated, stall_s, code
):
    async def scenario(rig):
        await start_group(
            rig, {"1": velocity_setpoint(1), "2": velocity_setpoint(1), "3": velocity_setpoint(1)}
        )
        await sleep(8)
        streamer = rig.testbed.streamer
        streamer.update_once = lambda: None
        await sleep(stall_s)
        del streamer.update_once
        await sleep(3)
        findings = json_of(await group_routes.show("1", rig.station))["findings"]
        assert [finding["code"] for finding in findings] == ([] if code is None else [code])
        assert set(autopilot_modes(rig).values()) == ({OFFBOARD_MODE} if code is None else {HOLD_MODE})

    run_with_vehicles(run_simulated, scenario)


def test_the_group_of_a_killed_client_is_in_hold_after_its_setpoints_expire(run_simulated):
    async def scenario(rig):
        await start_group(rig, {"1": velocity_setpoint(1), "2": velocity_setpoint(1)}, valid_for_s=1.0)
        await sleep(9)
        assert (rig.autopilots["1"].mode, rig.autopilots["2"].mode) == (HOLD_MODE, HOLD_MODE)
        assert json_of(await group_routes.show("1", rig.station))["ended"] == "The setpoints expired."

    run_with_vehicles(run_simulated, scenario)


# --- simulated PX4s -------------------------------------------------------------------------------


def position_ned_m(vehicle):
    """Position relative to latitude 0 and longitude 0 at sea level."""
    global_position = vehicle.topic("global_position").value
    return (
        global_position.lat_deg * METRES_PER_DEGREE,
        global_position.lon_deg * METRES_PER_DEGREE * math.cos(math.radians(global_position.lat_deg)),
        -global_position.alt_amsl_m,
    )


def smallest_distance_m(vehicles):
    return min(
        math.dist(position_ned_m(a), position_ned_m(b)) for a, b in itertools.combinations(vehicles, 2)
    )


def run_with_simulated_vehicles(run_simulated, scenario, count=2):
    async def run():
        testbed = SimulatedTestbed(count)
        try:
            ids = [str(i + 1) for i in range(count)]
            async with asyncio.TaskGroup() as tasks:
                take_offs = [tasks.create_task(testbed.take_off(v, 8.0)) for v in ids]
            await scenario(
                SimpleNamespace(testbed=testbed, station=new_station(testbed)),
                [f.result() for f in take_offs],
            )
        finally:
            await testbed.close()

    run_simulated(run)


@pytest.mark.story
def test_the_guard_puts_simulated_vehicles_into_hold_before_they_reach_the_minimum_distance(run_simulated):
    async def scenario(rig, vehicles):
        await start_group(
            rig,
            {"1": position_setpoint(0, -10, -8), "2": position_setpoint(0, 10, -8)},
            minimum_separation_m=1,
        )
        await until(lambda: smallest_distance_m(vehicles) > 22, 30)
        group = json_of(await group_routes.hold("1", rig.station, ANNA))
        assert (group["state"], group["findings"]) == ("ended", [])
        assert {v.status.mode for v in vehicles} == {"hold"}

        stay_setpoint = {"type": "position_body", "offset_frd_m": [0, 0, 0]}
        await start_group(rig, {"1": stay_setpoint, "2": stay_setpoint}, minimum_separation_m=5)
        await sleep(1)
        for vehicle, east_m_s in zip(vehicles, (5.0, -5.0), strict=True):
            # Sent as the group's own setpoints, without the prediction: only the guard detects the approach.
            request = SetpointRequest.model_validate(
                {"setpoint": velocity_setpoint(0, east_m_s), "valid_for_s": 60}
            )
            await vehicle.offboard.setpoint(replace(request.to_stream_request(ANNA), owner="group"))
        nearest_m, fastest_m_s = math.inf, 0.0
        for _ in range(120):
            await sleep(0.1)
            nearest_m = min(nearest_m, smallest_distance_m(vehicles))
            speeds_m_s = [math.hypot(*v.topic("local_position").value.velocity_ned_m_s) for v in vehicles]
            fastest_m_s = max(fastest_m_s, *speeds_m_s)
            if {v.status.mode for v in vehicles} == {"hold"} and max(speeds_m_s) < 0.2:
                break
        assert {v.status.mode for v in vehicles} == {"hold"}
        assert fastest_m_s > 2.0
        assert 5.0 < nearest_m < 15.0
        finding = json_of(await group_routes.show("2", rig.station))["findings"][0]
        assert (finding["code"], finding["vehicles"]) == ("separation", ["1", "2"])
        assert finding["held"] == ["1", "2"]
        assert finding["distance_m"] > nearest_m
        warnings = [event.text for event in vehicles[0].events.since() if event.kind == "warning"]
        assert any("Vehicles 1 and 2 are" in text and "requesting Hold mode" in text for text in warnings)

    run_with_simulated_vehicles(run_simulated, scenario)
