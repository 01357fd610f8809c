"""Fly to a place behind an obstacle, over what the lidar sees: the second document's flight.

Start `python -m vehicle_sim --world obstacle-box` and the ground station, then
`python -m missions.examples.obstacle_flight`. With `--off` it flies straight on: the obstacle brake holds the
vehicle before the box, and after a minute it lands there.
"""

from __future__ import annotations

import asyncio
import math

from gcs_server.client import Gcs, Offboard, Vehicle
from missions.examples.arguments import parse

Place = tuple[float, float, float]
UP_1_M: Place = (0.0, 0.0, -1.0)
BEHIND_THE_BOX: Place = (10.0, 0.0, -1.0)
ARRIVED_M = 0.4
GIVE_UP_S = 60.0


async def fly(server: str, vehicle: str | None, *, avoid: bool) -> None:
    """The flight, from ready to disarmed."""
    async with Gcs(server, client="obstacle_flight") as gcs:
        drone = await gcs.wait_for_vehicle(vehicle, ready=True)
        await drone.set_obstacle_avoidance(avoid)
        async with drone.offboard(position_ned_m=UP_1_M, yaw_ned_rad=0.0, valid_for_s=2.0) as offboard:
            await asyncio.gather(drone.arm(), go_to(drone, offboard, UP_1_M))
            arrived = await go_to(drone, offboard, BEHIND_THE_BOX)
            await drone.land()
        await drone.until_disarmed()
        await drone.set_obstacle_avoidance(False)
    print("Landed behind the box and disarmed." if arrived else "Held before the box, landed and disarmed.")


async def go_to(drone: Vehicle, offboard: Offboard, place: Place) -> bool:
    """Keeps the setpoint alive until the vehicle is there; False: it is not within a minute."""
    told, began_s = "", asyncio.get_running_loop().time()
    while asyncio.get_running_loop().time() < began_s + GIVE_UP_S:
        status = await offboard.position_ned(*place, yaw_ned_rad=0.0)
        if status["avoidance"]["text"] not in ("", told):
            told = status["avoidance"]["text"]
            print(told)
        if math.dist(await drone.position_ned_m(), place) < ARRIVED_M:
            return True
        await asyncio.sleep(0.1)
    return False


if __name__ == "__main__":
    arguments = parse("Fly to a place behind an obstacle.", off="fly straight on, without avoidance")
    asyncio.run(fly(arguments.server, arguments.vehicle, avoid=not arguments.off))
