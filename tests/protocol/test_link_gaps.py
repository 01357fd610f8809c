"""Gaps in the link while the simulated PX4 flies a mission: it goes on from its place, within its limits."""

import math

import pytest

from tests.protocol.mission_flights import MissionsTestbed, event_codes
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed
from tests.support.offboard_missions import mission
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station

SPEED_M_S = 3.0
LINE = "- {step: fly, points: [{offset_ned_m: [30, 0, 0]}], speed_m_s: 3}\n"


async def fastest_m_s(vehicle, for_s):
    """The highest reported speed of the next seconds."""
    fastest = 0.0
    for _ in range(int(for_s * 10)):
        await sleep(0.1)
        fastest = max(fastest, math.hypot(*vehicle.topic("local_position").value.velocity_ned_m_s))
    return fastest


GAPS = [
    pytest.param(3.3, True, id="both ways for 3.3 s"),
    pytest.param(3.3, False, id="to the vehicle for 3.3 s", marks=pytest.mark.broad),
    pytest.param(2.0, True, id="both ways for 2 s", marks=pytest.mark.broad),
    pytest.param(6.0, False, id="to the vehicle for 6 s", marks=pytest.mark.broad),
]


@pytest.mark.parametrize(("gap_s", "both_ways"), GAPS)
def test_after_a_link_gap_the_mission_goes_on_from_the_vehicle_within_its_speed(
    run_simulated, tmp_path, gap_s, both_ways
):
    async def scenario():
        testbed = SimulatedTestbed(sim=station_in_hover(Station, 10.0, links=(("gcs", "gcs"),)).sim)
        missions = MissionsTestbed(testbed, tmp_path)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            missions.begin(vehicle, mission(LINE), in_air=True)
            await missions.reach("flying")
            await sleep(4)
            testbed.loss = 1.0 if both_ways else 0.0
            testbed.loss_to_vehicle = 1.0
            await sleep(gap_s)
            assert gap_s < 3.0 or missions.state == "not_following"
            testbed.loss = testbed.loss_to_vehicle = 0.0
            assert await fastest_m_s(vehicle, 6.0) < SPEED_M_S * 1.2
            assert missions.state == "flying"
            assert ("follows_again" in event_codes(vehicle)) == (gap_s > 3.0)
            await missions.reach("done")
        finally:
            await testbed.close()

    run_simulated(scenario)
