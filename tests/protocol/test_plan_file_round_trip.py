"""A plan file of QGroundControl stays the same plan through import, upload, a flight of the simulated PX4,
download and export."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs_server.api import mission_models, mission_routes, plan_models, plan_routes
from gcs_server.plans.store import PlanStore
from missions import plan as documents
from tests.protocol.api_calls import ANNA, InlinePlanWork, json_of, new_station
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.support.documents import read_document
from vehicle_sim.mavlink import generated_dialect as sim

FILE = Path(__file__).parents[1] / "data" / "plans" / "survey_gimbal_fence.plan"
"""A survey, settings of camera, gimbal and speed, three kinds of altitudes, a geofence, rally points."""
PARTS = ("mission", "fence", "rally")
COMMANDS_OF_ITEMS = (
    sim.MAV_CMD_DO_CHANGE_SPEED,
    sim.MAV_CMD_DO_MOUNT_CONTROL,
    sim.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    sim.MAV_CMD_SET_CAMERA_MODE,
    sim.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    sim.MAV_CMD_IMAGE_START_CAPTURE,
    sim.MAV_CMD_DO_SET_ROI_NONE,
)
"""Items that PX4 executes as commands."""


def run_with_rig(run_simulated, tmp_path, scenario):
    async def run():
        testbed = SimulatedTestbed()
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            station = new_station(testbed)
            station.flights.plans, station.flights.plan_work = (
                PlanStore(tmp_path / "plans", testbed.clock, testbed.fleet.events),
                InlinePlanWork(),
            )
            station.flights.waypoint_flights.start()
            await scenario(SimpleNamespace(testbed=testbed, vehicle=vehicle, station=station))
            station.flights.plans.close()
        finally:
            await testbed.close()

    run_simulated(run)


async def import_file(rig):
    """Imports the file; returns the stored plan."""

    async def body():
        return FILE.read_bytes()

    response = json_of(await plan_routes.import_plan(SimpleNamespace(body=body), rig.station, FILE.name))
    assert response["notes"] == []
    return await rig.station.flights.plans.create(
        "Survey", read_document(response["plan"]), by=("anna", "key")
    )


async def export_file(rig, stored):
    """Exports the stored plan; returns the content of the .plan file."""
    _, document = await rig.station.flights.plans.get(stored.id, None)
    body = plan_models.PlanToExport.model_validate({"plan": json.loads(document)})
    response = await plan_routes.export_plan(body, rig.station, "plan")
    assert json.loads(response.headers["X-Plan-Notes"]) == []
    return response.body


def items_on(rig):
    """Items, ids and reference of the plan on the vehicle; the items as text, in which NaN equals NaN, and
    without the mark of the item that PX4 flies at the moment."""
    mission = rig.vehicle.mission.items_on_vehicle
    items = {part: [repr(replace(item, current=False)) for item in mission.items[part]] for part in PARTS}
    return items, mission.ids, mission.plan


async def compare_with_vehicle(rig, plan):
    """Compares the downloaded items with a plan.

    Returns:
        Whether they are equal, the differences, and whether the vehicle still has the items.
    """
    body = mission_models.WhichPlan.model_validate(plan)
    response = json_of(await mission_routes.compare(rig.vehicle, body, rig.station))
    return response["equal"], response["differences"], response["still_held"]


async def flown_commands(rig):
    """Flies the plan to its end; returns the numbers of the items that PX4 executed as commands."""
    executed = []
    rig.testbed.sim.autopilots[0].own_commands.add_listener(executed.append)
    body = mission_models.StartRequest.model_validate({"item": 0})
    await mission_routes.start("1", rig.station, ANNA, body)
    await until(lambda: not rig.vehicle.status.armed, 180)
    # At the mission's end PX4 also moves the gimbal to neutral, by a command that it does not repeat.
    return [each.number for each in executed if each.repeated and each.number in COMMANDS_OF_ITEMS]


@pytest.mark.story
@pytest.mark.flight
@pytest.mark.parametrize(
    "loss", [0.05, *(pytest.param(loss, marks=pytest.mark.broad) for loss in (0.0, 0.3))]
)
def test_a_plan_file_is_the_same_after_import_upload_flight_download_and_export(
    run_simulated, tmp_path, loss
):
    async def scenario(rig):
        stored = await import_file(rig)
        _, document = await rig.station.flights.plans.get(stored.id, None)
        plan = documents.read(document)
        rig.testbed.loss = loss
        upload_body = mission_models.UploadRequest.model_validate({"plan_id": stored.id, "wait": True})
        result = json_of(await mission_routes.upload("1", upload_body, rig.station, ANNA))["result"]
        assert result == {"items": {"mission": 19, "fence": 9, "rally": 2}, "not_kept": []}
        items, ids, reference = items_on(rig)
        assert all(ids.values())
        assert reference.id == stored.id

        executed = await flown_commands(rig)
        planned = [item.COMMAND for _, item in plan.simple_items() if item.COMMAND in COMMANDS_OF_ITEMS]
        assert executed == planned
        await sleep(5)
        response = json_of(await mission_routes.show_mission(rig.vehicle, rig.station))
        assert (response["flight"]["state"], response["flight"]["plan_id"]) == ("done", stored.id)
        assert (response["mission"]["reached"], response["holds"]["state"]) == (18, "plan")

        rig.vehicle.mission.items_on_vehicle = None  # as after a restart of the server
        await mission_routes.download(
            rig.vehicle, rig.station, ANNA, mission_models.DownloadRequest(wait=True)
        )
        assert await compare_with_vehicle(rig, {"plan_id": stored.id}) == (True, [], True)
        assert items_on(rig) == (items, ids, reference)
        downloaded = json_of(await mission_routes.downloaded_plan(rig.vehicle, rig.station))
        assert await compare_with_vehicle(rig, {"plan": downloaded["plan"]}) == (True, [], True)
        assert json.dumps(json.loads(await export_file(rig, stored))) == json.dumps(
            json.loads(FILE.read_bytes())
        )

    run_with_rig(run_simulated, tmp_path, scenario)
