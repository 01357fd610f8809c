"""Stream for a second, Offboard, arm, hover 1 m up until 21 s after the start, land, end disarmed."""

from __future__ import annotations

import argparse
import time

from gcs_server.client import SyncGcs

UP_1_M = (0.0, 0.0, -1.0)
HOVER_UNTIL_S = 21.0


def fly(server: str, vehicle: str | None) -> None:
    """The whole flight; whatever is refused ends it with the vehicle's own reason."""
    with SyncGcs(server, client="hover_and_land") as gcs:
        drone = gcs.wait_for_vehicle(vehicle, ready=True, timeout_s=60)
        began_s = time.monotonic()
        with drone.offboard(position_ned_m=UP_1_M, rate_hz=10, valid_for_s=5) as stream:
            drone.arm()
            stream.stay(*UP_1_M, for_s=HOVER_UNTIL_S - (time.monotonic() - began_s))
            local = drone.value("local_position")
            assert local is not None
            print(
                f"At {-local['position_ned_m'][2]:.2f} m after {time.monotonic() - began_s:.0f} s; landing."
            )
            drone.land()
        drone.wait_until_disarmed()
        print("Landed and disarmed.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--server", default="http://localhost:8080", help="the ground station's address")
    parser.add_argument("--vehicle", default=None, help="the vehicle's id; the first one unless given")
    arguments = parser.parse_args()
    fly(arguments.server, arguments.vehicle)
