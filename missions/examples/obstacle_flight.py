"""Fly to a position behind an obstacle that the lidar detects.

Start `python -m vehicle_sim --world obstacle-box` and the ground station, then
`python -m missions.examples.obstacle_flight`. With `--off` avoidance is disabled:
the obstacle brake stops the vehicle before the box, and the vehicle lands there after a minute.
"""

from __future__ import annotations

import asyncio
import math

from gcs_server.client import Gcs, Offboard, Vehicle
from missions.examples.arguments import parse

PositionNed = tuple[float, float, float]
ABOVE_START_NED_M: PositionNed = (0.0, 0.0, -1.0)
BEHIND_BOX_NED_M: PositionNed = (10.0, 0.0, -1.0)
ARRIVED_M = 0.4
GIVE_UP_S = 60.0


async def fly(server: str, vehicle: str | None, *, avoid: bool) -> None:
    """Waits until the vehicle is ready, flies, and returns once the vehicle is disarmed."""
    async with Gcs(server, client="obstacle_flight") as gcs:
        drone = await gcs.wait_for_vehicle(vehicle, ready=True)
        await drone.set_obstacle_avoidance(avoid)
        async with drone.offboard(
            position_ned_m=ABOVE_START_NED_M, yaw_ned_rad=0.0, valid_for_s=2.0
        ) as offboard:
            await asyncio.gather(drone.arm(), go_to(drone, offboard, ABOVE_START_NED_M))
            arrived = await go_to(drone, offboard, BEHIND_BOX_NED_M)
            await drone.land()
        await drone.until_disarmed()
        await drone.set_obstacle_avoidance(False)
    print(
        "Landed behind the box and disarmed." if arrived else "Stopped before the box, landed and disarmed."
    )


async def go_to(drone: Vehicle, offboard: Offboard, target_ned_m: PositionNed) -> bool:
    """Renews the setpoint until the vehicle arrives. Returns False if the vehicle has not arrived after a
    minute."""
    printed, began_s = "", asyncio.get_running_loop().time()
    while asyncio.get_running_loop().time() < began_s + GIVE_UP_S:
        status = await offboard.position_ned(*target_ned_m, yaw_ned_rad=0.0)
        if status["avoidance"]["text"] not in ("", printed):
            printed = status["avoidance"]["text"]
            print(printed)
        if math.dist(await drone.position_ned_m(), target_ned_m) < ARRIVED_M:
            return True
        await asyncio.sleep(0.1)
    return False


if __name__ == "__main__":
    arguments = parse("Fly to a position behind an obstacle.", off="fly straight on, without avoidance")
    asyncio.run(fly(arguments.server, arguments.vehicle, avoid=not arguments.off))
