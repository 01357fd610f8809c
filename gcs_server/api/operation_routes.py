"""Routes of operations (long-running work): list, show and cancel."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Query, Response

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES, Problem, problem_of
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import fields_of, json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep
from gcs_server.api.strict_body import ResponseBody
from gcs_server.control.accepted import authorized_command
from gcs_server.operations.operations import Operation

router = Routes(prefix="/operations", tags=["operations"], responses=RESPONSES)

OperationModel = model_of(Operation, "Operation", error=Problem | None)


class OperationList(ResponseBody):
    """All operations."""

    operations: list[OperationModel]  # type: ignore[valid-type]
    """Running operations, and operations that ended recently; oldest first."""


def operation_view(operation: Operation) -> dict[str, Any]:
    """The operation as JSON for routes and events; its error as problem+json."""
    error = operation.error
    return {**fields_of(operation), "error": None if error is None else problem_of(error)}


@router.get("", response_model=OperationList)
async def list_operations(
    station: StationDep,
    vehicle: Annotated[
        str | None, Query(max_length=32, description="Only operations of this vehicle.")
    ] = None,
) -> Response:
    """Running operations, and operations that ended recently. Each change is also an `operation` event on
    the telemetry socket."""
    operations = station.operations.all()
    return json_response(
        {"operations": [operation_view(o) for o in operations if vehicle in (None, o.vehicle)]}
    )


@router.get("/{o}", response_model=OperationModel)
async def show_operation(o: str, station: StationDep) -> Response:
    """Progress of an operation, or its result or error."""
    return json_response(operation_view(station.operations.get(o)))


@router.delete("/{o}", response_model=OperationModel)
async def cancel_operation(o: str, station: StationDep, principal: PrincipalDep) -> Response:
    """Cancels an operation and answers once its clean-up is done. An ended operation does not change. The
    client that started the operation may always cancel it. Another client may cancel it only if no one else
    controls the operation's vehicle.
    """
    operation = station.operations.get(o)
    with authorized_command(
        station, principal, "operations/cancel", None, {"operation": o, "kind": operation.kind}
    ):
        if operation.vehicle is not None and operation.client_key != principal.key:
            refusal = station.authority.refusal(principal, "operations/cancel", [operation.vehicle])
            if refusal is not None:
                raise refusal
        return json_response(operation_view(await station.operations.cancel(o)))
