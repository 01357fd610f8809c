"""Offboard in ten lines: arm, climb to 5 m with the nose to the east, land, end disarmed."""

from __future__ import annotations

import argparse
import math

from gcs_server.client import SyncGcs

UP_5_M = (0.0, 0.0, -5.0)
EAST_RAD = math.radians(90)


def fly(server: str, vehicle: str | None) -> None:
    """The whole flight; whatever is refused ends it with the vehicle's own reason."""
    with SyncGcs(server, client="first_flight") as gcs:
        drone = gcs.wait_for_vehicle(vehicle, ready=True, timeout_s=60)
        with drone.offboard(position_ned_m=UP_5_M, yaw_ned_rad=EAST_RAD, valid_for_s=5) as stream:
            print("If this program dies:", "hold, then Hold mode. If the stream stops:")
            print(" ", stream.started["if_stream_stops"])
            drone.arm()
            reached = stream.fly_to(*UP_5_M, yaw_ned_rad=EAST_RAD, within_m=0.3)
            print(f"At {-reached['position_ned_m'][2]:.1f} m; landing.")
            drone.land()
        drone.wait_until_disarmed()
        print("Landed and disarmed.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--server", default="http://localhost:8080", help="the ground station's address")
    parser.add_argument("--vehicle", default=None, help="the vehicle's id; the first one unless given")
    arguments = parser.parse_args()
    fly(arguments.server, arguments.vehicle)
