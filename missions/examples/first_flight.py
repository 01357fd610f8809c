"""Climb to 5 m facing east with offboard setpoints, and land.

`python -m missions.examples.first_flight`. The program sends the position setpoint ten times a second; each
setpoint is valid for half a second. If the program dies, the server holds the vehicle at its position, then
switches it to PX4's Hold mode.
"""

from __future__ import annotations

import asyncio
import math

from gcs_server.client import Gcs, Offboard, Vehicle
from missions.examples.arguments import parse

ABOVE_START_NED_M = (0.0, 0.0, -5.0)
EAST_RAD = math.pi / 2
ARRIVED_M = 0.25


async def fly(server: str, vehicle: str | None) -> None:
    """Waits until the vehicle is ready, flies, and returns once the vehicle is disarmed."""
    async with Gcs(server, client="first_flight") as gcs:
        drone = await gcs.wait_for_vehicle(vehicle, ready=True)
        async with drone.offboard(
            position_ned_m=ABOVE_START_NED_M, yaw_ned_rad=EAST_RAD, valid_for_s=0.5
        ) as offboard:
            print(offboard.started["if_stream_stops"])
            await asyncio.gather(drone.arm(), climb(drone, offboard))
            await drone.land()
        await drone.until_disarmed()
    print("Landed and disarmed.")


async def climb(drone: Vehicle, offboard: Offboard) -> None:
    """Renews the setpoint until the vehicle has reached the position."""
    while (await drone.position_ned_m())[2] > ABOVE_START_NED_M[2] + ARRIVED_M:
        await offboard.position_ned(*ABOVE_START_NED_M, yaw_ned_rad=EAST_RAD)
        await asyncio.sleep(0.1)


if __name__ == "__main__":
    arguments = parse("Arm, climb to 5 m facing east, land.")
    asyncio.run(fly(arguments.server, arguments.vehicle))
