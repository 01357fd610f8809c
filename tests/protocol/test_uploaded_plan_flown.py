"""A plan is uploaded to the simulated PX4, flown, paused, resumed, and started at an item."""

from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats.mavlink_items import fence_items, mission_items, rally_items
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.protocol.small_plan import plan_around


def test_a_vehicle_flies_an_uploaded_plan_pauses_resumes_and_lands(run_simulated):
    async def scenario():
        testbed = SimulatedTestbed()
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            home = vehicle.topic("home").value
            plan = plan_around(home.lat_deg, home.lon_deg)
            parts = {"mission": mission_items(plan), "fence": fence_items(plan), "rally": rally_items(plan)}
            uploaded = await vehicle.mission.upload(parts, PlanReference("a", 1, "Out and back"))
            assert (vehicle.mission.plan_on_vehicle(), uploaded.not_kept) == ("plan", [])
            await vehicle.command.start_mission()
            assert (vehicle.status.armed, vehicle.status.mode) == (True, "mission")

            def current_item():
                return vehicle.topic("mission").value.current

            await until(lambda: current_item() == 1, 40)
            await sleep(1)
            await vehicle.command.hold()
            await sleep(3)
            assert (current_item(), vehicle.status.mode) == (1, "hold")
            await vehicle.command.set_mode("mission")
            await until(lambda: current_item() == 2, 40)
            assert vehicle.topic("mission").value.reached == 1
            await until(lambda: not vehicle.status.armed, 90)
            assert vehicle.topic("global_position").value.alt_home_m < 1.0
            assert vehicle.mission.plan_on_vehicle() == "plan"
            await vehicle.mission.set_current(2)
            assert current_item() == 2
        finally:
            await testbed.close()

    run_simulated(scenario)
