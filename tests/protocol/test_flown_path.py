"""The flown path of an offboard mission compared with its plan, by the server's route."""

import math
from types import SimpleNamespace

import pytest

from gcs_server.api import offboard_mission_models as models
from gcs_server.api import offboard_mission_routes as routes
from gcs_server.errors import Refused
from tests.protocol.api_calls import json_of, run_with_routes
from tests.protocol.mission_flights import MissionsTestbed, run_in_flight
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed
from tests.support.offboard_missions import mission

FLIGHT = """
- {step: take_off, height_m: 5}
- {step: fly, points: [{offset_ned_m: [25, 0, -5]}, {offset_ned_m: [25, 20, -5]}], speed_m_s: 4}
- {step: land}
"""
HOVER = "- {step: hold, duration_s: 120}\n"


async def flown_path(missions, vehicle):
    """The flown path in the response of the route; the response must match its model."""
    station = SimpleNamespace(flights=SimpleNamespace(missions=missions.offboard))
    response = json_of(await routes.show_flown(vehicle, station))
    models.FlownMissionView.model_validate(response)
    assert response["vehicle"] == vehicle.id
    return response["flown"]


@pytest.mark.story
def test_an_ended_mission_is_compared_with_its_plan(run_simulated, tmp_path):
    async def scenario():
        testbed = SimulatedTestbed()
        missions = MissionsTestbed(testbed, tmp_path)
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            home = vehicle.topic("home").value
            missions.begin(vehicle, mission(FLIGHT))
            await missions.reach("done")
            flown = await flown_path(missions, vehicle)
            await sleep(5)
            assert await flown_path(missions, vehicle) == flown, "samples were recorded after the end"
        finally:
            await testbed.close()

        assert flown["over"]
        # The samples include PX4's take-off and landing and the wait for arming; both durations exclude them.
        assert flown["duration_s"] == pytest.approx(flown["planned_duration_s"], abs=2.0)
        assert flown["samples"][-1]["t_s"] > flown["duration_s"] + 20
        assert flown["planned_by"] == "mission"
        assert flown["planned_length_m"] == pytest.approx(5 + 25 + 20 + 5, abs=2.0)
        assert any(leg["place"] == "step 2" for leg in flown["planned_legs"])
        leg_ends_ned_m = [leg["points"][-1][1:] for leg in flown["planned_legs"]]
        assert any(math.dist(leg_end, (25, 20, -5)) < 1.5 for leg_end in leg_ends_ned_m)
        assert flown["origin"]["lat_deg"] == pytest.approx(home.lat_deg, abs=1e-4)
        assert 0 < flown["battery_end_share"] <= flown["battery_start_share"] <= 1
        streamed = [sample for sample in flown["samples"] if sample["planned_ned_m"] is not None]
        assert {sample["place"] for sample in streamed} == {"step 2"}
        for sample in streamed:
            distance_m = math.dist(sample["flown_ned_m"], sample["planned_ned_m"])
            assert sample["deviation_m"] == pytest.approx(distance_m, abs=0.01)
        assert flown["deviation_max_m"] == max(sample["deviation_m"] for sample in streamed)

    run_simulated(scenario)


def test_the_flown_path_is_shown_in_flight_and_its_duration_stays_the_same_after_an_abort(
    run_simulated, tmp_path
):
    async def scenario(missions, vehicle, autopilot):
        first_view = await flown_path(missions, vehicle)
        await sleep(5)
        later_view = await flown_path(missions, vehicle)
        assert (first_view["over"], later_view["over"]) == (False, False)
        assert later_view["duration_s"] == pytest.approx(first_view["duration_s"] + 5, abs=0.2)
        assert later_view["started_unix_s"] == missions.flight.status().started_unix_s
        missions.flight.abort("Alice", "hold")
        ended_view = await flown_path(missions, vehicle)
        await sleep(5)
        assert ended_view["over"]
        assert (await flown_path(missions, vehicle))["duration_s"] == ended_view["duration_s"]

    run_in_flight(run_simulated, tmp_path, mission(HOVER), scenario)


def test_a_vehicle_without_an_offboard_mission_has_no_flown_path(run_simulated):
    async def scenario(rig):
        with pytest.raises(Refused, match="no offboard mission"):
            await routes.show_flown(rig.vehicle, rig.station)

    run_with_routes(run_simulated, scenario)
