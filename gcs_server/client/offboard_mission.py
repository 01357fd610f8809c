"""Starts and controls a mission that the server flies by setpoints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs_server.client.control import VehicleApi
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body


class OffboardMission:
    """The offboard mission of a vehicle.

    The mission continues when the program ends. Its document defines the action when no client has control
    (`actions.control_lost`, default `hold`).
    """

    def __init__(self, vehicle: VehicleApi) -> None:
        self._vehicle = vehicle

    async def state(self) -> dict[str, Any] | None:
        """Status of the newest mission (as the topic `offboard_mission`); None if no mission was started."""
        return (await self._vehicle.request("GET", "/offboard_mission"))["mission"]

    async def flown(self) -> dict[str, Any]:
        """The flight of the newest mission: `samples` with flown and sent positions, `planned_legs`,
        `duration_s`, `planned_duration_s`, `deviation_mean_m`, …
        """
        return (await self._vehicle.request("GET", "/offboard_mission/flown"))["flown"]

    async def start(
        self,
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        dry_run: str | None = None,
        despite: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Starts a mission (a document, or one stored on the server). The vehicle arms and takes off if the
        mission has these steps.

        `dry_run` is the id of a dry run with several flights; the server reports when the vehicle leaves the
        corridor of these flights.

        Raises:
            Refused: the mission has errors that `despite` does not list, or a needed estimate is missing.
        """
        return await self._command("start", start_body(mission, plan_id, version, despite, dry_run=dry_run))

    async def pause(self) -> dict[str, Any]:
        """Pauses the mission: the vehicle stops on its path."""
        return await self._command("pause")

    async def resume(self) -> dict[str, Any]:
        """Resumes the mission from the vehicle's current position."""
        return await self._command("resume")

    async def skip(self) -> dict[str, Any]:
        """Skips the current step."""
        return await self._command("skip")

    async def go_on(self) -> dict[str, Any]:
        """Continues after a step that waits for the operator."""
        return await self._command("go_on")

    async def abort(self, then: str = "hold") -> dict[str, Any]:
        """Ends the mission; `then` is hold, return or land."""
        return await self._command("abort", {"then": then})

    async def _command(self, action: str, body: Body | None = None) -> dict[str, Any]:
        return (await self._vehicle.request("POST", f"/offboard_mission/{action}", body))["mission"]


def start_body(
    mission: Plan | None, plan_id: str | None, version: int | None, despite: Sequence[str], **more: Any
) -> dict[str, Any]:
    """The body for the API, without values that are None."""
    fields = {"mission": mission, "plan_id": plan_id, "version": version, **more}
    return {"despite": list(despite), **{name: value for name, value in fields.items() if value is not None}}
