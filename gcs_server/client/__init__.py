"""The Python client, asynchronous and plain; needs nothing else of the server's code.

with SyncGcs() as gcs:
    drone = gcs.wait_for_vehicle(ready=True)
    with drone.offboard(position_ned_m=(0, 0, -5)) as stream:
        drone.arm()
        stream.fly_to(0, 0, -5)
        drone.land()
    drone.wait_until_disarmed()
"""

from gcs_server.client.errors import (
    GaveUp,
    GcsClientError,
    Invalid,
    NoReply,
    NotFound,
    Refused,
    RequestFailed,
    Unreachable,
)
from gcs_server.client.gcs import Gcs, Offboard, Vehicle
from gcs_server.client.sync import SyncGcs, SyncOffboard, SyncVehicle

__all__ = [
    "GaveUp",
    "Gcs",
    "GcsClientError",
    "Invalid",
    "NoReply",
    "NotFound",
    "Offboard",
    "Refused",
    "RequestFailed",
    "SyncGcs",
    "SyncOffboard",
    "SyncVehicle",
    "Unreachable",
    "Vehicle",
]
