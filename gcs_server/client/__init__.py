"""The Python client. It uses httpx and websockets, and no other module of this project.

    async with Gcs() as gcs:
        drone = await gcs.wait_for_vehicle(ready=True)
        async with drone.offboard() as offboard:
            await drone.arm()
            await offboard.position_ned(0, 0, -5)

`SyncGcs` has the same calls without `await`.
"""

from gcs_server.client import setpoints
from gcs_server.client.aio import Gcs, Group, Vehicle
from gcs_server.client.blocking import (
    SyncControl,
    SyncDryRuns,
    SyncFiles,
    SyncFlights,
    SyncGcs,
    SyncGimbal,
    SyncGroup,
    SyncLiveOffboard,
    SyncLogStream,
    SyncMission,
    SyncMissionModes,
    SyncOffboard,
    SyncOffboardMission,
    SyncOperations,
    SyncParams,
    SyncPlans,
    SyncSticks,
    SyncVehicle,
)
from gcs_server.client.control import Control
from gcs_server.client.errors import (
    ApiError,
    Invalid,
    NoReply,
    NotAllowed,
    NotInControl,
    Refused,
    Timeout,
    Unknown,
    Unreachable,
)
from gcs_server.client.flights import Flights, LogStream
from gcs_server.client.manual_control import Sticks
from gcs_server.client.mission import Mission, MissionModes, OffboardMission
from gcs_server.client.offboard import LiveOffboard, Offboard
from gcs_server.client.params import Params
from gcs_server.client.plans import DryRuns, Operations, Plans
from gcs_server.client.vehicle import Gimbal

__all__ = [
    "ApiError",
    "Control",
    "DryRuns",
    "Flights",
    "Gcs",
    "Gimbal",
    "Group",
    "Invalid",
    "LiveOffboard",
    "LogStream",
    "Mission",
    "MissionModes",
    "NoReply",
    "NotAllowed",
    "NotInControl",
    "Offboard",
    "OffboardMission",
    "Operations",
    "Params",
    "Plans",
    "Refused",
    "Sticks",
    "SyncControl",
    "SyncDryRuns",
    "SyncFiles",
    "SyncFlights",
    "SyncGcs",
    "SyncGimbal",
    "SyncGroup",
    "SyncLiveOffboard",
    "SyncLogStream",
    "SyncMission",
    "SyncMissionModes",
    "SyncOffboard",
    "SyncOffboardMission",
    "SyncOperations",
    "SyncParams",
    "SyncPlans",
    "SyncSticks",
    "SyncVehicle",
    "Timeout",
    "Unknown",
    "Unreachable",
    "Vehicle",
    "setpoints",
]
