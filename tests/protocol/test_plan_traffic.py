"""The start of a waypoint plan is compared with what the other vehicles fly, on simulated time."""

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
from gcs_server.errors import PlanFindings
from missions.geodesy import LocalOrigin
from missions.offboard import document
from missions.offboard.reader import read
from tests.protocol import two_vehicles
from tests.protocol.api_calls import ANNA, view
from tests.protocol.offboard_world import seconds
from tests.protocol.simulated_world import until

ORIGIN = LocalOrigin(47.397742, 8.545594, 488.0)
APART_M = 40.0
"""Vehicle 2 stands this far east of vehicle 1."""


def item_at(kind, east_m, alt_m, **more):
    lat, lon, _ = ORIGIN.to_geodetic((0.0, east_m, 0.0))
    altitude = {"value_m": alt_m, "reference": "home"}
    return {"kind": kind, "lat_deg": lat, "lon_deg": lon, "altitude": altitude, **more}


HOP = {"items": [item_at("takeoff", 0, 2.5), item_at("land", 0, 0)]}
"""Vehicle 1 above its own position."""
OVER = [item_at("takeoff", APART_M, 6), item_at("waypoint", -APART_M, 6), item_at("land", -APART_M, 0)]
ZONE = {
    "shape": "circle",
    "inclusion": False,
    "center": {key: item_at("waypoint", 20, 0)[key] for key in ("lat_deg", "lon_deg")},
    "radius_m": 5,
}
ACROSS = {"items": OVER, "fence": [ZONE]}
"""Vehicle 2 over the position of vehicle 1, through an area that it must not fly in."""


run_with_two_vehicles = functools.partial(two_vehicles.run_with_two_vehicles, apart_m=APART_M)


async def upload(rig, vehicle_id, plan):
    body = mission_models.UploadRequest.model_validate({"plan": plan, "wait": True})
    await mission_routes.upload(vehicle_id, body, rig.station, ANNA)
    await seconds(1.2)


async def start(rig, vehicle_id, *despite, item=0):
    body = mission_models.StartRequest.model_validate({"item": item, "despite": list(despite)})
    await mission_routes.start(vehicle_id, rig.station, ANNA, body)


async def refused(rig, *despite):
    """The refusal of the start of vehicle 2."""
    with pytest.raises(PlanFindings) as caught:
        await start(rig, "2", *despite)
    assert not rig.two.status.armed
    assert rig.two.status.mode != "mission"
    return caught.value


async def warnings_of_check(rig, plan=ACROSS):
    body = plan_models.PlanToCheck.model_validate({"plan": plan, "vehicle": "2"})
    answer = view(await plan_routes.check_plan(body, rig.station))
    plan_models.PlanCheck.model_validate(answer)
    found = [each for each in answer["findings"] if each["code"].startswith("separation")]
    assert {each["severity"] for each in found} <= {"warning"}
    return [(each["code"], each["place"]["row"]) for each in found]


def test_a_start_over_another_flight_is_refused_with_all_findings_until_the_other_has_landed(jump):
    async def scenario(rig):
        await upload(rig, "1", HOP)
        await upload(rig, "2", ACROSS)
        assert await warnings_of_check(rig) == []
        await start(rig, "1")
        both = await refused(rig)
        assert both.codes == ("fence_crossed", "separation")
        assert "The plan on vehicle 2 has errors: " in str(both)
        assert "Vehicle 2 may come too near to another vehicle: " in str(both)
        near = await refused(rig, "fence_crossed")
        (text,) = near.reasons
        assert "at item 2, " in text
        assert "m along its path" in text
        assert "of vehicle 1 (item " in text
        assert "Required: 5 m plus 1.9 m of margin." in text
        assert await warnings_of_check(rig) == [("separation", 1)]
        await until(lambda: not rig.one.status.armed, 60)
        await start(rig, "2", "fence_crossed")
        assert rig.two.status.armed

    run_with_two_vehicles(jump, scenario)


def test_of_two_starts_at_the_same_time_the_second_is_compared_with_the_first_and_can_be_accepted(jump):
    async def scenario(rig):
        await upload(rig, "1", HOP)
        await upload(rig, "2", {"items": OVER})
        answers = await asyncio.gather(start(rig, "1"), start(rig, "2"), return_exceptions=True)
        assert answers[0] is None
        assert answers[1].codes == ("separation",)
        assert not rig.two.status.armed
        await start(rig, "2", "separation")
        assert (rig.two.status.armed, rig.two.status.mode) == (True, "mission")

    run_with_two_vehicles(jump, scenario)


def test_later_starts_are_not_compared_with_a_failed_start(jump):
    async def scenario(rig):
        await upload(rig, "1", HOP)
        await upload(rig, "2", {"items": OVER})
        rig.one.command.start_mission = None  # fails
        with pytest.raises(TypeError):
            await start(rig, "1")
        await start(rig, "2")
        assert rig.two.status.armed

    run_with_two_vehicles(jump, scenario)


@pytest.mark.story
def test_a_start_is_refused_over_a_hovering_vehicle_and_warned_about_one_whose_path_is_unknown(jump):
    async def scenario(rig):
        await upload(rig, "2", {"items": OVER})
        await rig.one.command.takeoff(6.0)
        await seconds(4)
        assert await warnings_of_check(rig, {"items": OVER}) == [("separation_unknown", None)]
        await until(lambda: rig.one.status.mode == "hold", 40)
        await seconds(2)
        found = await refused(rig)
        assert "of vehicle 1 (hovering)" in found.reasons[0]
        assert "The time of vehicle 1 at this position is not known." in found.reasons[0]

    run_with_two_vehicles(jump, scenario)


UP_THERE = "- {step: hold, duration_s: 30}\n"
OVER_THERE = "- {step: fly, points: [{offset_ned_m: [0, -80, -6]}]}\n"


async def start_mission(rig, vehicle_id, steps, *despite):
    mission = read(f"name: Up\nsteps:\n- {{step: take_off, height_m: 6}}\n{steps}- {{step: land}}\n")
    wanted = {"mission": json.loads(document.write(mission)), "despite": list(despite)}
    body = offboard_mission_models.StartMission.model_validate(wanted)
    await offboard_mission_routes.start(vehicle_id, body, rig.station, ANNA)


def test_an_offboard_mission_is_refused_where_it_comes_too_near_and_can_be_accepted(jump):
    async def scenario(rig):
        await upload(rig, "1", HOP)
        await start(rig, "1")
        with pytest.raises(PlanFindings) as caught:
            await start_mission(rig, "2", OVER_THERE)
        assert caught.value.codes == ("separation",)
        (text,) = caught.value.reasons
        assert text.startswith("step 2: ")
        assert "of vehicle 1 (item " in text
        await seconds(1.0)
        assert not rig.two.status.armed
        await start_mission(rig, "2", OVER_THERE, "separation")
        await until(lambda: rig.two.status.armed, 10)

    run_with_two_vehicles(jump, scenario)


def test_of_two_offboard_missions_started_at_the_same_time_the_second_is_compared_with_the_first(jump):
    async def scenario(rig):
        missions = (start_mission(rig, "1", UP_THERE), start_mission(rig, "2", OVER_THERE))
        answers = await asyncio.gather(*missions, return_exceptions=True)
        assert answers[0] is None
        assert answers[1].codes == ("separation",)
        await seconds(1.0)
        assert not rig.two.status.armed

    run_with_two_vehicles(jump, scenario)


def test_an_offboard_mission_in_flight_is_compared_along_its_steps(jump):
    async def scenario(rig):
        await upload(rig, "2", {"items": OVER})
        await start_mission(rig, "1", UP_THERE)
        found = await refused(rig)
        assert found.codes == ("separation",)
        assert "of vehicle 1 (step " in found.reasons[0]

    run_with_two_vehicles(jump, scenario)
