"""Restarts a vehicle's autopilot (MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN), disarmed only.

PX4 in simulation denies it; a restarted PX4 is silent for some seconds. A request that arrives twice restarts
the vehicle at most twice, on the ground.
"""

from __future__ import annotations

from typing import Final

from gcs_server.errors import Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Goal, Request, Transaction

DEADLINE_S: Final = 3.0
AUTOPILOT: Final = 1.0
"""REBOOT_SHUTDOWN_ACTION_REBOOT."""


class RestartService:
    """Restart of one vehicle."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle

    async def restart(self) -> None:
        """Restarts the autopilot; returns once it has acknowledged, before it is silent.

        Raises:
            Refused: the vehicle is armed.
            Rejected: the vehicle refuses.
            NoReply: no acknowledgement.
        """
        vehicle = self._vehicle
        if vehicle.status.armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed and would lose its autopilot.",
                remedy="Land and disarm first.",
            )
        goal = Goal("restart", lambda _f, _s: False, DEADLINE_S, requested_ids=(), ack_is_enough=True)
        request = Request(d.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (AUTOPILOT, 0, 0, 0, 0, 0, 0))
        try:
            await Transaction(vehicle, request, goal).run()
        except Rejected as error:
            raise Rejected(
                f"Vehicle {vehicle.id} refuses to restart itself.",
                mav_result=error.mav_result,
                reasons=error.reasons,
                remedy="PX4 in simulation always refuses: end it and start it again.",
            ) from None
