"""A plan with fence and rally point is uploaded to the simulated PX4, flown, paused, resumed, and started at
an item."""

from typing import Any

import pytest

from gcs_server.errors import PlanFindings, Rejected
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats.mavlink_items import fence_items, mission_items, rally_items
from missions.geodesy import distance_m
from missions.items import ReturnHome
from missions.values import Altitude, FenceCircle, Point, RallyPoint
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, both_versions, until
from tests.protocol.small_plan import ALTITUDE, plan_around
from vehicle_sim.px4_version import V1_17, Px4Version

DEG_PER_M = 1 / 111_195
"""Degrees of latitude per metre."""
FENCE_RADIUS_M = 40.0
LOW_RETURN = {"RTL_RETURN_ALT": 8, "RTL_DESCEND_ALT": 8, "RTL_TYPE": 0}


@both_versions
def test_a_vehicle_flies_an_uploaded_plan_pauses_resumes_and_returns_to_the_rally_point(
    run_simulated: Any, px4: Px4Version
) -> None:
    async def scenario() -> None:
        testbed = SimulatedTestbed(parameters=LOW_RETURN, px4=px4)
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            home = vehicle.topic("home").value
            rally = RallyPoint(lat_deg=home.lat_deg + 18 * DEG_PER_M, lon_deg=home.lon_deg, altitude=ALTITUDE)
            plan = plan_around(home.lat_deg, home.lon_deg)
            takeoff, north, *_ = plan.items
            north = north.model_copy(
                update={"lat_deg": rally.lat_deg, "altitude": Altitude(value_m=8.0, reference="home")}
            )
            center = Point(lat_deg=home.lat_deg, lon_deg=home.lon_deg)
            fence = FenceCircle(inclusion=True, center=center, radius_m=FENCE_RADIUS_M)
            plan = plan.model_copy(
                update={"items": (takeoff, north, ReturnHome()), "fence": (fence,), "rally_points": (rally,)}
            )
            parts = {"mission": mission_items(plan), "fence": fence_items(plan), "rally": rally_items(plan)}
            uploaded = await vehicle.mission.upload(parts, PlanReference("a", 1, "To the rally point"))
            assert (vehicle.mission.plan_on_vehicle(), uploaded.not_kept) == ("plan", [])
            await vehicle.command.start_mission()
            assert (vehicle.status.armed, vehicle.status.mode) == (True, "mission")

            def current_item() -> int:
                return vehicle.topic("mission").value.current

            await until(lambda: current_item() == 1, 40)
            await sleep(1)
            await vehicle.command.hold()
            await sleep(3)
            assert (current_item(), vehicle.status.mode) == (1, "hold")
            outside_lat_deg = home.lat_deg + (FENCE_RADIUS_M + 10) * DEG_PER_M
            outside = {"lat_deg": outside_lat_deg, "lon_deg": home.lon_deg, "alt_home_m": 8.0}
            with pytest.raises(PlanFindings, match="leaves the vehicle's geofence"):
                await vehicle.guided.goto(**outside)
            with pytest.raises(Rejected, match="outside geofence"):  # accepted by the caller, but not by PX4
                await vehicle.guided.goto(**outside, despite=["fence_violation"])
            await vehicle.command.set_mode("mission")
            await until(lambda: (vehicle.topic("mission").value.reached or 0) >= 1, 40)
            await until(lambda: vehicle.status.mode == ("rtl" if px4 is V1_17 else "mission"), 10)
            await until(lambda: not vehicle.status.armed, 90)
            position = vehicle.topic("global_position").value
            assert distance_m(position.lat_deg, position.lon_deg, rally.lat_deg, rally.lon_deg) < 2.5
            assert vehicle.mission.plan_on_vehicle() == "plan"
            await vehicle.mission.set_current(1)
            assert current_item() == 1
        finally:
            await testbed.close()

    run_simulated(scenario)
