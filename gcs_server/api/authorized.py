"""Runs a command: checks the requirements in the command table, opens its tickets, measures the duration, and
writes a journal line. A command that moves a vehicle runs as an operation."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from starlette.requests import HTTPConnection, Request

from gcs_server.api.permission import check_permission
from gcs_server.api.principals import principal_of
from gcs_server.api.station import Station
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, Interrupted
from gcs_server.telemetry.wire import plain
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

T = TypeVar("T")
SETPOINT_LINE_PERIOD_S = 1.0
MAX_SETPOINT_STREAMS = 1000
SETPOINT = "offboard/setpoint"
DEBUG = 7
"""MAV_SEVERITY of progress events."""


def progress_reporter(vehicle: Vehicle, principal: Principal, command: str) -> ReportProgress:
    """Returns a function that sends the progress of a command to all telemetry clients. Progress is not
    stored as an event."""

    def report(text: str, fraction: float | None) -> None:
        data: dict[str, object] = {
            "command": command,
            "client": principal.name,
            "client_key": principal.key,
            "fraction": fraction,
        }
        vehicle.events.add("progress", vehicle.clock.unix_s(), text, severity=DEBUG, data=data, stored=False)

    return report


class AcceptedCommand:
    """A command that was accepted."""

    duration_s: float = 0.0
    """Set at the end of the block of `authorized_command`."""

    def __init__(self, ticket: Ticket | None) -> None:
        self._ticket = ticket

    @property
    def ticket(self) -> Ticket:
        """The command's ticket; only commands that move or stop a vehicle have one."""
        assert self._ticket is not None
        return self._ticket


@contextmanager
def authorized_command(
    station: Station,
    principal: Principal,
    name: str,
    vehicle_id: str | None,
    arguments: dict[str, object] | Callable[[], dict[str, object]],
    *,
    refusal: GcsError | None = None,
) -> Generator[AcceptedCommand]:
    """Wraps every command: checks control as the command table requires, opens the command's ticket, and
    writes the result to the journal.

    Args:
        station: the running server.
        principal: the caller.
        name: the command's row in `control/commands.py`.
        vehicle_id: the commanded vehicle; None for commands to no vehicle or to several.
        arguments: arguments of the command, written to the journal; or returns them if they are written.
        refusal: error of an earlier check; raised here, so that the journal contains the refusal.

    Raises:
        NotInControl: another client has control of the vehicle.
    """
    command = BY_NAME[name]
    began_s = station.clock.monotonic_s()
    accepted = AcceptedCommand(None)
    ticket: Ticket | None = None
    result, detail = "ok", None
    try:
        if refusal is not None:
            raise refusal
        if vehicle_id is not None:
            station.authority.admit(principal, command, vehicle_id)
            if command.acts != "no":
                key = principal.key if command.control == "lease" else None
                ticket = station.fleet.get(vehicle_id).tickets.open(command.label or name, key)
                accepted = AcceptedCommand(ticket)
        yield accepted
        if vehicle_id is not None:
            station.authority.report_command(principal, command, vehicle_id)
    except GcsError as error:
        result, detail = error.code, str(error)
        raise
    except asyncio.CancelledError:
        result, detail = "cancelled", "The client disconnected or the server was shut down."
        raise
    except Exception as error:
        result, detail = "internal", f"{type(error).__name__}: {error}"
        raise
    finally:
        if ticket is not None:
            ticket.close()
        accepted.duration_s = station.clock.monotonic_s() - began_s
        outcome = (result, detail, accepted.duration_s)
        if name == SETPOINT and result in ("ok", "not_in_control"):
            _write_setpoint_line(station, principal, vehicle_id or "", arguments, outcome)
        else:
            written = arguments() if callable(arguments) else arguments
            station.journal.add(principal.name, name, vehicle_id, plain(written), *outcome)


_caller: ContextVar[Request | None] = ContextVar("caller", default=None)
"""The request that is being answered; None: the route was called without HTTP."""


async def enter(connection: HTTPConnection) -> AsyncGenerator[None]:
    """Dependency of all routes, and the only one, because each costs a setpoint a tenth of a millisecond:
    checks the permission, notes the request, so that `as_operation` sees the end of its connection, and
    renews the caller's control of vehicles until the request is answered. A WebSocket keeps control only if
    its route says so.

    Raises:
        NotPermitted: the caller's role does not include the command.
    """
    await check_permission(connection)
    authority, principal = connection.app.state.station.authority, principal_of(connection)
    if isinstance(connection, Request):
        _caller.set(connection)
        with authority.answering(principal):
            yield
    else:
        _caller.set(None)
        authority.renew(principal)
        yield


async def as_operation(
    station: Station,
    principal: Principal,
    name: str,
    tickets: Sequence[Ticket],
    work: Callable[[], Awaitable[T]],
    *,
    vehicle_id: str | None,
    ends_with_caller: bool = True,
) -> T:
    """Runs the work of a command as an operation, so that all clients see it and can cancel it, and returns
    its result. The end of a ticket ends the work.

    Args:
        station: the running server.
        principal: the caller.
        name: the command's row in `control/commands.py`; kind of the operation.
        tickets: the command's tickets, one for each vehicle that it moves.
        work: looks at the tickets directly before each frame.
        vehicle_id: the vehicle; None: several.
        ends_with_caller: whether the tickets end when the caller closes its connection.

    Raises:
        Interrupted: a ticket was cancelled.
    """
    results: list[T] = []

    async def run(_report: object) -> None:
        results.append(await work())

    operation = station.operations.start(
        name,
        run,
        text=f"“{name}” of {principal.name}.",
        vehicle=vehicle_id,
        by=(principal.name, principal.key),
        needs_vehicle=True,
        command=True,
    )

    def cancel(reason: str) -> None:
        for ticket in tickets:
            ticket.cancel(reason)
        if not tickets:
            station.operations.interrupt(operation.id, Interrupted(reason))

    def end(error: Interrupted) -> None:
        cancel(str(error))  # the vehicles of one command act together, or none does
        station.operations.interrupt(operation.id, error)

    for ticket in tickets:
        ticket.on_cancel(end)
    caller = _caller.get() if ends_with_caller else None
    error: GcsError | None = None
    try:
        with station.authority.answering(principal):
            async with asyncio.TaskGroup() as tasks:
                watch = None if caller is None else tasks.create_task(_wait_for_end(caller, cancel))
                try:
                    ended = await station.operations.wait(operation.id)
                    if ended.state == "cancelled":
                        error = Interrupted(f"“{name}” was cancelled.")
                except GcsError as problem:
                    error = problem
                finally:
                    if watch is not None:
                        watch.cancel()
    except asyncio.CancelledError:
        cancel("The request was cancelled.")
        raise
    if error is not None:
        cancel(str(error))
        raise error
    return results[0]


async def _wait_for_end(caller: Request, cancel: Callable[[str], None]) -> None:
    """Cancels once the caller has closed its connection."""
    while (await caller.receive())["type"] != "http.disconnect":
        pass
    cancel("The client closed its connection before the command had ended.")


def _write_setpoint_line(
    station: Station,
    principal: Principal,
    vehicle_id: str,
    arguments: dict[str, object] | Callable[[], dict[str, object]],
    outcome: tuple[str, str | None, float],
) -> None:
    """Writes one journal line per second for a stream of setpoints: the newest setpoint, and the number of
    setpoints since the last line."""
    now_s = station.clock.monotonic_s()
    # The number of entries is limited, because a caller may change its name for each request.
    if len(station.setpoint_lines) >= MAX_SETPOINT_STREAMS:
        station.setpoint_lines.clear()
    key = (principal.key, vehicle_id, outcome[0])
    last_s, count = station.setpoint_lines.get(key, (float("-inf"), 0))
    if now_s - last_s < SETPOINT_LINE_PERIOD_S:
        station.setpoint_lines[key] = (last_s, count + 1)
        return
    station.setpoint_lines[key] = (now_s, 0)
    written = arguments() if callable(arguments) else arguments
    line: dict[str, object] = {**plain(written), "setpoints_since_last_line": count + 1}
    station.journal.add(principal.name, SETPOINT, vehicle_id, line, *outcome)
