"""The Python client stores plans and uploads them to a vehicle; the whole application runs in memory."""

import asyncio

import httpx
import pytest

from gcs_server.app import create_app
from gcs_server.client import Gcs, Refused, Unknown
from gcs_server.clock import LoopClock
from gcs_server.scenarios.memory_link import MemoryLink
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from tests.protocol.mission_autopilot import MissionAutopilot
from tests.support.api_client import settings_for

AT_20_M = {"value_m": 20, "reference": "home"}
POSITION = {"lat_deg": 47.397742, "lon_deg": 8.545594, "altitude": AT_20_M}
HOME = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_amsl_m": 488.0}
PLAN = {"items": [{"kind": "takeoff", **POSITION}, {"kind": "waypoint", **POSITION}, {"kind": "return_home"}]}


def run_scenario(tmp_path, scenario):
    async def run_application():
        clock = LoopClock(asyncio.get_running_loop())
        app = create_app(settings_for(tmp_path), clock, static=tmp_path / "none")
        server = app.state.server
        server.router.start()
        server.fleet.start()
        link = MemoryLink("memory", outgoing=lambda data, _: autopilot.receive(data))
        server.router.add(link)
        autopilot = MissionAutopilot(link)
        gcs = Gcs("http://localhost", client="anna")
        gcs._http = httpx.AsyncClient(
            transport=httpx.ASGITransport(app),
            base_url="http://localhost/api/v1",
            headers=gcs._headers,
            timeout=None,
        )
        try:
            await asyncio.sleep(5.0)
            async with gcs:
                await scenario(gcs, autopilot)
        finally:
            autopilot.alive = False
            await server.fleet.close()
            await server.supervisor.close()
            await server.router.close()
            server.station.flights.plans.close()
            server.station.flights.plan_work.close()

    run_on_simulated_time(run_application)


@pytest.mark.story
def test_plans_are_stored_changed_checked_exported_and_imported(tmp_path):
    async def scenario(gcs, _autopilot):
        plans = gcs.plans()
        stored = await plans.create("Tower", PLAN)
        saved = await plans.save(stored["id"], "Old tower", stored["plan"], base_version=1)
        with pytest.raises(Refused) as raised:
            await plans.save(stored["id"], "Tower", PLAN, base_version=1)
        assert raised.value.code == "conflict"
        assert [version["version"] for version in await plans.versions(stored["id"])] == [2, 1]
        assert (await plans.get(stored["id"], 1))["name"] == "Tower"
        assert (await plans.all())[0]["name"] == saved["name"] == "Old tower"
        check = await plans.check(stored["plan"], vehicle_id="1")
        assert "parameters_unknown" in {finding["code"] for finding in check["findings"]}
        exported = await plans.write_file(PLAN, "kml")
        imported = await plans.read_file(exported, "a.kml")
        assert len(imported["plan"]["items"]) == 3
        converted = await plans.convert({**PLAN, "planned_home": HOME}, "Mast")
        assert (await plans.check(converted["plan"]))["flight"]["steps"][0]["place"] == "step 1"
        assert b"step: take_off" in await plans.write_file(converted["plan"], "yaml")
        assert "OffboardMission" in (await plans.schema())["title"]
        center = {"lat_deg": 47.4, "lon_deg": 8.5}
        orbit = await plans.pattern("orbit", center=center, radius_m=20, altitude=AT_20_M)
        assert orbit["figures"]["lines_length_m"] > 50
        orbit_steps = await plans.pattern(
            "orbit", document="offboard_mission", center=center, radius_m=20, altitude=AT_20_M
        )
        assert [step["step"] for step in orbit_steps["plan"]["steps"]] == ["orbit"]
        await plans.delete(stored["id"], base_version=2)
        with pytest.raises(Unknown):
            await plans.get(stored["id"])

    run_scenario(tmp_path, scenario)


def test_a_plan_is_uploaded_downloaded_compared_and_flown(tmp_path):
    async def scenario(gcs, autopilot):
        vehicle = await gcs.wait_for_vehicle("1")
        mission = vehicle.mission
        stored = await gcs.plans().create("Tower", PLAN)
        uploaded = await mission.upload(plan_id=stored["id"])
        assert uploaded["items"]["mission"] == 3
        assert (await mission.state())["holds"]["plan"]["id"] == stored["id"]
        assert (await mission.download())["plan_name"]["version"] == 1
        assert (await mission.compare(PLAN))["equal"]
        await mission.start(1)
        assert (autopilot.armed, autopilot.flight.current) == (True, 1)
        autopilot.landed_state = 2
        await vehicle.until(lambda v: v["status"]["landed_state"] == "in_air", what="in the air")
        await mission.pause()
        await mission.resume()
        held = (await mission.state())["mission"]["mission_id"]
        await mission.skip_to(2, mission_id=held)
        assert autopilot.flight.current == 2
        with pytest.raises(Refused, match="another mission"):
            await mission.skip_to(1, mission_id=held + 1)
        await mission.pause()
        await mission.restart()
        assert autopilot.flight.current == 0
        await mission.pause()
        await mission.clear()
        with pytest.raises(Refused, match="has no mission"):
            await mission.start()

    run_scenario(tmp_path, scenario)


def test_a_vehicle_on_the_ground_neither_skips_nor_restarts_nor_arms(tmp_path):
    async def scenario(gcs, autopilot):
        mission = (await gcs.wait_for_vehicle("1")).mission
        await mission.upload(plan_id=(await gcs.plans().create("Tower", PLAN))["id"])
        for command in (mission.resume(), mission.skip_to(1), mission.restart()):
            with pytest.raises(Refused, match="is not flying"):
                await command
        assert not autopilot.armed

    run_scenario(tmp_path, scenario)
