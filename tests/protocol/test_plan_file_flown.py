"""A plan file of QGroundControl is imported, uploaded, flown by the simulated PX4, read back and exported: it
is the same plan at every stage."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs_server.api import mission_models, mission_routes, plan_models, plan_routes
from gcs_server.plans.store import PlanStore
from missions import plan as documents
from tests.protocol.api_calls import ANNA, InlinePlanWork, station_of, view
from tests.protocol.offboard_world import seconds
from tests.protocol.simulated_world import SimulatedWorld, until

FILE = Path(__file__).parents[1] / "data" / "plans" / "survey_gimbal_fence.plan"
"""A survey, settings of camera, gimbal and speed, three kinds of altitudes, a geofence, rally points."""
PARTS = ("mission", "fence", "rally")
COMMANDS_OF_ITEMS = (178, 205, 206, 530, 1000, 2000, 197)
"""Items that PX4 executes as commands."""


def scenario(jump, tmp_path, work):
    async def run():
        world = SimulatedWorld()
        try:
            vehicle = await world.ready_to_arm()
            station = station_of(world)
            station.plans, station.plan_work = PlanStore(tmp_path / "plans", world.clock), InlinePlanWork()
            station.waypoint_flights.start()
            await work(SimpleNamespace(world=world, vehicle=vehicle, station=station))
            station.plans.close()
        finally:
            await world.close()

    jump(run)


async def import_file(rig):
    """The file as a stored plan."""

    async def body():
        return FILE.read_bytes()

    answer = view(await plan_routes.import_plan(SimpleNamespace(body=body), rig.station, FILE.name))
    assert answer["notes"] == []
    plan = documents.read(json.dumps(answer["plan"]).encode())
    return await rig.station.plans.create("Survey", plan, by=("anna", "key"))


async def export_file(rig, stored):
    """The stored plan as a .plan file."""
    _, document = await rig.station.plans.get(stored.id, None)
    body = plan_models.PlanToExport.model_validate({"plan": json.loads(document)})
    answer = await plan_routes.export_plan(body, rig.station, "plan")
    assert json.loads(answer.headers["X-Plan-Notes"]) == []
    return answer.body


def items_on(rig):
    """Items, ids and name of the plan on the vehicle, as last read; NaN as text, so that it equals itself."""
    held = rig.vehicle.mission.items_on_vehicle
    return {part: [repr(item) for item in held.items[part]] for part in PARTS}, held.ids, held.plan


async def compare_with_vehicle(rig, which):
    """Whether the downloaded items equal a plan, the differences, and whether the vehicle still has them."""
    body = mission_models.WhichPlan.model_validate(which)
    answer = view(await mission_routes.compare(rig.vehicle, body, rig.station))
    return answer["equal"], answer["differences"], answer["still_held"]


async def flown_commands(rig):
    """Flies the plan to its end; the items that PX4 executed as commands."""
    sent = []
    rig.world.sim.autopilots[0].own_commands.add_listener(sent.append)
    body = mission_models.StartRequest.model_validate({"item": 0})
    await mission_routes.start("1", rig.station, ANNA, body)
    await until(lambda: not rig.vehicle.status.armed, 180)
    return [each.number for each in sent if each.number in COMMANDS_OF_ITEMS]


@pytest.mark.story
@pytest.mark.flight
@pytest.mark.parametrize(
    "loss", [0.05, *(pytest.param(loss, marks=pytest.mark.broad) for loss in (0.0, 0.3))]
)
def test_a_plan_file_is_the_same_after_import_upload_flight_download_and_export(jump, tmp_path, loss):
    async def work(rig):
        stored = await import_file(rig)
        _, document = await rig.station.plans.get(stored.id, None)
        plan = documents.read(document)
        rig.world.loss = loss
        uploading = mission_models.UploadRequest.model_validate({"plan_id": stored.id, "wait": True})
        done = view(await mission_routes.upload("1", uploading, rig.station, ANNA))["result"]
        assert done == {"items": {"mission": 19, "fence": 9, "rally": 2}, "not_kept": []}
        before = items_on(rig)
        assert all(before[1].values())
        assert before[2].id == stored.id

        executed = await flown_commands(rig)
        planned = [item.COMMAND for _, item in plan.simple_items() if item.COMMAND in COMMANDS_OF_ITEMS]
        assert executed == planned
        await seconds(5)
        answer = view(await mission_routes.show_mission(rig.vehicle, rig.station))
        assert (answer["flight"]["state"], answer["flight"]["plan_id"]) == ("done", stored.id)
        assert (answer["mission"]["reached"], answer["holds"]["state"]) == (18, "plan")

        rig.vehicle.mission.items_on_vehicle = None  # as after a restart of the server
        await mission_routes.download(
            rig.vehicle, rig.station, ANNA, mission_models.DownloadRequest(wait=True)
        )
        assert await compare_with_vehicle(rig, {"plan_id": stored.id}) == (True, [], True)
        assert items_on(rig) == before
        read = view(await mission_routes.downloaded_plan(rig.vehicle))
        assert await compare_with_vehicle(rig, {"plan": read["plan"]}) == (True, [], True)
        assert json.dumps(json.loads(await export_file(rig, stored))) == json.dumps(
            json.loads(FILE.read_bytes())
        )

    scenario(jump, tmp_path, work)
