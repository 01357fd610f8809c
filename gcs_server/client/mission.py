"""Missions of a vehicle: waypoint plans, offboard missions, and offboard missions as flight modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs_server.client.control import VehicleApi
from gcs_server.client.plans import Operations, Plan
from gcs_server.client.setpoints import Body

TRANSFER_TIMEOUT_S = 600.0
"""Maximum wait [s]; a thousand items take a few minutes on a link that loses every third packet."""


class Mission:
    """The mission, geofence and rally points of a vehicle."""

    def __init__(self, vehicle: VehicleApi, operations: Operations) -> None:
        self._vehicle = vehicle
        self._operations = operations

    async def state(self) -> dict[str, Any]:
        """Progress of the vehicle's mission, the plan on the vehicle (`holds`), and where an interrupted
        flight can be resumed (`resume`)."""
        return await self._vehicle.request("GET", "/mission")

    async def upload(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        hold_first: bool = False,
        despite: Sequence[str] = (),
        timeout_s: float = TRANSFER_TIMEOUT_S,
    ) -> dict[str, Any]:
        """Uploads a plan (a document, or one stored on the server), verifies it, and returns the result.

        A vehicle in Mission mode flies to the first item of a changed mission at once: either `hold_first`
        puts it into Hold before, or `despite` names `flies_new_plan_at_once`.

        Raises:
            Refused: the vehicle refuses an item, or has different items afterwards; the text names the items.
        """
        options = {"hold_first": hold_first, "despite": list(despite)}
        body = {**_chosen_plan(plan, plan_id, version), **options}
        operation = await self._vehicle.request("POST", "/mission/upload", body)
        return (await self._operations.wait(operation["id"], timeout_s=timeout_s))["result"]

    async def download(self, *, timeout_s: float = TRANSFER_TIMEOUT_S) -> dict[str, Any]:
        """Reads the vehicle's items; returns the same result as `plan()`."""
        operation = await self._vehicle.request("POST", "/mission/download")
        await self._operations.wait(operation["id"], timeout_s=timeout_s)
        return await self.plan()

    async def plan(self) -> dict[str, Any]:
        """The last downloaded or verified plan: `plan`, `read_unix_s`, `still_held` (by the vehicle)."""
        return await self._vehicle.request("GET", "/mission/plan")

    async def compare(
        self, plan: Plan | None = None, *, plan_id: str | None = None, version: int | None = None
    ) -> dict[str, Any]:
        """Compares a plan with the last downloaded one: whether it is `equal`, and the `differences`."""
        return await self._vehicle.request("POST", "/mission/compare", _chosen_plan(plan, plan_id, version))

    async def clear(self) -> None:
        """Clears mission, geofence and rally points on the vehicle; refused while the vehicle is in Mission
        mode."""
        await self._vehicle.request("DELETE", "/mission")

    async def start(
        self,
        item: int | None = None,
        *,
        despite: Sequence[str] = (),
        dry_run: str | None = None,
        mission_id: int | None = None,
    ) -> None:
        """Starts the mission at an item (counted from 0) or at the current item; arms the vehicle if needed.

        `dry_run` is the id of a dry run of the plan on the vehicle; the server compares the two flights.
        To resume an interrupted flight, give `item` and `mission_id` of `state()["resume"]`.

        Raises:
            Refused: the plan is unknown or has errors, and `despite` does not list the codes; the dry run
                was made for another plan or position; or the vehicle has another mission than `mission_id`.
        """
        options = {"item": item, "dry_run": dry_run, "mission_id": mission_id}
        body: Body = {"despite": list(despite), **{k: v for k, v in options.items() if v is not None}}
        await self._vehicle.request("POST", "/mission/start", body)

    async def flown(self) -> dict[str, Any]:
        """The newest flight of a plan, compared with the plan: `samples`, `planned_legs`,
        `deviation_max_m`."""
        return (await self._vehicle.request("GET", "/mission/flown"))["flown"]

    async def pause(self) -> None:
        """Pauses the mission in flight: the vehicle holds its position, as `vehicle.hold()`."""
        await self._vehicle.request("POST", "/hold")

    async def resume(self, *, despite: Sequence[str] = ()) -> None:
        """Resumes the mission in flight at the current item. After a landing, use `start`."""
        await self._continue_at(None, despite, None)

    async def skip_to(self, item: int, *, despite: Sequence[str] = (), mission_id: int | None = None) -> None:
        """Flies straight to an item (counted from 0) and continues the mission there; only in the air.

        Raises:
            Refused: the vehicle is not flying, or has another mission than `mission_id`; or as `start`.
            NoReply: the mission has no such item.
        """
        await self._continue_at(item, despite, mission_id)

    async def restart(self, *, despite: Sequence[str] = (), mission_id: int | None = None) -> None:
        """Begins the mission again at its first item; only in the air. Raises as `skip_to`."""
        await self._continue_at(0, despite, mission_id)

    async def _continue_at(self, item: int | None, despite: Sequence[str], mission_id: int | None) -> None:
        options = {"item": item, "mission_id": mission_id}
        body: Body = {"despite": list(despite), **{k: v for k, v in options.items() if v is not None}}
        await self._vehicle.request("POST", "/mission/resume", body)


def _chosen_plan(plan: Plan | None, plan_id: str | None, version: int | None) -> Body:
    options = {"plan": None if plan is None else dict(plan), "plan_id": plan_id, "version": version}
    return {name: value for name, value in options.items() if value is not None}


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
