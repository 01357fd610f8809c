"""Arm, climb to 1 m above the start, and land 21 s after the first setpoint; an example of the blocking
client.

`python -m missions.examples.hover_and_land`
"""

from __future__ import annotations

import time

from gcs_server.client import SyncGcs
from missions.examples.arguments import parse

ABOVE_START_NED_M = (0.0, 0.0, -1.0)
LAND_AFTER_S = 21.0


def fly(server: str, vehicle: str | None) -> None:
    """Waits until the vehicle is ready, flies, and returns once the vehicle is disarmed."""
    with SyncGcs(server, client="hover_and_land") as gcs:
        drone = gcs.wait_for_vehicle(vehicle, ready=True)
        start_s = time.monotonic()
        with drone.offboard(position_ned_m=ABOVE_START_NED_M, valid_for_s=2) as offboard:
            drone.arm()
            while time.monotonic() - start_s < LAND_AFTER_S:
                offboard.position_ned(*ABOVE_START_NED_M)
                time.sleep(0.1)
            drone.land()
        drone.until_disarmed()
    print("Landed and disarmed.")


if __name__ == "__main__":
    arguments = parse("Climb to 1 m, and land after 21 s.")
    fly(arguments.server, arguments.vehicle)
