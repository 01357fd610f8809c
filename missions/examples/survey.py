"""Survey a field north of home with a camera, flown by PX4: `python -m missions.examples.survey`.

The server computes the survey lines from the area, camera and overlaps. The program uploads the plan and
starts it.
"""

from __future__ import annotations

import asyncio
import math
from typing import Any

from gcs_server.client import Gcs, Vehicle
from missions.examples.arguments import parse

METRES_PER_DEGREE = 111_195.0
WIDTH_M, DEPTH_M, HEIGHT_M = 60.0, 40.0, 25.0
NORTH_OF_HOME_M = 10.0
CAMERA = {
    "sensor_width_mm": 13.2,
    "sensor_height_mm": 8.8,
    "focal_length_mm": 8.8,
    "image_width_px": 5472,
    "image_height_px": 3648,
}
TIMEOUT_S = 600.0


async def fly(server: str, vehicle: str | None) -> None:
    """Waits until the vehicle is ready, flies the plan, and returns once the vehicle is disarmed."""
    async with Gcs(server, client="survey") as gcs:
        drone = await gcs.wait_for_vehicle(vehicle, ready=True)
        plan = await make_plan(gcs, drone)
        await drone.mission.upload(plan)
        print(f"Uploaded and verified: {len(plan['items'])} items.")
        await drone.mission.start()
        await follow(drone)
    print("Landed and disarmed.")


async def make_plan(gcs: Gcs, drone: Vehicle) -> dict[str, Any]:
    """A plan with a take-off, the survey lines over the field, and a landing at home."""
    home = await drone.topic("home")
    assert home is not None, "a vehicle that is ready has a home"
    lat, lon = home["lat_deg"], home["lon_deg"]
    altitude = {"value_m": HEIGHT_M, "reference": "home"}
    south_and_north_deg = [
        lat + metres / METRES_PER_DEGREE for metres in (NORTH_OF_HOME_M, NORTH_OF_HOME_M + DEPTH_M)
    ]
    half_deg = WIDTH_M / 2 / (METRES_PER_DEGREE * math.cos(math.radians(lat)))
    corners = [
        (south_and_north_deg[0], -half_deg),
        (south_and_north_deg[0], half_deg),
        (south_and_north_deg[1], half_deg),
        (south_and_north_deg[1], -half_deg),
    ]
    pattern = await gcs.plans().pattern(
        "survey",
        outer=[{"lat_deg": corner_lat, "lon_deg": lon + east} for corner_lat, east in corners],
        coverage={"camera": CAMERA, "distance_m": HEIGHT_M},
        altitude=altitude,
    )
    figures = pattern["figures"]
    print(f"{figures['photos']} photos on {figures['lines_length_m']:.0f} m.")
    home_position = {"lat_deg": lat, "lon_deg": lon}
    takeoff = {"kind": "takeoff", **home_position, "altitude": altitude}
    landing = {"kind": "land", **home_position, "altitude": {"value_m": 0.0, "reference": "home"}}
    return {**pattern["plan"], "items": [takeoff, *pattern["plan"]["items"], landing]}


async def follow(drone: Vehicle) -> None:
    """Prints each item when the vehicle reaches it, until the motors have stopped."""
    printed_item = None

    def landed(vehicle: dict[str, Any]) -> bool:
        nonlocal printed_item
        mission = (vehicle["topics"].get("mission") or {"value": None})["value"]
        if mission is not None and mission["current"] != printed_item:
            printed_item = mission["current"]
            print(f"Item {printed_item + 1} of {mission['count']}")
        return not vehicle["status"]["armed"]

    await drone.until(landed, timeout_s=TIMEOUT_S, what="the end of the survey")


if __name__ == "__main__":
    arguments = parse("Survey a field of 60 m by 40 m north of home, and land.")
    asyncio.run(fly(arguments.server, arguments.vehicle))
