"""The routes for a vehicle's mission: permissions, confirmations, checks, errors."""

import asyncio
import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from gcs_server.api import (
    command_routes,
    control_routes,
    mission_models,
    mission_routes,
    models,
    operation_routes,
)
from gcs_server.errors import Interrupted, InvalidRequest, NotInControl, PlanFindings, Refused, Rejected
from gcs_server.plans.store import PlanStore
from gcs_server.plans.tasks import ReadDocument
from missions.offboard.document import OffboardMission
from missions.offboard.steps import Land
from tests.protocol.api_calls import (
    ANNA,
    BOB,
    MISSION_MODE,
    InlinePlanWork,
    journal_entries,
    json_of,
    new_station,
)
from tests.protocol.command_numbers import ARM_DISARM, DO_SET_MODE
from tests.protocol.fake_autopilot import HOLD_MODE, IN_AIR
from tests.protocol.mission_autopilot import MissionAutopilot, UploadingStation
from tests.protocol.offboard_testbed import OffboardTestbed, sleep
from tests.support.documents import read_document

TEMPORARILY_REJECTED = 1
"""MAV_RESULT"""
ALTITUDE_20_M = {"value_m": 20, "reference": "home"}
POSITION = {"lat_deg": 47.397742, "lon_deg": 8.545594, "altitude": ALTITUDE_20_M}
PLAN = {
    "items": [{"kind": "takeoff", **POSITION}, {"kind": "waypoint", **POSITION}, {"kind": "return_home"}],
    "fence": [
        {
            "shape": "circle",
            "inclusion": True,
            "center": {"lat_deg": 47.397742, "lon_deg": 8.545594},
            "radius_m": 200,
        }
    ],
}
PLAN_OUTSIDE_THE_FENCE = {
    **PLAN,
    "items": [*PLAN["items"][:1], {"kind": "waypoint", **POSITION, "lat_deg": 47.41}],
}


def run_with_rig(run_simulated, tmp_path, scenario, **autopilot_options):
    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilot = link.autopilots["peer"] = MissionAutopilot(link, **autopilot_options)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            station = new_station(testbed)
            station.flights.plans = PlanStore(tmp_path / "plans", testbed.clock, testbed.fleet.events)
            await scenario(
                SimpleNamespace(testbed=testbed, vehicle=vehicle, autopilot=autopilot, station=station)
            )
            station.flights.plans.close()
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


async def upload(rig, plan=PLAN, *, by=ANNA, wait=True, **fields):
    body = mission_models.UploadRequest.model_validate({"plan": plan, "wait": wait, **fields})
    return await mission_routes.upload("1", body, rig.station, by)


async def get_mission(rig):
    return json_of(await mission_routes.show_mission(rig.vehicle, rig.station))


def start(rig, by=ANNA, **body):
    return mission_routes.start("1", rig.station, by, mission_models.StartRequest.model_validate(body))


def test_an_upload_is_an_operation_whose_result_is_the_vehicles_mission(run_simulated, tmp_path):
    async def scenario(rig):
        stored = await rig.station.flights.plans.create("Tower", read_document(PLAN), by=("anna", "key"))
        body = mission_models.UploadRequest.model_validate({"plan_id": stored.id})
        started = await mission_routes.upload("1", body, rig.station, ANNA)
        assert started.status_code == 202
        operation = json_of(started)
        assert started.headers["Location"] == f"/api/v1/operations/{operation['id']}"
        assert (operation["kind"], operation["vehicle"], operation["state"]) == (
            "mission/upload",
            "1",
            "running",
        )
        assert (await get_mission(rig))["holds"]["state"] == "not_known"
        with pytest.raises(Refused, match="only one can run"):
            await upload(rig)
        ended = await rig.station.operations.wait(operation["id"])
        assert ended.result == {"items": {"fence": 1, "rally": 0, "mission": 3}, "not_kept": []}
        mission_view = await get_mission(rig)
        assert mission_view["holds"]["state"] == "plan"
        assert mission_view["holds"]["plan"] == {"id": stored.id, "version": 1, "name": "Tower"}
        assert (
            mission_view["mission"]["count"],
            mission_view["mission"]["current"],
            mission_view["transfer"],
        ) == (3, 0, None)
        assert ("anna", "mission/upload", "1", "ok") in journal_entries(rig.station)
        view = json_of(await mission_routes.downloaded_plan(rig.vehicle, rig.station))
        assert [item["kind"] for item in view["plan"]["items"]] == [
            "takeoff",
            "waypoint",
            "return_home",
        ]
        assert (
            view["still_held"],
            view["notes"],
            view["plan"]["fence"][0]["radius_m"],
        ) == (True, [], 200)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_cancelled_upload_leaves_the_vehicles_previous_mission(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)
        long_plan = {**PLAN, "items": PLAN["items"][:2] * 20}
        started = json_of(await upload(rig, long_plan, wait=False))
        await sleep(0.15)
        ended = json_of(await operation_routes.cancel_operation(started["id"], rig.station, ANNA))
        assert ended["state"] == "cancelled"
        await sleep(2)
        mission_view = await get_mission(rig)
        assert (mission_view["holds"]["state"], mission_view["mission"]["count"]) == ("plan", 3)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_without_control_upload_clear_and_start_are_refused(run_simulated, tmp_path):
    async def scenario(rig):
        await control_routes.take("1", rig.station, BOB)
        for request in (
            upload(rig),
            mission_routes.clear("1", rig.station, ANNA),
            start(rig),
            mission_routes.resume("1", rig.station, ANNA),
        ):
            with pytest.raises(NotInControl):
                await request
        assert rig.autopilot.service._plans[0] == []

    run_with_rig(run_simulated, tmp_path, scenario)


async def fly_in_mission(rig):
    """Uploads the plan, and lets the vehicle fly it 100 m south and 100 m west of its first item."""
    await upload(rig)
    rig.autopilot.armed, rig.autopilot.mode, rig.autopilot.landed_state = True, MISSION_MODE, IN_AIR
    rig.autopilot.position[:] = [47.397742 - 100 / 111_195, 8.545594 - 100 / 75_270, 509.0]
    rig.autopilot.flight.current = 1
    await sleep(2.5)


SHORT_PLAN = {**PLAN, "items": PLAN["items"][:2]}


def test_a_changed_plan_for_a_vehicle_in_mission_is_refused_with_the_place_it_would_fly_to(
    run_simulated, tmp_path
):
    """PX4 resets a changed mission to item 0 and flies there at once; it ignores an identical one."""

    async def scenario(rig):
        await fly_in_mission(rig)
        for despite in ([], ["plan_not_known"]):
            with pytest.raises(PlanFindings, match="it flies to item 1") as raised:
                await upload(rig, SHORT_PLAN, despite=despite)
            assert raised.value.codes == ("flies_new_plan_at_once",)
            assert "(Takeoff) at once: 141 m to the north-east, at 20 m above home." in str(raised.value)
        with pytest.raises(InvalidRequest, match="nothing was sent"):
            await mission_routes.clear("1", rig.station, ANNA)
        assert (len(rig.autopilot.service._plans[0]), rig.autopilot.flight.current) == (3, 1)
        await upload(rig)
        assert rig.autopilot.mode == MISSION_MODE
        rig.vehicle.mission.items_on_vehicle = None
        with pytest.raises(PlanFindings, match="it flies to item 1"):
            await upload(rig)
        await upload(rig, SHORT_PLAN, despite=["flies_new_plan_at_once"])
        assert (len(rig.autopilot.service._plans[0]), rig.autopilot.mode) == (2, MISSION_MODE)
        await mission_routes.clear("1", rig.station, ANNA, "vehicle 1 loses the mission that it flies")
        assert rig.autopilot.service._plans[0] == []

    run_with_rig(run_simulated, tmp_path, scenario)


def test_with_hold_first_a_vehicle_in_mission_holds_before_a_changed_plan_is_sent(run_simulated, tmp_path):
    async def scenario(rig):
        await fly_in_mission(rig)
        modes_at_upload = []

        def note(message):
            if message.get_type() == "MISSION_COUNT":
                modes_at_upload.append(rig.autopilot.mode)
            return False

        handle = rig.autopilot.handle
        rig.autopilot.handle = lambda message: note(message) or handle(message)
        result = json_of(await upload(rig, SHORT_PLAN, hold_first=True))["result"]
        assert result["held_first"]
        assert modes_at_upload
        assert set(modes_at_upload) == {HOLD_MODE}
        assert len(rig.autopilot.service._plans[0]) == 2
        assert ("anna", "hold", "1", "ok") in journal_entries(rig.station)
        again = json_of(await upload(rig, SHORT_PLAN, hold_first=True))["result"]
        assert "held_first" not in again

    run_with_rig(run_simulated, tmp_path, scenario)


def test_without_hold_a_changed_plan_is_not_sent(run_simulated, tmp_path):
    async def scenario(rig):
        await fly_in_mission(rig)
        rig.autopilot.refusals[DO_SET_MODE] = TEMPORARILY_REJECTED
        with pytest.raises(Rejected, match="refused to switch to Hold"):
            await upload(rig, SHORT_PLAN, hold_first=True)
        assert (len(rig.autopilot.service._plans[0]), rig.autopilot.mode) == (3, MISSION_MODE)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_vehicle_that_enters_mission_during_the_upload_does_not_get_the_mission(run_simulated, tmp_path):
    async def scenario(rig):
        await fly_in_mission(rig)
        rig.autopilot.mode = HOLD_MODE
        await sleep(2.5)

        def enter(message):
            if message.get_type() == "MISSION_COUNT":
                rig.autopilot.mode = MISSION_MODE
                rig.autopilot.send_current_mode()

        handle = rig.autopilot.handle
        rig.autopilot.handle = lambda message: (enter(message), handle(message))
        with pytest.raises(Refused, match="The mission was not sent"):
            await upload(rig, {**SHORT_PLAN, "fence": PLAN["fence"]})
        assert len(rig.autopilot.service._plans[0]) == 3

    run_with_rig(run_simulated, tmp_path, scenario)


@pytest.mark.parametrize(("startable_after_s", "min_requests"), [(1.0, 1), (2.4, 2)])
def test_a_mission_is_started_a_second_after_its_upload_and_a_busy_px4_is_asked_again(
    run_simulated, tmp_path, startable_after_s, min_requests
):
    """PX4 refused Mission 50 ms after the MISSION_ACK, as it had not yet checked the mission."""

    async def scenario(rig):
        now_s = rig.testbed.clock.monotonic_s
        sent, requested_s = rig.autopilot.send_named, []
        acknowledged_s = [float("inf")]

        def send(name, /, **fields):
            if name == "MISSION_ACK" and fields["mission_type"] == 0:
                acknowledged_s[0] = now_s()
            sent(name, **fields)

        def refuse_early(message):
            if message.get_type() != "COMMAND_LONG" or (message.command, message.param2) != (DO_SET_MODE, 4):
                return False
            requested_s.append(now_s())
            if now_s() >= acknowledged_s[0] + startable_after_s:
                return False
            rig.autopilot.send_ack(DO_SET_MODE, TEMPORARILY_REJECTED)
            return True

        rig.autopilot.station_link.send = send
        rig.autopilot.handlers.append(refuse_early)
        await upload(rig)
        await start(rig)
        assert rig.autopilot.mode == MISSION_MODE
        assert len(requested_s) >= min_requests
        assert requested_s[0] >= acknowledged_s[0] + 1.0

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_refusal_of_mission_long_after_the_upload_is_final(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)
        await sleep(4)
        rig.autopilot.refusals[DO_SET_MODE] = TEMPORARILY_REJECTED
        with pytest.raises(Rejected, match="refused to switch to Mission"):
            await start(rig)
        requests = [m for m in rig.autopilot.received_commands(DO_SET_MODE) if m.param3 == 4]
        assert len(requests) == 1

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_plan_with_errors_is_started_only_if_despite_names_the_errors(run_simulated, tmp_path):
    async def scenario(rig):
        with pytest.raises(PlanFindings) as refused:
            await start(rig)
        assert refused.value.codes == ("plan_not_known",)
        await upload(rig, PLAN_OUTSIDE_THE_FENCE)
        with pytest.raises(PlanFindings, match="has errors") as raised:
            await start(rig)
        codes = set(raised.value.codes)
        assert "fence_violation" in codes
        with pytest.raises(PlanFindings):
            await start(rig, despite=["plan_not_known"])
        assert not rig.autopilot.armed
        response = json_of(await start(rig, despite=sorted(codes)))
        assert (response["status"]["armed"], response["status"]["mode"]) == (True, "mission")
        await UploadingStation(rig.autopilot).upload([])
        await sleep(2)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_mission_that_px4_rejected_after_the_upload_is_started_only_if_despite_says_so(
    run_simulated, tmp_path
):
    async def scenario(rig):
        await upload(rig)
        uploaded = rig.vehicle.mission.items_on_vehicle
        rig.vehicle.mission.items_on_vehicle = replace(uploaded, rejections=("it starts with a landing",))
        with pytest.raises(PlanFindings, match="mission: PX4 rejected it: it starts with") as raised:
            await start(rig)
        assert raised.value.codes == ("mission_rejected",)
        await start(rig, despite=["mission_rejected"])
        assert rig.autopilot.armed

    run_with_rig(run_simulated, tmp_path, scenario)


def test_the_obstacles_of_the_stored_plan_are_checked_at_the_start(run_simulated, tmp_path):
    corners = ((-2e-4, -2e-4), (2e-4, -2e-4), (2e-4, 2e-4), (-2e-4, 2e-4))
    polygon = [{"lat_deg": POSITION["lat_deg"] + n, "lon_deg": POSITION["lon_deg"] + e} for n, e in corners]
    tower = {"name": "Tower", "top": {"value_m": 50, "reference": "home"}, "polygon": polygon}

    async def scenario(rig):
        plan = read_document({**PLAN, "obstacles": [tower]})
        stored = await rig.station.flights.plans.create("Tower", plan, by=("anna", "key"))
        await upload(rig, None, plan_id=stored.id)
        with pytest.raises(PlanFindings, match="passes through Tower") as raised:
            await start(rig)
        assert "obstacle_hit" in raised.value.codes
        await rig.station.flights.plans.delete(stored.id, base_version=1, by=("anna", "key"))
        other_codes = set(raised.value.codes) - {"obstacle_hit"}
        response = json_of(await start(rig, despite=sorted(other_codes)))
        assert response["status"]["armed"], "the obstacles of a deleted plan prevented the start"

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_mission_starts_at_an_item_and_continues_after_hold(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)
        with pytest.raises(Refused, match="not flying"):
            await mission_routes.resume("1", rig.station, ANNA)
        await start(rig, item=1)
        assert (rig.autopilot.armed, rig.autopilot.mode, rig.autopilot.flight.current) == (
            True,
            MISSION_MODE,
            1,
        )
        rig.autopilot.landed_state = IN_AIR
        await rig.vehicle.command.hold()
        await sleep(1.5)
        await mission_routes.resume("1", rig.station, ANNA)
        assert (rig.autopilot.mode, rig.autopilot.flight.current) == (MISSION_MODE, 1)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_refused_start_does_not_leave_the_vehicle_in_mission_mode(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)
        rig.autopilot.arm_denied = True
        with pytest.raises(Rejected):
            await start(rig)
        await sleep(1)
        assert (rig.autopilot.armed, rig.vehicle.status.mode) == (False, "hold")

    run_with_rig(run_simulated, tmp_path, scenario)


def test_differences_to_a_plan_are_listed_by_item(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)
        body = mission_models.WhichPlan.model_validate({"plan": PLAN})
        comparison = json_of(await mission_routes.compare(rig.vehicle, body, rig.station))
        assert (comparison["equal"], comparison["differences"], comparison["still_held"]) == (True, [], True)
        other = json.loads(json.dumps(PLAN))
        other["items"][1]["altitude"]["value_m"] = 35
        body = mission_models.WhichPlan.model_validate({"plan": other})
        comparison = json_of(await mission_routes.compare(rig.vehicle, body, rig.station))
        assert not comparison["equal"]
        (difference,) = comparison["differences"]
        assert (
            difference["part"],
            difference["seq"],
            difference["field"],
            difference["planned"],
            difference["held"],
        ) == (
            "mission",
            1,
            "z",
            35,
            20,
        )

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_stored_plan_equal_to_the_vehicles_mission_is_identified(run_simulated, tmp_path):
    async def scenario(rig):
        await upload(rig)  # a plan without a name on this server
        which_plan = mission_models.WhichPlan.model_validate
        stored = await rig.station.flights.plans.create("Tower", read_document(PLAN), by=("anna", "key"))
        other = await rig.station.flights.plans.create(
            "Other", read_document(PLAN_OUTSIDE_THE_FENCE), by=("anna", "key")
        )
        for plan, plan_id in ((other, None), (stored, stored.id)):
            await mission_routes.compare(rig.vehicle, which_plan({"plan_id": plan.id}), rig.station)
            assert (await get_mission(rig))["holds"]["plan"]["id"] == plan_id
        other_item = rig.vehicle.mission.items_on_vehicle.items["mission"][1]
        await UploadingStation(rig.autopilot).upload([replace(other_item, seq=0, z=9.0)])
        await sleep(2)
        await mission_routes.compare(rig.vehicle, which_plan({"plan_id": stored.id}), rig.station)
        assert (await get_mission(rig))["holds"]["state"] == "another"

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_download_shows_the_mission_of_another_station(run_simulated, tmp_path):
    async def scenario(rig):
        with pytest.raises(Refused, match="has not been downloaded"):
            await mission_routes.downloaded_plan(rig.vehicle, rig.station)
        await upload(rig)
        item = rig.vehicle.mission.items_on_vehicle.items["mission"][1]
        other_item = item.__class__(0, item.frame, 16, 0, 0, 0, 0, item.x, item.y, 9.0)
        await UploadingStation(rig.autopilot).upload([other_item])
        await sleep(2)
        assert (await get_mission(rig))["holds"]["state"] == "another"
        body = mission_models.DownloadRequest(wait=True)
        response = json_of(await mission_routes.download(rig.vehicle, rig.station, BOB, body))
        assert response["result"] == {"items": {"fence": 1, "rally": 0, "mission": 1}}
        view = json_of(await mission_routes.downloaded_plan(rig.vehicle, rig.station))
        assert (len(view["plan"]["items"]), view["plan_name"], view["still_held"]) == (1, None, True)

    run_with_rig(run_simulated, tmp_path, scenario)


@pytest.mark.parametrize("body", [{}, {"plan": PLAN, "plan_id": "x"}, {"plan": PLAN, "version": 1}])
def test_a_request_without_a_plan_or_with_several_plans_is_refused(body):
    with pytest.raises(ValueError, match=r"exactly one|belongs to"):
        mission_models.WhichPlan.model_validate(body)


def test_an_upload_to_a_vehicle_that_is_lost_fails_with_a_reason(run_simulated, tmp_path):
    async def scenario(rig):
        uploading = asyncio.ensure_future(upload(rig, {**PLAN, "items": PLAN["items"][:2] * 50}))
        await sleep(0.2)
        rig.autopilot.alive = False
        result = (await asyncio.gather(uploading, return_exceptions=True))[0]
        assert "lost" in str(result)
        assert rig.vehicle.mission.running_transfer is None

    run_with_rig(run_simulated, tmp_path, scenario)


def test_an_offboard_mission_cannot_be_uploaded(run_simulated, tmp_path):
    async def scenario(rig):
        mission = ReadDocument.of(OffboardMission(name="Mast", steps=(Land(),), missions={}))
        stored = await rig.station.flights.plans.create("Mast", mission, by=("anna", "key"))
        body = mission_models.UploadRequest.model_validate({"plan_id": stored.id})
        with pytest.raises(InvalidRequest, match="the server flies it"):
            await mission_routes.upload("1", body, rig.station, ANNA)

    run_with_rig(run_simulated, tmp_path, scenario)


def test_every_way_into_the_mission_makes_the_same_checks(run_simulated, tmp_path):
    async def scenario(rig):
        rig.station.flights.plan_work = InlinePlanWork()
        await upload(rig, PLAN_OUTSIDE_THE_FENCE)
        ways = {
            "start": lambda despite: start(rig, despite=despite),
            "mode": lambda despite: command_routes.mode(
                "1", models.ModeRequest(mode="mission", despite=despite), rig.station, ANNA
            ),
        }
        with pytest.raises(PlanFindings) as refused:
            await ways["start"]([])
        codes = list(refused.value.codes)
        for way in ways.values():
            with pytest.raises(PlanFindings) as refused:
                await way([])
            assert list(refused.value.codes) == codes
        assert (rig.autopilot.armed, rig.autopilot.mode) == (False, HOLD_MODE)
        await ways["mode"](codes)
        body = models.ArmRequest(despite=["arming_starts_flight"])
        with pytest.raises(PlanFindings) as refused:
            await command_routes.arm("1", rig.station, ANNA, body)
        assert list(refused.value.codes) == codes
        await command_routes.arm(
            "1", rig.station, ANNA, models.ArmRequest(despite=["arming_starts_flight", *codes])
        )
        assert rig.autopilot.armed
        rig.autopilot.landed_state, rig.autopilot.mode = IN_AIR, HOLD_MODE
        await sleep(2.5)
        await mission_routes.resume("1", rig.station, ANNA)  # accepted in this flight
        assert rig.autopilot.mode == MISSION_MODE
        rig.autopilot.mode = HOLD_MODE
        await sleep(2.5)
        await upload(rig, {**PLAN_OUTSIDE_THE_FENCE, "items": PLAN_OUTSIDE_THE_FENCE["items"][1:] * 2})
        await sleep(2.5)
        with pytest.raises(PlanFindings):
            await mission_routes.resume("1", rig.station, ANNA)
        assert rig.autopilot.mode == HOLD_MODE

    run_with_rig(run_simulated, tmp_path, scenario)


@pytest.mark.parametrize("changed_by", ["download", "another station"])
def test_a_plan_that_changes_during_the_checks_or_the_start_is_not_flown(run_simulated, tmp_path, changed_by):
    async def scenario(rig):
        rig.station.flights.plan_work = InlinePlanWork()
        await upload(rig)
        long_plan = {**PLAN, "items": PLAN["items"][:2] * 20}
        await upload(rig, long_plan, wait=False)
        for request in (
            start(rig),
            command_routes.mode("1", models.ModeRequest(mode="mission"), rig.station, ANNA),
        ):
            with pytest.raises(Refused, match="is busy with"):
                await request
        await sleep(5)
        await upload(rig)
        rig.autopilot.silent_commands.add(ARM_DISARM)
        starting = asyncio.ensure_future(start(rig))
        await sleep(2.0)
        count = len(rig.autopilot.received_commands(ARM_DISARM))
        assert count
        if changed_by == "download":
            await rig.vehicle.mission.download()
        else:
            await UploadingStation(rig.autopilot).upload(
                rig.vehicle.mission.items_on_vehicle.items["mission"][:2]
            )
        with pytest.raises(Interrupted, match=r"has changed since it was checked|is busy with"):
            await starting
        await sleep(2.0)
        assert not rig.autopilot.armed

    run_with_rig(run_simulated, tmp_path, scenario)


def test_a_start_on_the_ground_without_an_item_names_the_later_item_at_which_px4_begins(
    run_simulated, tmp_path
):
    async def scenario(rig):
        rig.station.flights.plan_work = InlinePlanWork()
        await upload(rig)
        await rig.vehicle.mission.set_current(1)
        await sleep(1.5)
        with pytest.raises(PlanFindings, match="current item is item 2") as refused:
            await start(rig)
        assert refused.value.codes == ("starts_at_later_item",)
        assert not rig.autopilot.armed
        await start(rig, item=0)
        assert rig.autopilot.armed

    run_with_rig(run_simulated, tmp_path, scenario)
