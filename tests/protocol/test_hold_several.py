"""Hold for several vehicles in one request: sent to all at once; a failure does not affect the others."""

import pytest

from gcs_server.api import hold_routes
from tests.protocol.api_calls import journal_entries, json_of
from tests.protocol.command_numbers import DO_SET_MODE
from tests.protocol.fake_autopilot import HOLD_MODE, MANUAL_MODE
from tests.protocol.group_testbed import (
    ANNA,
    BOB,
    SETPOINTS_NORTH,
    autopilot_modes,
    run_with_vehicles,
    start_group,
)
from tests.protocol.offboard_testbed import mode_requests, sleep


async def hold(rig, vehicles, client=BOB):
    body = hold_routes.HoldRequest(vehicles=vehicles)
    return json_of(await hold_routes.hold_several(body, rig.station, client))["results"]


def test_a_client_without_control_puts_all_vehicles_into_hold_at_once_and_their_streams_end(run_simulated):
    async def scenario(rig):
        await start_group(rig, SETPOINTS_NORTH, ANNA)
        began_s = rig.testbed.clock.monotonic_s()
        results = await hold(rig, ("3", "1", "2", "1"))
        assert [(r["vehicle"], r["held"], r["problem"]) for r in results] == [
            (v, True, None) for v in ("3", "1", "2")
        ]
        # All confirmations take one heartbeat interval together, not one for each vehicle.
        assert rig.testbed.clock.monotonic_s() - began_s < 1.5
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert [len(mode_requests(autopilot, HOLD_MODE)) for autopilot in rig.autopilots.values()] == [
            1,
            1,
            1,
        ]
        assert sorted(journal_entries(rig.station)[-3:]) == [("bob", "hold", v, "ok") for v in "123"]
        await sleep(0.5)
        setpoint_counts = {v: len(autopilot.setpoints) for v, autopilot in rig.autopilots.items()}
        await sleep(2)
        assert {v: len(autopilot.setpoints) for v, autopilot in rig.autopilots.items()} == setpoint_counts

    run_with_vehicles(run_simulated, scenario)


def test_a_vehicle_that_does_not_reply_or_is_unknown_does_not_prevent_hold_of_the_others(run_simulated):
    async def scenario(rig):
        for autopilot in rig.autopilots.values():
            autopilot.mode = MANUAL_MODE
        rig.autopilots["2"].silent_commands.add(DO_SET_MODE)
        await sleep(2)
        results = {r["vehicle"]: r for r in await hold(rig, ("9", "2", "1", "3"))}
        assert {v: r["held"] for v, r in results.items()} == {"9": False, "2": False, "1": True, "3": True}
        assert results["9"]["problem"]["code"] == "unknown_vehicle"
        assert (results["2"]["problem"]["code"], results["2"]["problem"]["status"]) == ("no_reply", 504)
        assert autopilot_modes(rig) == {"1": HOLD_MODE, "2": MANUAL_MODE, "3": HOLD_MODE}

    run_with_vehicles(run_simulated, scenario)


def test_a_request_without_vehicle_ids_puts_all_armed_vehicles_into_hold(run_simulated):
    async def scenario(rig):
        rig.autopilots["1"].armed = False
        await sleep(2)
        assert [r["vehicle"] for r in await hold(rig, None)] == ["2", "3"]
        assert mode_requests(rig.autopilots["1"], HOLD_MODE) == []

    run_with_vehicles(run_simulated, scenario)


def test_an_error_for_one_vehicle_is_raised_after_the_others_are_in_hold(run_simulated):
    async def scenario(rig):
        for autopilot in rig.autopilots.values():
            autopilot.mode = MANUAL_MODE
        await sleep(2)

        async def failing_hold(**_):
            raise RuntimeError("broken")

        rig.vehicles["1"].command.hold = failing_hold
        with pytest.raises(RuntimeError, match="broken"):
            await hold(rig, ("1", "2", "3"))
        assert autopilot_modes(rig) == {"1": MANUAL_MODE, "2": HOLD_MODE, "3": HOLD_MODE}

    run_with_vehicles(run_simulated, scenario)
