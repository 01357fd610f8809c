"""The asynchronous client: `async with Gcs() as gcs`.

Names contain units and frames; `ned` is relative to the origin of the vehicle's local frame.
"""

from __future__ import annotations

import json
import os
from collections.abc import AsyncGenerator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit, urlunsplit
from uuid import uuid4

import httpx
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus

from gcs_server.client.errors import Unreachable, raise_for
from gcs_server.client.flights import Flights
from gcs_server.client.mission import start_body
from gcs_server.client.plans import DryRuns, Operations, Plan, Plans
from gcs_server.client.setpoints import Body, ExpiryAction, validity_fields
from gcs_server.client.vehicle import Vehicle, hold_at_end, poll_until_found


def address_and_token(
    url: str, token: str | None, environment: Mapping[str, str] | None = None
) -> tuple[str, str | None]:
    """The server's address without the token, and the token: `token`, or else the token in `url`, or else
    `GCS_TOKEN`.
    """
    parts = urlsplit(url)
    if token is None:
        environment = os.environ if environment is None else environment
        url_tokens = parse_qs(parts.query).get("token")
        token = url_tokens[0] if url_tokens else environment.get("GCS_TOKEN")
    return urlunsplit((parts.scheme, parts.netloc, parts.path.rstrip("/"), "", "")), token or None


Setpoints = Mapping[str, Body]
"""Setpoint bodies (`gcs_server.client.setpoints`) by vehicle id."""


class Group:
    """A flying group.

    Args:
        gcs: the client.
        started: the server's response to the start.
        validity: validity of the setpoints, and the action on expiry.
    """

    def __init__(self, gcs: Gcs, started: dict[str, Any], validity: Body) -> None:
        self._gcs = gcs
        self._validity = validity
        self.id: str = started["id"]
        self.started = started
        """The server's response to the start, in the form of `status`; `start_unix_s` is the time of the
        common start."""

    async def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """Sends new setpoints to some or all members at the same time, and renews the setpoints of the other
        members.

        Raises:
            Invalid: a value is invalid, or a vehicle is not in the group.
            Refused: a setpoint cannot be flown, two vehicles would come too close, or the group has ended.
        """
        return await self._gcs.request(
            "POST", f"/groups/{self.id}/setpoints", {"setpoints": members_of(setpoints), **self._validity}
        )

    async def renew(self) -> dict[str, Any]:
        """Renews all setpoints for another `valid_for_s`; raises the same errors as `send`."""
        return await self.send({})

    async def status(self) -> dict[str, Any]:
        """State, members, the two closest members, findings, and the reason for the end."""
        return await self._gcs.request("GET", f"/groups/{self.id}")

    async def hold(self) -> dict[str, Any]:
        """Puts all current members into Hold; does nothing if the group has ended."""
        return await self._gcs.request("POST", f"/groups/{self.id}/hold")


def members_of(setpoints: Setpoints) -> list[Body]:
    """The members in the format of the API."""
    return [{"vehicle": vehicle, "setpoint": dict(setpoint)} for vehicle, setpoint in setpoints.items()]


LEAVE_TIMEOUT_S = 2.0
"""Maximum wait for the server at the end of the block [s]."""


class Gcs:
    """A connection to the server.

    Args:
        url: address of the server.
        client: name of this program in the journal.
        timeout_s: maximum wait for one response [s]. The response to a command arrives once the vehicle's
            state shows its result.
        token: access token, required if other machines can reach the server. Default: the token in `url`, or
            else `GCS_TOKEN`.
        client_id: distinguishes this program from others with the same name. Default: `GCS_CLIENT_ID`, or
            else a random id.
    """

    def __init__(
        self,
        url: str = "http://localhost:8080",
        *,
        client: str = "python",
        timeout_s: float = 60.0,
        token: str | None = None,
        client_id: str | None = None,
    ) -> None:
        self.url, token = address_and_token(url, token)
        client_id = client_id or os.environ.get("GCS_CLIENT_ID") or uuid4().hex
        self._headers = {"X-Client": client, "X-Client-Id": client_id}
        self._headers |= {"Authorization": f"Bearer {token}"} if token else {}
        self._has_commanded = False
        self._http = httpx.AsyncClient(
            base_url=f"{self.url}/api/v1", headers=self._headers, timeout=timeout_s
        )

    async def __aenter__(self) -> Gcs:
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._has_commanded:  # releases control of all vehicles
            with suppress(httpx.TransportError):
                await self._http.post("/me/leave", timeout=LEAVE_TIMEOUT_S)
        await self._http.aclose()

    async def request(self, method: str, path: str, body: Body | None = None) -> Any:
        """Sends one request below `/api/v1`.

        Raises:
            ApiError: the server or the vehicle refused.
            Unreachable: the server did not respond.
        """
        content = await self.raw(method, path, body=body)
        return json.loads(content) if content else None

    async def raw(
        self, method: str, path: str, *, body: Body | None = None, content: bytes | None = None
    ) -> bytes:
        """Sends one request below `/api/v1` whose body or response is a file; raises the same errors as
        `request`."""
        self._has_commanded = self._has_commanded or method != "GET"
        try:
            response = await self._http.request(method, path, json=body, content=content)
        except httpx.TransportError as error:
            raise Unreachable(f"No response from {self.url}: {error or type(error).__name__}.") from error
        raise_for(response)
        return response.content

    async def download(self, path: str, file: Path) -> int:
        """Writes the answer of a GET below `/api/v1` to a file, which appears when it is complete; returns
        its size [bytes]. Raises the same errors as `request`, and OSError."""
        part = file.with_name(f".{file.name}.part")
        try:
            async with self._http.stream("GET", path) as response:
                if response.is_error:
                    await response.aread()
                    raise_for(response)
                size = 0
                with part.open("wb") as target:
                    async for piece in response.aiter_bytes():
                        size += target.write(piece)
            part.replace(file)
            return size
        except httpx.TransportError as error:
            raise Unreachable(
                f"The answer of {self.url} is not complete: {error or type(error).__name__}."
            ) from error
        finally:
            part.unlink(missing_ok=True)

    async def vehicles(self) -> list[Vehicle]:
        """All vehicles that the server knows."""
        return [Vehicle(self, entry["id"]) for entry in await self.request("GET", "/vehicles")]

    def vehicle(self, vehicle_id: str) -> Vehicle:
        """A vehicle by its id, without asking the server whether it exists."""
        return Vehicle(self, vehicle_id)

    async def hold(self, vehicles: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """Switches several vehicles to Hold at the same time, even if another client has control.

        Args:
            vehicles: ids of the vehicles; default: all armed vehicles.

        Returns:
            One object per vehicle: `vehicle` (its id), `held`, and `problem` if it did not switch to Hold.
        """
        body: Body = {"vehicles": None if vehicles is None else list(vehicles)}
        return (await self.request("POST", "/hold", body))["results"]

    def operations(self) -> Operations:
        """Operations (long-running work of the server): list them, wait for their end, cancel them."""
        return Operations(self)

    def flights(self) -> Flights:
        """The recordings and logs of flights on the server."""
        return Flights(self)

    def plans(self) -> Plans:
        """The plans stored on the server."""
        return Plans(self)

    def dry_runs(self) -> DryRuns:
        """Plans flown in simulation before a vehicle flies them."""
        return DryRuns(self)

    async def wait_for_vehicle(
        self, vehicle_id: str | None = None, *, ready: bool = False, timeout_s: float = 60.0
    ) -> Vehicle:
        """Waits until a vehicle (default: any) is connected; with `ready`, until it reports that it can arm.

        Raises:
            Timeout: no vehicle connected or became ready in time.
        """

        async def find() -> Vehicle | None:
            for vehicle in await self.vehicles():
                if vehicle_id in (None, vehicle.id) and (not ready or await vehicle.is_ready()):
                    return vehicle
            return None

        awaited = f"vehicle {vehicle_id}" if vehicle_id else "a vehicle"
        return await poll_until_found(
            find, timeout_s, f"{awaited} to be {'ready to arm' if ready else 'connected'}"
        )

    async def socket(self, path: str) -> ClientConnection:
        """A WebSocket below `/api/v1`.

        Raises:
            ApiError: the server refused the connection.
            Unreachable: the server did not respond.
        """
        address = f"{self.url.replace('http', 'ws', 1)}/api/v1{path}"
        try:
            return await connect(address, additional_headers=self._headers, compression=None)
        except InvalidStatus as error:
            # A failed handshake contains no reason; an ordinary request raises the error with the reason.
            await self.request("GET", "/version")
            raise Unreachable(f"{self.url} refused {path}: {error}.") from error
        except OSError as error:
            raise Unreachable(f"No response from {self.url}: {error}.") from error

    @asynccontextmanager
    async def group(
        self,
        setpoints: Setpoints,
        *,
        minimum_separation_m: float | None = None,
        start_at_unix_s: float | None = None,
        rate_hz: float | None = None,
        valid_for_s: float | None = None,
        on_expiry: ExpiryAction | None = None,
        hold_for_s: float | None = None,
        others_go_on: bool = False,
    ) -> AsyncGenerator[Group]:
        """Flies several vehicles as a group inside a block; leaving the block in any way puts all into Hold.

        All vehicles start at the same time, each with its setpoint (any of `gcs_server.client.setpoints`). If
        one vehicle cannot start, no vehicle moves. All setpoints expire together, `valid_for_s` after the end
        of the longest path. If an exception ends the block and Hold fails too, a note on the exception states
        why Hold failed.

        With `others_go_on`, the other members continue if a member leaves the group.

        Yields:
            The group, once all vehicles are in Offboard; `started["start_unix_s"]` is the common start.

        Raises:
            Refused: a vehicle cannot fly, two vehicles would come too close, or another client has control of
                a vehicle.
        """
        validity = validity_fields(valid_for_s, on_expiry, hold_for_s)
        options = {
            "minimum_separation_m": minimum_separation_m,
            "start_at_unix_s": start_at_unix_s,
            "rate_hz": rate_hz,
        }
        given_options: Body = {name: value for name, value in options.items() if value is not None}
        body: Body = {
            "members": members_of(setpoints), "others_go_on": others_go_on, **given_options, **validity
        }  # fmt: skip
        group = Group(self, await self.request("POST", "/groups", body), validity)
        async with hold_at_end(f"Group {group.id}", group.hold):
            yield group

    async def start_together(
        self,
        vehicles: Mapping[str, str],
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        dry_run: str | None = None,
        despite: Sequence[str] = (),
    ) -> list[dict[str, Any]]:
        """Flies a mission with roles: all vehicles start, or none. `pause`, `resume` and `abort` of one
        vehicle's `offboard_mission` act on all vehicles.

        Args:
            vehicles: the vehicle's id for each role.
            mission: the mission's document; or give the `plan_id` of a stored mission.
            plan_id: id of a stored mission.
            version: version of the stored mission; default: the newest.
            dry_run: id of a dry run of this mission with several flights; the server reports when a vehicle
                leaves the corridor of these flights.
            despite: codes of error findings that are accepted.

        Returns:
            One object per vehicle: `vehicle` (its id) and `mission`, as `offboard_mission.state()`.

        Raises:
            Refused: a vehicle cannot start, another client has control of a vehicle, or the mission has
                errors that `despite` does not list.
        """
        body = start_body(mission, plan_id, version, despite, vehicles=dict(vehicles), dry_run=dry_run)
        return (await self.request("POST", "/offboard_missions/start", body))["vehicles"]

    async def telemetry(
        self, *, vehicles: Sequence[str] | str = "*", topics: Sequence[str] | str = "*", rate_hz: float = 10.0
    ) -> AsyncGenerator[dict[str, Any]]:
        """Yields samples and events as they arrive: `{"type": "sample" | "event", …}`. Only the newest value
        of a topic is sent.

        Raises:
            ApiError: the server refused the connection.
            Unreachable: the server did not respond.
        """
        socket = await self.socket("/telemetry")
        async with socket:
            subscription = {"type": "subscribe", "vehicles": vehicles, "topics": topics, "rate_hz": rate_hz}
            await socket.send(json.dumps(subscription))
            async for frame in socket:
                message = json.loads(frame)
                for sample in message.get("samples", ()):
                    yield {"type": "sample", **sample}
                if message["type"] == "event":
                    yield {"type": "event", **message["event"]}
