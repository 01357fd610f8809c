"""Runs a command of a request: one that moves a vehicle runs as an operation, which ends with its caller."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from contextvars import ContextVar
from typing import TypeVar

from starlette.requests import HTTPConnection, Request

from gcs_server.api.permission import check_permission
from gcs_server.api.principals import principal_of
from gcs_server.api.station import Station
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, Interrupted
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

T = TypeVar("T")
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


async def while_connected(work: Awaitable[T]) -> T:
    """The result of work that nobody needs once the caller has closed its connection: then it is cancelled.

    Raises:
        Interrupted: the caller has closed its connection.
    """
    caller = _caller.get()
    if caller is None:
        return await work
    results, errors = list[T](), list[GcsError]()

    async def run() -> None:
        try:
            results.append(await work)
        except GcsError as problem:
            errors.append(problem)

    async with asyncio.TaskGroup() as tasks:
        task = tasks.create_task(run())

        def cancel(reason: str) -> None:
            errors.append(Interrupted(reason))
            task.cancel()

        watch = tasks.create_task(_wait_for_end(caller, cancel))
        await asyncio.wait({task})
        watch.cancel()
    if errors:
        raise errors[0]
    return results[0]


async def _wait_for_end(caller: Request, cancel: Callable[[str], None]) -> None:
    """Cancels once the caller has closed its connection."""
    while (await caller.receive())["type"] != "http.disconnect":
        pass
    cancel("The client closed its connection before the command had ended.")
