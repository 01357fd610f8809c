"""What the routes work on, and how a command is carried out: timed, journaled, told to all."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from gcs_server.api.turns import Turns
from gcs_server.clock import Clock
from gcs_server.control.authority import Authority
from gcs_server.control.client import Client, key_of
from gcs_server.control.journal import Journal
from gcs_server.errors import GcsError
from gcs_server.mavlink.router import Router
from gcs_server.replay.service import Replays
from gcs_server.streamer.groups import Groups
from gcs_server.telemetry.hub import Hub
from gcs_server.telemetry.wire import plain
from gcs_server.vehicle.fleet import Fleet, Notice
from gcs_server.vehicle.services.transaction import Progress
from gcs_server.vehicle.vehicle import Vehicle

SETPOINT_LINE_PERIOD_S = 1.0
SETPOINT_LINES_KEPT = 1000
DEBUG = 7
"""MAV_SEVERITY: of no interest once it is over."""


@dataclass(slots=True)
class Station:
    """The running server, as the API sees it."""

    clock: Clock
    router: Router
    fleet: Fleet
    hub: Hub
    journal: Journal
    authority: Authority
    replays: Replays
    groups: Groups
    started_s: float
    own_ids: tuple[int, int]
    maps: Path
    """Folder of the operator's offline maps; need not exist."""
    turns: Turns = field(init=False)
    has_scene: bool = False
    simulator: bool = False
    more_warnings: list[Callable[[], list[Notice]]] = field(default_factory=list[Callable[[], list[Notice]]])
    setpoints_noted: dict[tuple[str, str, str], tuple[float, int]] = field(
        default_factory=dict[tuple[str, str, str], tuple[float, int]]
    )
    """By client's key, vehicle and result: when the last line was written, and how many came since."""

    def __post_init__(self) -> None:
        self.turns = Turns(self.authority.controls_any)

    def warnings(self) -> list[Notice]:
        """What stands now, from everywhere."""
        notices = self.fleet.warnings()
        if self.journal.warning is not None:
            notices.append(Notice("journal", self.journal.warning))
        notices += self.authority.warnings()
        for more in self.more_warnings:
            notices += more()
        return notices


# Dependencies are coroutines: FastAPI would call plain functions in other threads, which costs a setpoint
# milliseconds, and nothing here is made for other threads.


async def get_station(connection: HTTPConnection) -> Station:
    """Dependency: the station of this application."""
    return connection.app.state.station


async def get_client(connection: HTTPConnection) -> Client:
    """Dependency: who asks."""
    return client_of(connection)


def client_of(connection: HTTPConnection) -> Client:
    """Who asks, by `X-Client` and `X-Client-Id`, else by its address.

    WebSockets of browsers carry no headers: they give `?client=` and `&client_id=`.
    """
    name, client_id = _says_of_itself(connection)
    return Client.of(name, client_id, connection.client.host if connection.client is not None else "")


def names_itself(connection: HTTPConnection) -> bool:
    """Whether it is more than somebody at an address."""
    return any(_says_of_itself(connection))


def _says_of_itself(connection: HTTPConnection) -> tuple[str, str]:
    headers = connection.headers
    query = connection.query_params if connection.scope["type"] == "websocket" else {}
    return (
        headers.get("x-client") or query.get("client", ""),
        headers.get("x-client-id") or query.get("client_id", ""),
    )


StationDep = Annotated[Station, Depends(get_station)]
ClientDep = Annotated[Client, Depends(get_client)]


async def heard(station: StationDep, client: ClientDep) -> None:
    """Dependency of all routes: any request of a client renews what it holds."""
    station.authority.heard(client)


async def get_vehicle(v: str, station: StationDep) -> Vehicle:
    """Dependency of reading routes: raises UnknownVehicle."""
    return station.fleet.get(v)


VehicleDep = Annotated[Vehicle, Depends(get_vehicle)]


def progress_to(vehicle: Vehicle, client: str, command: str) -> Progress:
    """Tells everybody who listens how far a command is, and whose it is; kept in no history."""

    def tell(text: str, fraction: float | None) -> None:
        data: dict[str, object] = {
            "command": command,
            "client": client,
            "client_key": key_of(client),
            "fraction": fraction,
        }
        vehicle.events.add("progress", vehicle.clock.unix_s(), text, severity=DEBUG, data=data, kept=False)

    return tell


class Outcome:
    """How long a command took, known after its block."""

    duration_s: float = 0.0


@contextmanager
def journaled(
    station: Station, client: str, command: str, vehicle_id: str | None, arguments: dict[str, object]
) -> Generator[Outcome]:
    """The seam of all commands: who is not in control is refused, and whatever happens leaves a line.

    Raises:
        NotInControl: another client holds control of the vehicle.
    """
    with noted(station, client, command, vehicle_id, arguments) as outcome:
        if vehicle_id is not None:
            station.authority.admit(client, command, vehicle_id)
        yield outcome
        if vehicle_id is not None:
            station.authority.carried_out(client, command, vehicle_id)


@contextmanager
def noted(
    station: Station, client: str, command: str, vehicle_id: str | None, arguments: dict[str, object]
) -> Generator[Outcome]:
    """One line of the journal for what happens in the block, however it ends; asks nobody for control."""
    began_s = station.clock.monotonic_s()
    outcome = Outcome()
    result, detail = "ok", None
    try:
        yield outcome
    except GcsError as error:
        result, detail = error.code, str(error)
        raise
    except asyncio.CancelledError:
        result, detail = "cancelled", "The client went away or the server ended."
        raise
    except Exception as error:
        result, detail = "internal", f"{type(error).__name__}: {error}"
        raise
    finally:
        outcome.duration_s = station.clock.monotonic_s() - began_s
        arguments = plain(arguments)
        if command == "offboard/setpoint" and result in ("ok", "not_in_control"):
            _note_setpoint(station, client, vehicle_id or "", arguments, (result, detail, outcome.duration_s))
        else:
            station.journal.add(client, command, vehicle_id, arguments, result, detail, outcome.duration_s)


def _note_setpoint(
    station: Station,
    client: str,
    vehicle_id: str,
    arguments: dict[str, object],
    end: tuple[str, str | None, float],
) -> None:
    """A stream of setpoints becomes a line a second with the newest one and their number."""
    now_s = station.clock.monotonic_s()
    if len(station.setpoints_noted) >= SETPOINT_LINES_KEPT:  # by clients that name themselves anew each time
        station.setpoints_noted.clear()
    key = (Client.named(client).key, vehicle_id, end[0])
    last_s, count = station.setpoints_noted.get(key, (float("-inf"), 0))
    if now_s - last_s < SETPOINT_LINE_PERIOD_S:
        station.setpoints_noted[key] = (last_s, count + 1)
        return
    station.setpoints_noted[key] = (now_s, 0)
    arguments = {**arguments, "setpoints_since_last_line": count + 1}
    station.journal.add(client, "offboard/setpoint", vehicle_id, arguments, *end)
