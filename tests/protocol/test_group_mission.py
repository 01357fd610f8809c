"""A mission for several vehicles: the route that starts it, and simulated PX4 vehicles on simulated time."""

import functools
import json
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_server.api import command_routes, group_models, group_routes, offboard_mission_routes
from gcs_server.api import offboard_mission_models as models
from gcs_server.api import offboard_mission_routes as routes
from gcs_server.errors import InvalidRequest, NotInControl, PlanFindings, Refused
from gcs_server.plans.work import PlanWork
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from missions.offboard import document
from missions.offboard.reader import read
from tests.protocol import two_vehicles
from tests.protocol.api_calls import ANNA, BOB, journal_entries, json_of
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import until

APART_M = 20.0
MEET, LAND = "{step: meet, meeting: up}", "{step: land}"


def fly_step(north_m, east_m, up_m):
    return f"{{step: fly, points: [{{offset_ned_m: [{north_m}, {east_m}, {-up_m}]}}]}}"


def crossing_mission(lead_altitude_m=3, left_altitude_m=11):
    """A mission in which each vehicle flies to the other vehicle's start position, at these altitudes above
    the start."""
    return read(
        f"name: Show\nroles:\n  lead:\n    steps: {role_steps(lead_altitude_m, APART_M)}\n"
        f"  left:\n    steps: {role_steps(left_altitude_m, -APART_M)}\n"
    )


def role_steps(up_m, east_m):
    return f"[{{step: take_off, height_m: {up_m}}}, {MEET}, {fly_step(6, east_m, up_m)}, {LAND}]"


run_with_two_vehicles = functools.partial(two_vehicles.run_with_two_vehicles, apart_m=APART_M)


async def start(rig, mission, by=ANNA, **fields):
    mission_fields = json.loads(document.write(mission))
    request = {"mission": mission_fields, "vehicles": {"lead": "1", "left": "2"}, **fields}
    body = models.StartGroupMission.model_validate(request)
    return json_of(await offboard_mission_routes.start_group(body, rig.station, by))["vehicles"]


def states(rig):
    return [vehicle.offboard_mission.status().state for vehicle in rig.vehicles]


async def reach(rig, *expected, within_s=60):
    try:
        await until(lambda: states(rig) == list(expected), within_s)
    except AssertionError:
        raise AssertionError([v.offboard_mission.status() for v in rig.vehicles]) from None


async def start_crossing(rig, **altitudes):
    """Starts the mission; waits until both vehicles fly towards each other's start position."""
    views = await start(rig, crossing_mission(**altitudes), despite=["separation"])
    assert [view["mission"]["role"] for view in views] == ["lead", "left"]
    assert views[0]["mission"]["others"] == ["2"]
    await until(lambda: rig.vehicles[0].status.armed, 5)
    assert rig.vehicles[1].status.armed  # both vehicles arm at the same time
    await reach(rig, "flying", "flying")


@pytest.mark.story
def test_two_vehicles_cross_at_different_altitudes_and_each_lands_at_the_start_of_the_other(run_simulated):
    async def scenario(rig):
        await start(rig, crossing_mission())
        await reach(rig, "done", "done", within_s=120)
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)
        east_m = rig.testbed.sim.simulation.truth.position_ned_m[:, 1]
        assert east_m == pytest.approx([APART_M, 0.0], abs=4)
        (group,) = rig.station.flights.groups.all()
        assert (group.state, group.ended, group.findings) == ("ended", "The mission is done.", ())
        assert rig.station.flights.missions.others_on_mission("1") == ()

    run_with_two_vehicles(run_simulated, scenario)


def dry_run_of(rig, **start_east_m):
    """A Monte Carlo dry run for these roles, with a corridor of 1 m above each role's start position."""
    origin = asdict(VehicleEstimates(rig.vehicles[0]).origin())
    band = {name: [0.0, 0.0] for name in ("p5", "p50", "p95")} | {"greatest": [1.0, 1.0]}
    role_results = {
        role: {
            "corridor": {
                "position_ned_m": [[0.0, east_m, 0.0], [0.0, east_m, -15.0]],
                "horizontal_m": band,
                "vertical_m": band,
            }
        }
        for role, east_m in start_east_m.items()
    }
    group = {"monte_carlo": {"roles": role_results}}
    result = {"nominal": {"origin": origin}, "monte_carlo": role_results["lead"], "group": group}
    return {"id": "7", "kind": "offboard_mission", **result}


def set_dry_run(rig, **start_east_m):
    """Replaces the server's dry runs by this one."""

    async def result(_):
        return dry_run_of(rig, **start_east_m)

    rig.station.flights.dry_runs = SimpleNamespace(result=result)


def outside_corridor_m(rig):
    return [vehicle.offboard_mission.status().outside_corridor_m for vehicle in rig.vehicles]


@pytest.mark.story
def test_each_vehicle_is_monitored_in_the_corridor_of_its_role(run_simulated):
    async def scenario(rig):
        set_dry_run(rig, lead=0.0, left=APART_M)
        views = await start(rig, crossing_mission(), dry_run="7")
        assert [view["mission"]["dry_run"] for view in views] == ["7", "7"]
        await reach(rig, "flying", "flying")
        assert max(outside_corridor_m(rig)) < 3.0, "a vehicle is not above its own start"
        await until(lambda: min(outside_corridor_m(rig)) > 5.0, 20)

    run_with_two_vehicles(run_simulated, scenario)


def test_no_vehicle_starts_if_the_dry_run_has_no_corridor_of_a_role(run_simulated):
    async def scenario(rig):
        set_dry_run(rig, lead=0.0)
        with pytest.raises(Refused, match="has no corridor of the role 'left'"):
            await start(rig, crossing_mission(), dry_run="7")
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)
        assert rig.station.flights.missions.others_on_mission("1") == ()

    run_with_two_vehicles(run_simulated, scenario)


def test_two_vehicles_that_come_too_near_are_put_into_hold_by_the_guard_and_their_mission_ends(run_simulated):
    async def scenario(rig):
        await start_crossing(rig, lead_altitude_m=10, left_altitude_m=13)
        min_distance_m = APART_M
        truth = rig.testbed.sim.simulation.truth.position_ned_m
        while "flying" in states(rig):
            min_distance_m = min(min_distance_m, float(np.linalg.norm(truth[0] - truth[1])))
            await sleep(0.1)
        assert states(rig) == ["stopped", "stopped"]
        await until(lambda: all(v.status.mode == "hold" for v in rig.vehicles), 5)
        await sleep(5)
        min_distance_m = min(min_distance_m, float(np.linalg.norm(truth[0] - truth[1])))
        assert min_distance_m >= 5.0
        reasons = {vehicle.offboard_mission.status().reason for vehicle in rig.vehicles}
        assert len(reasons) == 1
        assert "m apart" in reasons.pop()

    run_with_two_vehicles(run_simulated, scenario)


def test_hold_of_one_vehicle_puts_the_other_into_hold_and_ends_the_mission(run_simulated):
    async def scenario(rig):
        await start_crossing(rig)
        await command_routes.hold("2", rig.station, BOB)
        await reach(rig, "stopped", "stopped", within_s=3)
        await sleep(3)
        assert [vehicle.status.mode for vehicle in rig.vehicles] == ["hold", "hold"]
        assert "left has left the mission" in rig.vehicles[0].offboard_mission.status().reason

    run_with_two_vehicles(run_simulated, scenario)


@pytest.mark.parametrize("stops", [command_routes.hold, command_routes.land, command_routes.disarm])
def test_a_command_for_one_vehicle_before_the_common_start_keeps_all_on_the_ground(run_simulated, stops):
    async def scenario(rig):
        await start(rig, crossing_mission(), despite=["separation"])
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)
        await stops("2", rig.station, ANNA)
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)
        await sleep(10)
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)
        assert states(rig) == ["stopped", "stopped"]
        assert "Vehicle 2 was given" in rig.vehicles[0].offboard_mission.status().reason

    run_with_two_vehicles(run_simulated, scenario)


def test_the_vehicles_of_a_mission_are_a_group_that_accepts_no_setpoints(run_simulated):
    async def scenario(rig):
        await start_crossing(rig)
        (group,) = json_of(await group_routes.show_all(rig.station))["groups"]
        assert (group["state"], group["mission"], group["client"]) == ("flying", "Show", ANNA.name)
        assert [(m["vehicle"], m["role"], m["ordered_type"]) for m in group["members"]] == [
            ("1", "lead", "mission"),
            ("2", "left", "mission"),
        ]
        assert group["nearest"]["distance_m"] == pytest.approx(APART_M, abs=6)
        renewal = group_models.GroupSetpoints(setpoints=())
        with pytest.raises(Refused, match="flies the mission 'Show': it accepts no setpoints"):
            await group_routes.setpoints(group["id"], renewal, rig.station, ANNA)
        assert states(rig) == ["flying", "flying"]

    run_with_two_vehicles(run_simulated, scenario)


@pytest.mark.parametrize("phase", ["taking_off", "flying"])
def test_hold_of_the_group_ends_the_mission_and_all_hold(run_simulated, phase):
    async def scenario(rig):
        await start(rig, crossing_mission(), despite=["separation"])
        await reach(rig, phase, phase)
        group = json_of(await group_routes.hold("1", rig.station, BOB))
        assert (group["state"], group["ended"]) == ("ended", f"{BOB.name} commanded Hold.")
        assert states(rig) == ["stopped", "stopped"]
        assert [vehicle.status.mode for vehicle in rig.vehicles] == ["hold", "hold"]
        await sleep(5)
        assert [vehicle.status.mode for vehicle in rig.vehicles] == ["hold", "hold"]
        assert rig.station.flights.groups.get("1").findings == ()

    run_with_two_vehicles(run_simulated, scenario)


@pytest.mark.story
def test_pause_resume_and_abort_act_on_all_vehicles_and_need_control_of_all(run_simulated):
    async def scenario(rig):
        await start_crossing(rig)
        await routes.pause("2", rig.station, ANNA)
        await reach(rig, "paused", "paused", within_s=10)
        rig.station.authority.control("1").lease.release(ANNA)
        rig.station.authority.control("1").lease.take(BOB)
        with pytest.raises(NotInControl):
            await routes.resume("2", rig.station, ANNA)
        rig.station.authority.control("1").lease.release(BOB)
        await routes.resume("2", rig.station, ANNA)
        await reach(rig, "flying", "flying", within_s=10)
        with pytest.raises(Refused, match="cannot be skipped"):
            await routes.skip("1", rig.station, ANNA)
        with pytest.raises(Refused, match="their paths home may cross"):
            await routes.abort("1", rig.station, ANNA, models.AbortMission(then="return"))
        await routes.abort("1", rig.station, ANNA, models.AbortMission(then="land"))
        assert states(rig) == ["aborted", "aborted"]
        await until(lambda: not any(vehicle.status.armed for vehicle in rig.vehicles), 40)
        commands = [
            (command, vehicle)
            for _, command, vehicle, result in journal_entries(rig.station)
            if result == "ok"
        ]
        assert (
            commands.count(("offboard_mission/abort", "1"))
            == commands.count(("offboard_mission/abort", "2"))
            == 1
        )

    run_with_two_vehicles(run_simulated, scenario)


def test_a_group_mission_with_an_error_in_plan_roles_vehicles_or_control_is_refused(run_simulated):
    async def scenario(rig):
        with pytest.raises(PlanFindings) as refused:
            await start(rig, crossing_mission(10, 12))
        assert refused.value.codes == ("separation",)
        with pytest.raises(InvalidRequest, match="role 'left' has no vehicle"):
            await start(rig, crossing_mission(), vehicles={"lead": "1", "right": "2"})
        with pytest.raises(InvalidRequest, match="no roles"):
            await start(rig, read(f"name: One\nsteps: [{LAND}]"))
        with pytest.raises(ValueError, match="named twice"):
            await start(rig, crossing_mission(), vehicles={"lead": "1", "left": "1"})
        rig.station.authority.control("2").lease.release(ANNA)
        rig.station.authority.control("2").lease.take(BOB)
        with pytest.raises(NotInControl):
            await start(rig, crossing_mission())
        rig.station.authority.control("2").lease.release(BOB)
        assert [vehicle.offboard_mission.status() for vehicle in rig.vehicles] == [None, None]
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)

    run_with_two_vehicles(run_simulated, scenario)


def test_a_vehicle_that_cannot_be_armed_keeps_all_on_the_ground(run_simulated):
    async def scenario(rig):
        rig.testbed.sim.simulation.set_battery_remaining(1, 0.02)
        await until(lambda: rig.vehicles[1].topic("health").value.ready_to_arm is False, 20)
        with pytest.raises(Refused, match="Vehicle 2 cannot be armed now, so none of the vehicles starts"):
            await start(rig, crossing_mission())
        await sleep(2)
        assert not any(vehicle.status.armed for vehicle in rig.vehicles)

    run_with_two_vehicles(run_simulated, scenario)


def test_a_vehicle_that_stayed_in_offboard_after_its_last_landing_starts_again(run_simulated):
    async def scenario(rig):
        await rig.vehicles[1].command.set_mode("offboard")
        await until(lambda: rig.vehicles[1].topic("health").value.ready_to_arm is False, 20)
        await start(rig, crossing_mission())
        await until(lambda: all(vehicle.status.armed for vehicle in rig.vehicles), 20)

    run_with_two_vehicles(run_simulated, scenario)


@pytest.mark.story
def test_a_mission_for_several_vehicles_cannot_be_started_on_one_vehicle(run_simulated):
    async def scenario(rig):
        body = models.StartMission.model_validate({"mission": json.loads(document.write(crossing_mission()))})
        rig.station.flights.plan_work = PlanWork(Path("no elevation"))
        with pytest.raises(InvalidRequest, match="it is for 2 vehicles"):
            await routes.start("1", body, rig.station, ANNA)
        assert rig.vehicles[0].offboard_mission.status() is None

    run_with_two_vehicles(run_simulated, scenario)
