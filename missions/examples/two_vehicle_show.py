"""Two vehicles that fly one mission together: `python -m missions.examples.two_vehicle_show`.

The first and the last vehicle of the ground station fly the mission. They must be at least 7 m apart, as with
`gcs --sim 4`.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

from gcs_server.client import Gcs, Vehicle
from missions.examples.arguments import parse
from missions.examples.fly_document import follow

DOCUMENT = "two_vehicle_show.yaml"


async def fly(server: str) -> None:
    """Waits until both vehicles are ready, flies the mission, and returns once both vehicles are disarmed.

    Raises:
        SystemExit: the mission ended early on one of the two vehicles.
    """
    async with Gcs(server, client="two_vehicle_show") as gcs:
        await gcs.wait_for_vehicle(ready=True)
        vehicles = await gcs.vehicles()
        lead, left = vehicles[0], vehicles[-1]
        if lead.id == left.id:
            raise SystemExit("Two vehicles are needed, and only one is connected.")
        for vehicle in (lead, left):
            await gcs.wait_for_vehicle(vehicle.id, ready=True)
        text = (Path(__file__).parent / DOCUMENT).read_bytes()
        mission = (await gcs.plans().read_file(text, DOCUMENT))["plan"]
        started = await gcs.start_together({"lead": lead.id, "left": left.id}, mission)
        for each in started:
            mission = each["mission"]
            print(f"Vehicle {each['vehicle']} flies the role {mission['role']!r} of {mission['name']!r}.")
        await asyncio.gather(*(_until_end(vehicle) for vehicle in (lead, left)))
    print("Landed and disarmed.")


async def _until_end(vehicle: Vehicle) -> None:
    ended = await follow(vehicle, yes=False)
    if ended["state"] != "done":
        raise SystemExit(f"The mission of vehicle {vehicle.id} is {ended['state']}: {ended['reason']}")
    await vehicle.until_disarmed()


if __name__ == "__main__":
    asyncio.run(fly(parse("Fly a show of two vehicles, and land.").server))
