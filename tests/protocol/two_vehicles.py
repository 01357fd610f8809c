"""Two simulated PX4 vehicles beside each other, and the server's routes, on simulated time."""

import functools
from types import SimpleNamespace

from tests.protocol.api_calls import InlinePlanWork, new_station
from tests.protocol.simulated_testbed import SimulatedTestbed
from tests.support.ready_fleet import row_of_ready_vehicles
from tests.support.snapshot import snapshot

cached_ready_fleet = functools.cache(row_of_ready_vehicles)


def run_with_two_vehicles(run_simulated, scenario, apart_m):
    """Runs a test with vehicle 2 this far east of vehicle 1; both can be armed."""

    async def run():
        testbed = SimulatedTestbed(2, sim=snapshot(cached_ready_fleet(2, apart_m)))
        try:
            vehicles = [await testbed.wait_for_vehicle_ready_to_arm(vehicle_id) for vehicle_id in ("1", "2")]
            station = new_station(testbed)
            station.flights.plan_work = InlinePlanWork()
            for vehicle in vehicles:
                station.flights.missions.attach(vehicle)
            station.flights.waypoint_flights.start()
            station.flights.missions.start()
            station.authority.start()
            first, second = vehicles
            await scenario(
                SimpleNamespace(
                    testbed=testbed, station=station, vehicles=vehicles, first=first, second=second
                )
            )
        finally:
            await testbed.close()

    run_simulated(run)
