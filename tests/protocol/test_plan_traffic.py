"""The server compares the start of a plan with the flights of the other vehicles, on simulated time."""

import asyncio
import functools
import json

import pytest

from gcs_server.api import (
    mission_models,
    mission_routes,
    offboard_mission_models,
    offboard_mission_routes,
    plan_models,
    plan_routes,
)
from gcs_server.errors import GcsError, PlanFindings
from gcs_server.flights import traffic, waypoint_flight
from missions.geodesy import LocalOrigin
from missions.offboard import document
from missions.offboard.reader import read
from missions.traffic import waypoints as missions_in_flight
from tests.protocol import two_vehicles
from tests.protocol.api_calls import ANNA, json_of
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import until
from tests.support.recorded_calls import record_calls

ORIGIN = LocalOrigin(47.397742, 8.545594, 488.0)
APART_M = 40.0
"""Distance of vehicle 2 to the east of vehicle 1."""


def item_at(kind, east_m, alt_m, **fields):
    lat, lon, _ = ORIGIN.to_geodetic((0.0, east_m, 0.0))
    altitude = {"value_m": alt_m, "reference": "home"}
    return {"kind": kind, "lat_deg": lat, "lon_deg": lon, "altitude": altitude, **fields}


TAKE_OFF_AND_LAND = {"items": [item_at("takeoff", 0, 2.5), item_at("land", 0, 0)]}
"""Vehicle 1 takes off and lands."""
ITEMS_OVER_VEHICLE_1 = [
    item_at("takeoff", APART_M, 6),
    item_at("waypoint", -APART_M, 6),
    item_at("land", -APART_M, 0),
]
EXCLUDED_AREA = {
    "shape": "circle",
    "inclusion": False,
    "center": {key: item_at("waypoint", 20, 0)[key] for key in ("lat_deg", "lon_deg")},
    "radius_m": 5,
}
THROUGH_EXCLUDED_AREA = {"items": ITEMS_OVER_VEHICLE_1, "fence": [EXCLUDED_AREA]}
"""Vehicle 2 flies over the position of vehicle 1, and through an area that is excluded."""


run_with_two_vehicles = functools.partial(two_vehicles.run_with_two_vehicles, apart_m=APART_M)


async def upload(rig, vehicle_id, plan):
    body = mission_models.UploadRequest.model_validate({"plan": plan, "wait": True})
    await mission_routes.upload(vehicle_id, body, rig.station, ANNA)
    await sleep(1.2)


async def start(rig, vehicle_id, *despite, item=0):
    body = mission_models.StartRequest.model_validate({"item": item, "despite": list(despite)})
    await mission_routes.start(vehicle_id, rig.station, ANNA, body)


async def refusal_of_start(rig, *despite):
    """Starts vehicle 2, which must be refused; returns the refusal."""
    with pytest.raises(PlanFindings) as caught:
        await start(rig, "2", *despite)
    assert not rig.second.status.armed
    assert rig.second.status.mode != "mission"
    return caught.value


async def separation_warnings(rig, plan=THROUGH_EXCLUDED_AREA):
    body = plan_models.PlanToCheck.model_validate({"plan": plan, "vehicle": "2"})
    response = json_of(await plan_routes.check_plan(body, rig.station))
    plan_models.PlanCheck.model_validate(response)
    separations = [finding for finding in response["findings"] if finding["code"].startswith("separation")]
    assert {finding["severity"] for finding in separations} <= {"warning"}
    return [(finding["code"], finding["place"]["row"]) for finding in separations]


def test_a_start_over_another_flight_is_refused_with_all_findings_until_the_other_vehicle_has_landed(
    run_simulated,
):
    async def scenario(rig):
        await upload(rig, "1", TAKE_OFF_AND_LAND)
        await upload(rig, "2", THROUGH_EXCLUDED_AREA)
        assert await separation_warnings(rig) == []
        await start(rig, "1")
        refusal = await refusal_of_start(rig)
        assert refusal.codes == ("fence_crossed", "separation")
        assert "The plan on vehicle 2 has errors: " in str(refusal)
        assert "Vehicle 2 may come too near to another vehicle: " in str(refusal)
        refusal = await refusal_of_start(rig, "fence_crossed")
        (reason,) = refusal.reasons
        assert "at item 2, " in reason
        assert "m along its path" in reason
        assert "of vehicle 1 (item " in reason
        assert "Required: 5 m plus 1.9 m of margin." in reason
        assert await separation_warnings(rig) == [("separation", 1)]
        await until(lambda: not rig.first.status.armed, 60)
        await start(rig, "2", "fence_crossed")
        assert rig.second.status.armed

    run_with_two_vehicles(run_simulated, scenario)


def test_the_second_of_two_simultaneous_starts_is_refused_because_of_the_first_and_can_be_accepted(
    run_simulated,
):
    async def scenario(rig):
        await upload(rig, "1", TAKE_OFF_AND_LAND)
        await upload(rig, "2", {"items": ITEMS_OVER_VEHICLE_1})
        results = await asyncio.gather(start(rig, "1"), start(rig, "2"), return_exceptions=True)
        assert results[0] is None
        assert results[1].codes == ("separation",)
        assert not rig.second.status.armed
        await start(rig, "2", "separation")
        assert (rig.second.status.armed, rig.second.status.mode) == (True, "mission")

    run_with_two_vehicles(run_simulated, scenario)


def test_later_starts_are_not_compared_with_a_failed_start(run_simulated):
    async def scenario(rig):
        await upload(rig, "1", TAKE_OFF_AND_LAND)
        await upload(rig, "2", {"items": ITEMS_OVER_VEHICLE_1})
        rig.first.command.start_mission = None  # its call raises TypeError
        with pytest.raises(GcsError, match="TypeError"):
            await start(rig, "1")
        await start(rig, "2")
        assert rig.second.status.armed

    run_with_two_vehicles(run_simulated, scenario)


@pytest.mark.story
def test_a_check_near_an_unknown_path_gives_a_warning_and_a_start_over_a_hovering_vehicle_is_refused(
    run_simulated,
):
    async def scenario(rig):
        await upload(rig, "2", {"items": ITEMS_OVER_VEHICLE_1})
        await rig.first.command.takeoff(6.0)
        await sleep(4)
        assert await separation_warnings(rig, {"items": ITEMS_OVER_VEHICLE_1}) == [
            ("separation_unknown", None)
        ]
        await until(lambda: rig.first.status.mode == "hold", 40)
        await sleep(2)
        refusal = await refusal_of_start(rig)
        assert "of vehicle 1 (hovering)" in refusal.reasons[0]
        assert "The time of vehicle 1 at this position is not known." in refusal.reasons[0]

    run_with_two_vehicles(run_simulated, scenario)


HOLD_STEP = "- {step: hold, duration_s: 30}\n"
FLY_OVER_VEHICLE_1 = "- {step: fly, points: [{offset_ned_m: [0, -80, -6]}]}\n"


async def start_mission(rig, vehicle_id, steps, *despite):
    mission = read(f"name: Up\nsteps:\n- {{step: take_off, height_m: 6}}\n{steps}- {{step: land}}\n")
    fields = {"mission": json.loads(document.write(mission)), "despite": list(despite)}
    body = offboard_mission_models.StartMission.model_validate(fields)
    await offboard_mission_routes.start(vehicle_id, body, rig.station, ANNA)


def test_an_offboard_mission_that_comes_too_near_is_refused_and_can_be_accepted(run_simulated):
    async def scenario(rig):
        await upload(rig, "1", TAKE_OFF_AND_LAND)
        await start(rig, "1")
        with pytest.raises(PlanFindings) as caught:
            await start_mission(rig, "2", FLY_OVER_VEHICLE_1)
        assert caught.value.codes == ("separation",)
        (reason,) = caught.value.reasons
        assert reason.startswith("step 2: ")
        assert "of vehicle 1 (item " in reason
        await sleep(1.0)
        assert not rig.second.status.armed
        await start_mission(rig, "2", FLY_OVER_VEHICLE_1, "separation")
        await until(lambda: rig.second.status.armed, 10)

    run_with_two_vehicles(run_simulated, scenario)


def test_the_second_of_two_offboard_missions_started_at_the_same_time_is_refused_because_of_the_first(
    run_simulated,
):
    async def scenario(rig):
        missions = (start_mission(rig, "1", HOLD_STEP), start_mission(rig, "2", FLY_OVER_VEHICLE_1))
        results = await asyncio.gather(*missions, return_exceptions=True)
        assert results[0] is None
        assert results[1].codes == ("separation",)
        await sleep(1.0)
        assert not rig.second.status.armed

    run_with_two_vehicles(run_simulated, scenario)


def test_the_paths_of_other_vehicles_are_predicted_outside_the_event_loop(run_simulated, monkeypatch):
    outside_loop = record_calls(monkeypatch, traffic, "stationary_path")
    flown_plans = record_calls(monkeypatch, waypoint_flight, "predict_plan")
    flown_missions = record_calls(monkeypatch, missions_in_flight, "predict_timeline")

    async def scenario(rig):
        await start_mission(rig, "1", HOLD_STEP)
        body = {"plan": {"items": ITEMS_OVER_VEHICLE_1}, "vehicle": "2"}
        await plan_routes.check_plan(plan_models.PlanToCheck.model_validate(body), rig.station)
        assert flown_missions
        assert all(outside_loop + flown_plans + flown_missions)

    run_with_two_vehicles(run_simulated, scenario)


def test_an_offboard_mission_in_flight_is_compared_along_its_steps(run_simulated):
    async def scenario(rig):
        await upload(rig, "2", {"items": ITEMS_OVER_VEHICLE_1})
        await start_mission(rig, "1", HOLD_STEP)
        refusal = await refusal_of_start(rig)
        assert refusal.codes == ("separation",)
        assert "of vehicle 1 (step " in refusal.reasons[0]

    run_with_two_vehicles(run_simulated, scenario)
