"""Resuming a plan after a landing, also after a restart of the vehicle or of the server."""

from types import SimpleNamespace

import pytest

from gcs_server.api import control_routes, mission_models, mission_routes
from gcs_server.errors import NotInControl, PlanFindings, Refused
from gcs_server.flights import resume, waypoint_flight
from gcs_server.flights.resume import ProgressStore
from gcs_server.plans.store import PlanStore
from gcs_server.storage.records import Records
from tests.protocol.api_calls import ANNA, BOB, MISSION_MODE, json_of, new_station
from tests.protocol.command_numbers import DO_CHANGE_SPEED, DO_SET_CAM_TRIGG_DIST
from tests.protocol.fake_autopilot import HOLD_MODE, IN_AIR, ON_GROUND, RTL_MODE
from tests.protocol.mission_autopilot import MissionAutopilot, UploadingStation
from tests.protocol.offboard_testbed import OffboardTestbed, sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.support.documents import read_document
from tests.support.recorded_calls import record_calls

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


PICTURES_ITEM = {"kind": "trigger_distance", "distance_m": 10}
PLAN = {
    "items": [
        item("takeoff", 0, 20),
        item("waypoint", 40, 20),
        PICTURES_ITEM,
        item("waypoint", 140, 20),
        item("waypoint", 180, 30),
        {"kind": "return_home"},
    ]
}


def run_with_rig(run_simulated, tmp_path, scenario):
    """Runs a test with a scripted vehicle, which has the simulator's mission service."""

    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilot = link.autopilots["peer"] = MissionAutopilot(link)
        rig = SimpleNamespace(testbed=testbed, autopilot=autopilot, folder=tmp_path)
        try:
            rig.vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            await start_server(rig)
            await scenario(rig)
            rig.progress.close()
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


async def start_server(rig):
    """Starts a server on the data folder of the test."""
    rig.progress = ProgressStore(Records(rig.folder / "flights"))
    await rig.progress.load()
    rig.station = new_station(rig.testbed, rig.progress)
    rig.station.flights.plans = PlanStore(rig.folder / "plans", rig.testbed.clock, rig.testbed.fleet.events)
    rig.flights = rig.station.flights.waypoint_flights


async def monitor_for(rig, duration_s):
    """Lets the server monitor the vehicle for this time."""
    for _ in range(int(duration_s * 10)):
        rig.flights.update()
        await sleep(0.1)


async def upload(rig, plan=PLAN):
    body = mission_models.UploadRequest.model_validate({"plan": plan, "wait": True})
    await mission_routes.upload("1", body, rig.station, ANNA)
    await sleep(1.5)


async def start(rig, by=ANNA, **body):
    await mission_routes.start("1", rig.station, by, mission_models.StartRequest.model_validate(body))


async def mission_view(rig):
    response = json_of(await mission_routes.show_mission(rig.vehicle, rig.station))
    mission_models.MissionView.model_validate(response)
    return response


async def fly_to(rig, current, north_m):
    rig.autopilot.landed_state, rig.autopilot.flight.current = IN_AIR, current
    rig.autopilot.position[0] = LAT + north_m * DEG_PER_M
    await monitor_for(rig, 2.5)


async def land(rig, north_m=0.0):
    """Lets the vehicle return as with a low battery, land and disarm."""
    rig.autopilot.mode = RTL_MODE
    await monitor_for(rig, 2.5)
    rig.autopilot.position[0] = LAT + north_m * DEG_PER_M
    rig.autopilot.armed, rig.autopilot.landed_state, rig.autopilot.mode = False, ON_GROUND, HOLD_MODE
    await monitor_for(rig, 2.5)


async def interrupt_at_item_4(rig):
    await upload(rig)
    await start(rig, item=0)
    await fly_to(rig, 1, 10)
    await fly_to(rig, 3, 90)
    await land(rig)


def test_the_vehicles_plan_is_read_outside_the_event_loop(run_simulated, tmp_path, monkeypatch):
    in_flight = record_calls(monkeypatch, waypoint_flight, "plan_from_items")
    in_resume = record_calls(monkeypatch, resume, "plan_from_items")

    async def scenario(rig):
        await interrupt_at_item_4(rig)
        assert (await mission_view(rig))["resume"] is not None
        assert in_flight
        assert in_resume
        assert all(in_flight + in_resume)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_plan_that_cannot_be_read_is_a_fault_of_its_vehicle(run_simulated, tmp_path, monkeypatch):
    def fail(_):
        raise ValueError("no plan")

    async def scenario(rig):
        await upload(rig)
        monkeypatch.setattr(waypoint_flight, "plan_from_items", fail)
        await start(rig, item=0)
        await monitor_for(rig, 1)
        assert any("the begin of its waypoint flight" in text for text in rig.vehicle.isolation.faults)
        monkeypatch.undo()
        await monitor_for(rig, 1)
        assert rig.vehicle.isolation.faults == []
        assert (await mission_view(rig))["flight"] is not None

    run_with_rig(run_simulated, tmp_path, scenario)


def test_after_a_battery_change_the_interrupted_leg_is_flown_from_its_start(run_simulated, tmp_path):
    async def scenario(rig):
        assert ((await mission_view(rig))["resume"], (await mission_view(rig))["no_resume"]) == (None, None)
        await interrupt_at_item_4(rig)
        rig.autopilot.alive = False
        await monitor_for(rig, 12)
        rig.autopilot.alive, rig.autopilot.flight.current = True, 0
        await monitor_for(rig, 3)
        offer = (await mission_view(rig))["resume"]
        interrupted_for_s = rig.testbed.clock.unix_s() - offer["interrupted_unix_s"]
        assert 17 < interrupted_for_s < 22, (
            "interrupted_unix_s is not the time at which the vehicle began to return"
        )
        assert (offer["item"], offer["count"], offer["title"], offer["interrupted_item"]) == (
            1,
            6,
            "Waypoint",
            3,
        )
        assert (offer["altitude_m"], offer["altitude_reference"]) == (20, "home")
        assert offer["distance_m"] == pytest.approx(40, abs=0.5)
        assert offer["cautions"] == []
        await start(rig, item=offer["item"], mission_id=offer["mission_id"])
        assert (rig.autopilot.armed, rig.autopilot.mode, rig.autopilot.flight.current) == (
            True,
            MISSION_MODE,
            1,
        )
        await fly_to(rig, 1, 20)
        assert "armed" in (await mission_view(rig))["no_resume"]
        await land(rig)
        assert (await mission_view(rig))["resume"]["item"] == 1, (
            "the offer skips a waypoint that was not reached"
        )
        await start(rig, item=1)
        await fly_to(rig, 4, 150)
        await land(rig)
        assert (await mission_view(rig))["resume"]["item"] == 3

    run_with_rig(run_simulated, tmp_path, scenario)


def test_after_a_restart_of_the_server_the_plan_is_compared_before_the_flight_is_resumed(
    run_simulated, tmp_path
):
    async def scenario(rig):
        await interrupt_at_item_4(rig)
        rig.progress.close()
        rig.vehicle.mission.items_on_vehicle = None
        await start_server(rig)
        view = await mission_view(rig)
        assert view["resume"] is None
        assert view["no_resume"].startswith("Vehicle 1 has flown the plan up to item 4. Read the plan back")
        stored = await rig.station.flights.plans.create("Field", read_document(PLAN), by=("anna", "key"))
        body = mission_models.DownloadRequest(wait=True)
        await mission_routes.download(rig.vehicle, rig.station, ANNA, body)
        body = mission_models.WhichPlan(plan_id=stored.id)
        await mission_routes.compare(rig.vehicle, body, rig.station)
        assert (await mission_view(rig))["resume"]["item"] == 1

    run_with_rig(run_simulated, tmp_path, scenario)


@pytest.mark.parametrize(
    ("current", "mode", "offer"),
    [
        (5, RTL_MODE, "Vehicle 1 has flown the plan to its end."),
        (4, RTL_MODE, 3),
        (4, HOLD_MODE, 3),
        (3, RTL_MODE, 1),
    ],
)
def test_a_server_restarted_after_the_vehicle_left_its_mission_offers_no_older_item(
    run_simulated, tmp_path, current, mode, offer
):
    """The server ends on the leg to item 4; until it runs again, the vehicle flies on and leaves Mission."""

    async def scenario(rig):
        await upload(rig)
        await start(rig, item=0)
        await fly_to(rig, 1, 10)
        await fly_to(rig, 3, 90)
        rig.progress.close()
        rig.autopilot.flight.current, rig.autopilot.mode = current, mode
        await sleep(2.5)
        await start_server(rig)
        known, rig.vehicle.mission.items_on_vehicle = rig.vehicle.mission.items_on_vehicle, None
        await monitor_for(rig, 1)  # the plan is found by its ids a little later
        rig.vehicle.mission.items_on_vehicle = known
        await monitor_for(rig, 3)
        rig.autopilot.armed, rig.autopilot.landed_state = False, ON_GROUND
        await monitor_for(rig, 2.5)
        rig.autopilot.mode, rig.autopilot.flight.current = HOLD_MODE, 0
        await monitor_for(rig, 2.5)
        view = await mission_view(rig)
        if isinstance(offer, str):
            assert (view["resume"], view["no_resume"]) == (None, offer)
        else:
            assert view["resume"]["item"] == offer

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_manual_flight_after_the_restart_leaves_the_offer(run_simulated, tmp_path):
    async def scenario(rig):
        await interrupt_at_item_4(rig)
        rig.progress.close()
        await start_server(rig)
        await monitor_for(rig, 2.5)
        rig.autopilot.flight.current = 0
        rig.autopilot.armed, rig.autopilot.landed_state, rig.autopilot.mode = True, IN_AIR, HOLD_MODE
        await monitor_for(rig, 2.5)
        assert (await mission_view(rig))["flight"] is None
        await land(rig)
        assert (await mission_view(rig))["resume"]["item"] == 1

    run_with_rig(run_simulated, tmp_path, scenario)


def test_another_plan_is_not_resumed_and_the_reason_is_shown(run_simulated, tmp_path):
    async def scenario(rig):
        await interrupt_at_item_4(rig)
        offer = (await mission_view(rig))["resume"]
        higher_items = [{**plan_item} for plan_item in PLAN["items"]]
        higher_items[1] = item("waypoint", 40, 25)
        await upload(rig, {"items": higher_items})
        view = await mission_view(rig)
        assert view["resume"] is None
        assert view["no_resume"].startswith(
            "Vehicle 1 has flown the plan up to item 4, and now has another plan"
        )
        with pytest.raises(Refused, match="another mission than the one that the start was chosen for"):
            await start(rig, item=offer["item"], mission_id=offer["mission_id"])
        assert not rig.autopilot.armed
        await upload(rig)
        assert (await mission_view(rig))["resume"] == {
            **offer,
            "distance_m": (await mission_view(rig))["resume"]["distance_m"],
        }
        await UploadingStation(rig.autopilot).upload([])
        await sleep(2)
        assert (await mission_view(rig))["resume"] is None

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_plan_that_is_finished_or_did_not_reach_its_first_waypoint_is_not_resumed(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)
        await start(rig, item=0)
        await fly_to(rig, 1, 10)
        await land(rig)
        view = await mission_view(rig)
        assert (view["resume"], view["no_resume"]) == (None, None)
        await interrupt_at_item_4(rig)
        await start(rig, item=0)
        await fly_to(rig, 1, 10)
        await land(rig)
        assert (await mission_view(rig))["resume"]["interrupted_item"] == 3, (
            "a new start that flew no leg changed the offer"
        )
        await start(rig, item=0)
        await fly_to(rig, 4, 150)
        await fly_to(rig, 5, 180)
        rig.autopilot.armed, rig.autopilot.landed_state = False, ON_GROUND
        await monitor_for(rig, 2.5)
        view = await mission_view(rig)
        assert (view["resume"], view["no_resume"]) == (None, "Vehicle 1 has flown the plan to its end.")

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_resume_is_checked_like_a_start_and_from_the_vehicles_position(run_simulated, tmp_path):
    async def scenario(rig):
        corners = ((170, -30), (190, -30), (190, 30), (170, 30))
        polygon = [{"lat_deg": LAT + n * DEG_PER_M, "lon_deg": LON + e * DEG_PER_M} for n, e in corners]
        mast = {"name": "Mast", "top": {"value_m": 25, "reference": "home"}, "polygon": polygon}
        plan = read_document({**PLAN, "obstacles": [mast]})
        stored = await rig.station.flights.plans.create("Field", plan, by=("anna", "key"))
        body = mission_models.UploadRequest(plan_id=stored.id, wait=True)
        await mission_routes.upload("1", body, rig.station, ANNA)
        await sleep(1.5)
        await start(rig, item=0)
        await fly_to(rig, 3, 90)
        await land(rig, north_m=260)
        offer = (await mission_view(rig))["resume"]
        assert offer["cautions"][0].startswith(
            "The vehicle is 260 m from where the interrupted flight took off."
        )
        await control_routes.release("1", rig.station, ANNA)
        await control_routes.take("1", rig.station, BOB)
        with pytest.raises(NotInControl):
            await start(rig, item=offer["item"])
        assert not rig.autopilot.armed
        with pytest.raises(PlanFindings) as refused:
            await start(rig, BOB, item=offer["item"], despite=["obstacle_hit"])
        assert refused.value.codes == ("flight_from_here",)
        assert refused.value.reasons == ("The straight path to item 2 (waypoint) passes through Mast.",)
        with pytest.raises(Refused, match=r"cannot start at item 6 on the ground\. No waypoint follows"):
            await start(rig, BOB, item=5)
        assert not rig.autopilot.armed
        await start(rig, BOB, item=offer["item"], despite=["flight_from_here"])
        assert (rig.autopilot.armed, rig.autopilot.flight.current) == (True, 1)

    run_with_rig(run_simulated, tmp_path, scenario)


SHORT_PLAN = {
    "items": [
        item("takeoff", 0, 6),
        {"kind": "change_speed", "speed_type": 1.0, "speed_m_s": 3.0},
        item("waypoint", 12, 6),
        PICTURES_ITEM,
        item("waypoint", 40, 6),
        item("land", 40, 0),
    ]
}
RESTORING_COMMANDS = [DO_CHANGE_SPEED, DO_SET_CAM_TRIGG_DIST]
QUICK_RETURN_PARAMS = {"COM_LOW_BAT_ACT": 3, "RTL_RETURN_ALT": 6, "RTL_DESCEND_ALT": 6, "RTL_LAND_DELAY": 0}


@pytest.mark.story
def test_a_simulated_px4_with_a_new_battery_flies_the_rest_with_the_plans_speed_and_pictures(
    run_simulated, tmp_path
):
    async def run():
        testbed = SimulatedTestbed(parameters=QUICK_RETURN_PARAMS)
        rig = SimpleNamespace(testbed=testbed, folder=tmp_path)
        try:
            rig.vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            await start_server(rig)
            rig.flights.start()
            mission = testbed.sim.autopilots[0].navigator.mission
            await upload(rig, SHORT_PLAN)
            await start(rig, item=0)
            await until(lambda: mission.current == 4, 40)
            await sleep(4)
            testbed.sim.simulation.set_battery_remaining(0, 0.06)
            await until(lambda: rig.vehicle.status.mode == "rtl", 15)
            await until(lambda: not rig.vehicle.status.armed, 60)
            testbed.sim.simulation.set_battery_remaining(0, 1.0)
            testbed.sim.set_link_up(0, "gcs", False)
            await sleep(12)
            testbed.sim.set_link_up(0, "gcs", True)
            await until(lambda: not rig.vehicle.status.link_lost, 10)
            await sleep(3)
            await testbed.wait_for_vehicle_ready_to_arm()
            offer = (await mission_view(rig))["resume"]
            assert (offer["item"], offer["interrupted_item"], offer["cautions"]) == (2, 4, [])
            executed = []
            testbed.sim.autopilots[0].own_commands.add_listener(
                lambda command: executed.append(command.number)
            )
            await start(rig, item=offer["item"], mission_id=offer["mission_id"])
            await until(lambda: mission.current == 4, 40)
            assert [number for number in executed if number in RESTORING_COMMANDS] == RESTORING_COMMANDS, (
                "PX4 did not restore the speed and then the pictures"
            )
            await sleep(6)
            assert rig.vehicle.topic("local_position").value.velocity_ned_m_s[0] == pytest.approx(3, abs=0.7)
            await until(lambda: not rig.vehicle.status.armed, 60)
            await sleep(1)
            assert (await mission_view(rig))["no_resume"] == "Vehicle 1 has flown the plan to its end."
            rig.progress.close()
        finally:
            await testbed.close()

    run_simulated(run)
