"""The example programs as scenarios fly them: each coroutine is the `python` of a scenario in this folder."""

from __future__ import annotations

import asyncio

from gcs_server.client import Vehicle
from gcs_server.scenarios.station import Station
from missions.examples import first_flight as first
from missions.examples import obstacle_flight as obstacle

CORNERS_NE_M = ((0.0, 0.0), (12.0, 0.0), (12.0, 12.0), (0.0, 12.0), (0.0, 0.0))
HEIGHT_M = 6.0
AT_A_CORNER_S = 6.0
PERIOD_S = 0.1


async def first_flight(station: Station) -> None:
    """Up 5 m, and down."""
    await first.fly(station.url, "1")


async def obstacle_flight(station: Station) -> None:
    """Over a box to the place behind it."""
    await obstacle.fly(station.url, "1", avoid=True)


async def square(vehicle: Vehicle) -> None:
    """Four corners, and down."""
    await vehicle.takeoff(HEIGHT_M)
    await vehicle.until(lambda v: v["status"]["mode"] == "hold", what="the end of the take-off")
    async with vehicle.offboard(position_ned_m=(0.0, 0.0, -HEIGHT_M), valid_for_s=0.5) as offboard:
        for north_m, east_m in CORNERS_NE_M:
            for _ in range(round(AT_A_CORNER_S / PERIOD_S)):
                await offboard.position_ned(north_m, east_m, -HEIGHT_M)
                await asyncio.sleep(PERIOD_S)
    await vehicle.land()
    await vehicle.until_disarmed()
