"""Registers offboard missions with PX4 as flight modes, which all ground stations can select."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs_server.client.control import VehicleApi
from gcs_server.client.offboard_mission import start_body
from gcs_server.client.plans import Plan


class MissionModes:
    """The offboard missions that this server has registered as flight modes of a vehicle.

    The server must be connected to the vehicle over ROS 2. `vehicle.set_mode(mode["mode"])`, another ground
    station or an RC transmitter selects a mode. A mission that begins with a take-off starts when the vehicle
    is armed in the mode; any other mission starts when the mode is selected in the air. The server
    unregisters its modes when it is shut down.
    """

    def __init__(self, vehicle: VehicleApi) -> None:
        self._vehicle = vehicle

    async def all(self) -> list[dict[str, Any]]:
        """The modes: `name`, `state`, `mode` (as in the vehicle's status), `mission`, …"""
        return (await self._vehicle.request("GET", "/mission_modes"))["modes"]

    async def register(
        self,
        name: str,
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        despite: Sequence[str] = (),
        defer_failsafes_s: int = 0,
    ) -> dict[str, Any]:
        """Registers a mission (a document, or one stored on the server) under this name; returns the mode
        once PX4 can select it.

        With `defer_failsafes_s` PX4 defers its reaction to a lost ground station connection, lost manual
        control or a low battery by up to this time, while the vehicle flies in the mode.

        Raises:
            Refused: the server has no ROS 2 connection to the vehicle, PX4 refuses the mode, the mission has
                errors that `despite` does not list, or the vehicle has a mode of this name.
        """
        deferral = {"defer_failsafes_s": defer_failsafes_s} if defer_failsafes_s else {}
        body = start_body(mission, plan_id, version, despite, name=name, **deferral)
        modes = (await self._vehicle.request("POST", "/mission_modes/register", body))["modes"]
        return next(mode for mode in modes if mode["name"] == name)

    async def unregister(self, name: str) -> list[dict[str, Any]]:
        """Removes a mode; returns the remaining modes.

        Raises:
            Refused: there is no such mode, or the vehicle flies in it.
        """
        return (await self._vehicle.request("POST", "/mission_modes/unregister", {"name": name}))["modes"]
