"""Routes of PX4's autotune: whether it can start, its start as an operation, and its end."""

from __future__ import annotations

from typing import Annotated

from fastapi import Body, Response
from pydantic import Field

from gcs_server.api.authorized import as_operation
from gcs_server.api.command_routes import command_options, run_flight_command
from gcs_server.api.models import Despite
from gcs_server.api.operation_routes import OperationModel, operation_view
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import CommandDone, fields_of, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.strict_body import StrictBody, example
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import API
from gcs_server.vehicle.services.autotune import AutotuneService, AutotuneState
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle

router = Routes(prefix="/vehicles", tags=["vehicles", "commands"], responses=RESPONSES)

StateModel = model_of(AutotuneState)


class AutotuneRequest(StrictBody):
    """What the caller accepts when the vehicle tunes itself."""

    model_config = example(despite=["autotune_applies_after_disarming"])

    despite: Despite = Field(default=[])
    """Codes that the caller accepts: `autotune_applies_after_disarming` and `autotune_applies_in_flight`,
    the vehicle writes the gains itself; `autotune_low`, it is less than 4 m above home."""


@router.get("/{v}/autotune", response_model=StateModel)
async def show_autotune(vehicle: VehicleDep) -> Response:
    """Asks the vehicle whether its autotune can start, and what becomes of the gains."""
    return json_response(fields_of(await vehicle.service(AutotuneService).state()))


@router.post("/{v}/autotune", response_model=OperationModel, status_code=202)
async def start_autotune(
    v: str,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[AutotuneRequest | None, Body()] = None,
) -> Response:
    """Starts PX4's autotune: for about 40 s, at most 70, the vehicle moves about its roll, pitch and yaw axis
    by itself. Answers once it has begun; from then on it is an operation, which says the axis and the
    progress.

    The vehicle goes on by itself when the operation, the browser or the server ends: `DELETE
    …/autotune` ends it, another mode or a stick. The operation's result has the `outcome`: `complete`, or
    `waits_for_disarming`: PX4 writes the gains then. The gains are in the log of the flight (`GET
    /flights/{f}/loops`). Answers 409 `plan_findings` if the vehicle would write the gains itself, or is low,
    unless `despite` names the codes.
    """
    despite = [] if body is None else body.despite
    with authorized_command(station, principal, "autotune/start", v, {"despite": despite}) as accepted:
        vehicle = station.fleet.get(v)
        service = vehicle.service(AutotuneService)
        # What ends the command also ends the requests that follow its start, even in the moment between.
        # The ticket yields, because nothing waits for it.
        following = vehicle.tickets.open("autotune", principal.key, yields=True)
        accepted.ticket.on_cancel(lambda error: following.cancel(str(error)))
        try:
            run = await as_operation(
                station,
                principal,
                "autotune/start",
                (accepted.ticket,),
                lambda: service.start(accepted.ticket, despite=despite),
                vehicle_id=v,
            )
        except BaseException:
            following.close()
            raise
        operation = station.operations.start(
            "autotune",
            lambda report: service.follow(run, following, report),
            text=f"Vehicle {v} begins to tune itself.",
            vehicle=v,
            by=(principal.name, principal.key),
            command=True,
        )
    response = json_response(operation_view(operation), 202)
    response.headers["Location"] = f"{API}/operations/{operation.id}"
    return response


@router.delete("/{v}/autotune", response_model=CommandDone)
async def end_autotune(v: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Ends autotune by a change of the mode, and leaves the vehicle in Hold; needs no control. A vehicle that
    tunes itself in Hold is first in Land for about a second, because PX4 ends autotune only when the mode
    changes."""

    async def work(vehicle: Vehicle, ticket: Ticket) -> None:
        options = command_options(vehicle, principal, "autotune/end", ticket)
        await vehicle.service(AutotuneService).end(**options)

    return await run_flight_command(station, principal, "autotune/end", v, {}, work)
