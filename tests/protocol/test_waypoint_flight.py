"""The server monitors the flight of a waypoint plan: progress, corridor, comparison with the dry run."""

import json
from types import SimpleNamespace

import pytest

from gcs_server.api import dry_run_models, dry_run_routes, mission_models, mission_routes
from gcs_server.errors import Refused, Rejected, UnknownDryRun
from gcs_server.flights.waypoint_flights import LINK_LOSS_PARAMETERS as PARAMETERS
from gcs_server.plans import dry_run_worker, dry_runs
from gcs_server.storage.cache import Cache
from gcs_server.vehicle.services.items_cache import ItemsCache
from tests.protocol.api_calls import ANNA, MISSION_MODE, json_of, new_station
from tests.protocol.command_numbers import (
    ARM_DISARM,
    DO_PAUSE_CONTINUE,
    DO_REPOSITION,
    DO_SET_MODE,
    MISSION_START,
)
from tests.protocol.fake_autopilot import IN_AIR, INT32, POSITION_MODE, REAL32
from tests.protocol.mission_autopilot import MissionAutopilot, UploadingStation
from tests.protocol.offboard_testbed import OffboardTestbed, sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until

LAT, LON = 47.397742, 8.545594
DEG_PER_M = 1 / 111_195
"""Degrees of latitude per metre."""


def item(kind, north_m, alt_m, **fields):
    altitude = {"value_m": alt_m, "reference": "home"}
    return {
        "kind": kind,
        "lat_deg": LAT + north_m * DEG_PER_M,
        "lon_deg": LON,
        "altitude": altitude,
        **fields,
    }


PLAN = {"items": [item("takeoff", 0, 6), item("waypoint", 35, 6), item("land", 35, 0)]}
MISSION_MESSAGES = {37, 38, 39, 40, 41, 43, 44, 45, 47, 51, 73}
"""Messages of plan transfers, and of the current item."""
FLIGHT_MESSAGES = {11, 69, 75, 82, 84, 86}
"""SET_MODE, MANUAL_CONTROL, COMMAND_INT, and setpoints."""
FLIGHT_COMMANDS = {DO_SET_MODE, DO_REPOSITION, DO_PAUSE_CONTINUE, MISSION_START, ARM_DISARM}
WIND_M_S = (0.0, 16.0, 0.0)


async def simulate_in_process(_command, report, *, request, max_body_bytes):
    """Runs a dry run in this process; replaces the separate process."""
    return dry_run_worker.fly(json.loads(request), report)


async def run_dry_run(rig, **fields):
    """Runs a dry run of the plan; returns its id."""
    body = dry_run_models.DryRunRequest.model_validate({"plan": PLAN, "vehicle": "1", **fields})
    operation = json_of(await dry_run_routes.start_dry_run(body, rig.station, ANNA))
    return (await rig.station.operations.wait(operation["id"])).result["dry_run"]


async def upload(rig, plan=PLAN):
    body = mission_models.UploadRequest.model_validate({"plan": plan, "wait": True})
    await mission_routes.upload("1", body, rig.station, ANNA)
    await sleep(1.5)


async def start(rig, **fields):
    body = mission_models.StartRequest.model_validate({"item": 0, **fields})
    await mission_routes.start("1", rig.station, ANNA, body)


async def flight_view(rig):
    response = json_of(await mission_routes.show_mission(rig.vehicle, rig.station))
    mission_models.MissionView.model_validate(response)
    return response["flight"]


def event_codes(rig):
    data = [event.data or {} for event in rig.vehicle.events.since()]
    return [fields["code"] for fields in data if fields.get("source") == "waypoint_flight"]


def run_with_simulated_vehicle(run_simulated, monkeypatch, scenario):
    monkeypatch.setattr(dry_runs, "run_process", simulate_in_process)

    async def run():
        testbed = SimulatedTestbed()
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            station = new_station(testbed)
            station.flights.waypoint_flights.start()
            await scenario(SimpleNamespace(testbed=testbed, vehicle=vehicle, station=station))
        finally:
            await testbed.close()

    run_simulated(run)


@pytest.mark.story
def test_a_flight_is_monitored_in_the_corridor_of_its_dry_run_and_compared_with_it(
    run_simulated, monkeypatch
):
    async def scenario(rig):
        assert await flight_view(rig) is None
        dry_run = await run_dry_run(rig, flights=3)
        with pytest.raises(Refused, match="not made for the plan"):
            await start(rig, dry_run=dry_run, despite=["plan_not_known"])
        await upload(rig)
        await start(rig, dry_run=dry_run)
        start_view = await flight_view(rig)
        assert (start_view["state"], start_view["client"], start_view["dry_run"]) == (
            "flying",
            "anna",
            dry_run,
        )
        assert (start_view["item"], start_view["count"], start_view["planned_by"]) == (0, 3, "dry_run")
        assert start_view["remaining_s"] == pytest.approx(start_view["duration_s"], abs=4)

        await until(lambda: rig.vehicle.topic("mission").value.current == 1, 30)
        await sleep(3)
        leg_view = await flight_view(rig)
        assert (leg_view["place"], leg_view["title"]) == ("item 2", "Waypoint")
        assert leg_view["deviation_horizontal_m"] < 1.5
        assert abs(leg_view["deviation_vertical_m"]) < 1.5
        assert leg_view["outside_corridor_m"] == 0
        assert leg_view["remaining_s"] < start_view["remaining_s"] - 5

        rig.testbed.sim.simulation.set_wind(WIND_M_S)
        await until(lambda: "corridor_left" in event_codes(rig), 8)
        outside_view = await flight_view(rig)
        assert outside_view["outside_corridor_m"] > 0
        assert outside_view["deviation_horizontal_m"] > outside_view["outside_corridor_m"]
        assert rig.vehicle.status.mode == "mission", (
            "the vehicle left Mission mode: outside the corridor the server must only warn"
        )
        rig.testbed.sim.simulation.set_wind((0.0, 0.0, 0.0))
        await until(lambda: "corridor_back" in event_codes(rig), 12)

        await until(lambda: not rig.vehicle.status.armed, 60)
        await sleep(0.3)
        end_view = await flight_view(rig)
        assert (end_view["state"], end_view["reason"], end_view["remaining_s"]) == ("done", None, None)
        response = json_of(await mission_routes.show_flown(rig.vehicle, rig.station))
        mission_routes.FlownMissionView.model_validate(response)
        flown = response["flown"]
        assert (flown["over"], flown["planned_by"]) == (True, "dry_run")
        assert flown["planned_duration_s"] == start_view["duration_s"]
        assert flown["duration_s"] == pytest.approx(flown["planned_duration_s"], abs=4)
        assert flown["planned_length_m"] == pytest.approx(6 + 35 + 6, abs=4)
        assert [leg["place"] for leg in flown["planned_legs"]] == ["item 1", "item 2", "item 3"]
        assert flown["deviation_max_m"] > outside_view["outside_corridor_m"]
        assert {sample["place"] for sample in flown["samples"]} == {"item 1", "item 2", "item 3"}
        await sleep(2)
        assert json_of(await mission_routes.show_flown(rig.vehicle, rig.station)) == response, (
            "the flown mission changed after the flight"
        )

    run_with_simulated_vehicle(run_simulated, monkeypatch, scenario)


def run_with_scripted_vehicle(run_simulated, scenario):
    """Runs a test with a scripted vehicle, which has the simulator's mission service and no position."""

    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilot = link.autopilots["peer"] = MissionAutopilot(link)
        rig = SimpleNamespace(testbed=testbed, autopilot=autopilot)
        try:
            rig.vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            rig.station = new_station(testbed)
            rig.station.flights.waypoint_flights.start()
            await scenario(rig)
        finally:
            autopilot.alive = False
            await rig.testbed.close()

    run_simulated(run)


def fly_in_mode(rig, mode):
    """The pilot arms the vehicle, and it flies in this mode."""
    rig.autopilot.armed, rig.autopilot.mode, rig.autopilot.landed_state = True, mode, IN_AIR


def test_a_flight_that_the_pilot_selects_is_monitored_until_the_vehicle_gets_another_plan(run_simulated):
    async def scenario(rig):
        await upload(rig)
        fly_in_mode(rig, MISSION_MODE)
        await sleep(2.5)
        flight = await flight_view(rig)
        assert (flight["state"], flight["client"], flight["dry_run"]) == ("flying", None, None)
        assert (flight["planned_by"], flight["place"], flight["count"]) == ("plan", "item 1", 3)
        assert flight["not_compared"] == "The vehicle has no valid position estimate."
        fly_in_mode(rig, POSITION_MODE)
        await sleep(2.5)
        flight = await flight_view(rig)
        assert flight["state"] == "paused"
        assert flight["reason"].startswith("The vehicle has left Mission mode: ")
        fly_in_mode(rig, MISSION_MODE)
        await sleep(2.5)
        assert (await flight_view(rig))["state"] == "flying"
        assert event_codes(rig) == ["monitoring_paused", "monitoring_resumed"]
        items = rig.vehicle.mission.items_on_vehicle.items["mission"]
        await UploadingStation(rig.autopilot).upload(items[:2])
        await sleep(2.5)
        end_view = await flight_view(rig)
        assert (end_view["state"], end_view["reason"]) == ("stopped", "The vehicle has another plan now.")
        flown = json_of(await mission_routes.show_flown(rig.vehicle, rig.station))["flown"]
        assert (flown["over"], flown["planned_by"], flown["deviation_max_m"]) == (True, "plan", None)

    run_with_scripted_vehicle(run_simulated, scenario)


def test_a_flight_that_began_before_the_server_knew_the_plan_is_monitored_from_the_current_item(
    run_simulated,
):
    async def scenario(rig):
        await upload(rig)
        fly_in_mode(rig, MISSION_MODE)
        await sleep(2.5)
        rig.station.flights.waypoint_flights.detach(rig.vehicle)  # as after a restart of the server
        rig.station.flights.waypoint_flights.attach(rig.vehicle)
        await sleep(1)
        flight = await flight_view(rig)
        assert (flight["state"], flight["planned_by"], flight["place"]) == ("flying", "plan", "item 1")
        assert flight["not_compared"] == "The vehicle has no valid position estimate."
        rig.autopilot.armed = False
        await sleep(2.5)
        assert (await flight_view(rig))["state"] == "stopped"

    run_with_scripted_vehicle(run_simulated, scenario)


async def run_inline(function):
    """Replaces `asyncio.to_thread`."""
    return function()


@pytest.mark.parametrize("damage", [None, "cut off", "of another plan"])
def test_a_restarted_server_knows_the_flown_plan_by_its_ids_and_sends_no_command(
    run_simulated, tmp_path, damage
):
    cache = ItemsCache(Cache(tmp_path), run_inline)

    async def restart(rig):
        await rig.testbed.close()
        rig.testbed = OffboardTestbed()
        rig.autopilot.link = rig.link = rig.testbed.link()
        rig.link.autopilots["peer"] = rig.autopilot
        rig.testbed.fleet.on_vehicle_added(lambda vehicle: vehicle.mission.set_cache(cache))
        rig.vehicle = await rig.testbed.wait_for_vehicle()
        rig.station = new_station(rig.testbed)
        rig.station.flights.waypoint_flights.start()
        rig.autopilot.received_messages.clear()
        await sleep(4)

    async def scenario(rig):
        rig.vehicle.mission.set_cache(cache)
        await upload(rig)
        before = rig.vehicle.mission.items_on_vehicle
        fly_in_mode(rig, MISSION_MODE)
        rig.autopilot.flight.current = 1
        await sleep(2.5)
        (cache_file,) = tmp_path.iterdir()
        content = cache_file.read_bytes()
        if damage is not None:
            cache_file.write_bytes(
                content[:-20] if damage == "cut off" else content.replace(b'"fence": 0', b'"fence": 7')
            )
        await restart(rig)
        flight = await flight_view(rig)
        sent = {data[7] | data[8] << 8 | data[9] << 16 for data, _ in rig.link.sent_packets}
        assert not sent & (MISSION_MESSAGES | FLIGHT_MESSAGES)
        assert (
            not {
                message.command for message in rig.autopilot.received_messages if hasattr(message, "command")
            }
            & FLIGHT_COMMANDS
        )
        if damage is not None:
            assert (flight, rig.vehicle.mission.plan_on_vehicle(), cache_file.exists()) == (
                None,
                "not_known",
                False,
            )
            return
        after = rig.vehicle.mission.items_on_vehicle
        assert rig.vehicle.mission.plan_on_vehicle() == "plan"
        assert (after.ids, after.plan, after.at_unix_s) == (before.ids, before.plan, before.at_unix_s)
        assert repr(after.items) == repr(before.items)
        assert (flight["state"], flight["item"], flight["count"], flight["client"]) == ("flying", 1, 3, None)
        await UploadingStation(rig.autopilot).upload(before.items["mission"][:2])
        await sleep(2.5)
        assert (await flight_view(rig))["reason"] == "The vehicle has another plan now."

    run_with_scripted_vehicle(run_simulated, scenario)


def test_before_the_start_the_server_states_what_px4_does_without_a_ground_station(run_simulated):
    async def announced_action(rig):
        response = json_of(await mission_routes.show_mission(rig.vehicle, rig.station))
        await sleep(2)
        return response["if_link_lost"]

    async def scenario(rig):
        rig.autopilot.params |= {
            "COM_DL_LOSS_T": (INT32, 12),
            "COM_DLL_EXCEPT": (INT32, 0),
            "COM_FAIL_ACT_T": (REAL32, 0),
        }
        assert await announced_action(rig) is None
        assert await announced_action(rig) is None, "the parameters were read without a plan on the vehicle"
        await upload(rig)
        await announced_action(rig)
        rtl_text = "After about 12 s without any ground station, the vehicle returns (RTL) (NAV_DLL_ACT 2)."
        assert await announced_action(rig) == rtl_text
        rig.autopilot.params["NAV_DLL_ACT"] = (INT32, 0)
        await sleep(7)
        assert await announced_action(rig) == rtl_text, (
            "the text changed before the parameters were read again"
        )
        assert await announced_action(rig) == "The vehicle continues the mission (NAV_DLL_ACT 0)."
        read_parameters = [
            message.param_id
            for message in rig.autopilot.received_messages
            if message.get_type() == "PARAM_REQUEST_READ"
        ]
        assert read_parameters == [*PARAMETERS, *PARAMETERS]

    run_with_scripted_vehicle(run_simulated, scenario)


def test_a_refused_start_begins_no_flight_and_an_unknown_plan_has_no_flight(run_simulated):
    async def scenario(rig):
        with pytest.raises(Refused, match="has not flown a plan that the server knows"):
            await mission_routes.show_flown(rig.vehicle, rig.station)
        await upload(rig)
        rig.autopilot.arm_denied = True
        with pytest.raises(Rejected):
            await start(rig)
        await sleep(1)
        assert await flight_view(rig) is None
        rig.autopilot.arm_denied = False
        with pytest.raises(UnknownDryRun):
            await start(rig, dry_run="7")
        assert not rig.autopilot.armed
        await start(rig)
        assert ((await flight_view(rig))["client"], event_codes(rig)) == ("anna", [])

    run_with_scripted_vehicle(run_simulated, scenario)


def store_dry_run(rig, plan=PLAN, north_m=0.0):
    """Stores the result of a dry run that began this far north of the vehicle's home; returns its id."""
    origin = {"lat_deg": LAT + north_m * DEG_PER_M, "lon_deg": LON, "alt_amsl_m": 489.0}
    steps = [
        {"place": f"item {n}", "title": "Item", "row": n - 1, "start_s": 4.0 * (n - 1), "end_s": 4.0 * n}
        for n in (1, 2, 3)
    ]
    path = {
        "t_s": [0.0, 4.0, 8.0, 12.0],
        "position_ned_m": [[0, 0, 0], [0, 0, -6], [35, 0, -6], [35, 0, 0]],
        "q_ned_frd": [[1, 0, 0, 0]] * 4,
        "gimbal_rad": [[0, 0]] * 4,
    }
    nominal = {"origin": origin, "finished": True, "duration_s": 12.0, "path": path, "steps": steps}
    result = {"id": "1", "kind": "waypoint_plan", "nominal": nominal, "monte_carlo": None, "group": None}
    rig.station.flights.dry_runs._store("1", json.dumps(result).encode(), json.dumps(plan).encode())
    return "1"


def test_a_start_in_flight_continues_the_flight_unless_it_names_a_dry_run(run_simulated):
    async def scenario(rig):
        await upload(rig)
        fly_in_mode(rig, MISSION_MODE)
        await sleep(2.5)
        first = await flight_view(rig)
        await start(rig, item=1)
        assert (await flight_view(rig))["started_unix_s"] == first["started_unix_s"]
        await start(rig, item=1, dry_run=store_dry_run(rig))
        second = await flight_view(rig)
        assert second["started_unix_s"] > first["started_unix_s"]
        assert (second["client"], second["dry_run"], second["duration_s"]) == ("anna", "1", 12.0)
        assert second["remaining_s"] == 8.0, "the remaining time does not begin at the start of the item"
        for changes in ({"north_m": 6.0}, {"plan": {"items": PLAN["items"][:2]}}):
            with pytest.raises(Refused, match=r"began 6 m|not made for the plan"):
                await start(rig, item=1, dry_run=store_dry_run(rig, **changes))
        assert (await flight_view(rig))["started_unix_s"] == second["started_unix_s"], (
            "a refused start began a flight"
        )

    run_with_scripted_vehicle(run_simulated, scenario)
