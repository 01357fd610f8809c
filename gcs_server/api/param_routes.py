"""Routes of a vehicle's parameters: list all with metadata, read and set."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Body, Response
from pydantic import ConfigDict, Field

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import API
from gcs_server.errors import Refused
from gcs_server.operations.operations import ReportProgress
from gcs_server.telemetry.wire import encode
from gcs_server.vehicle.param_metadata import Choice, ParamMetadata, is_default
from gcs_server.vehicle.param_table import Param
from gcs_server.vehicle.services.param_changes import ParamChanges
from gcs_server.vehicle.services.params import ParamList
from gcs_server.vehicle.vehicle import Vehicle

router = Routes(prefix="/vehicles", tags=["parameters"], responses=RESPONSES)

MAX_ENCODED_AT_ONCE = 100
"""Maximum number of parameters that are encoded in one iteration of the event loop."""

MetadataModel = model_of(
    ParamMetadata,
    "ParameterFacts",
    choices=tuple[model_of(Choice, "ParameterChoice"), ...],
    bits=tuple[model_of(Choice, "ParameterBit"), ...],
)
ListModel = model_of(ParamList, "ParameterList")


class ParameterView(ResponseBody):
    """A parameter as the vehicle reports it, with its description."""

    name: str
    """Up to 16 characters of A–Z, 0–9 and _."""
    value: float | int | None
    """Value in the parameter's unit; null: the value is NaN."""
    is_integer: bool
    """Whether the type is a 32-bit integer; false: a 32-bit float."""
    is_default: bool | None
    """Whether the value is the firmware's default; null: not known."""
    facts: MetadataModel | None  # type: ignore[valid-type]
    """The vehicle's own metadata of this parameter; null if not available."""


class ParametersView(ResponseBody):
    """All known parameters."""

    vehicle: str
    """The vehicle's id."""
    list: ListModel  # type: ignore[valid-type]
    """State of the list of parameters."""
    params: tuple[ParameterView, ...]
    """Parameters, sorted by name."""


class RefreshRequest(StrictBody):
    """Options for reading all parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ignore_cache: bool = False
    """Read all parameters even if the vehicle's checksum is unchanged."""
    wait: bool = False
    """Answer only once all parameters have been read."""


class ParamRequest(StrictBody):
    """A parameter's new value."""

    model_config = ConfigDict(frozen=True, extra="forbid", json_schema_extra={"example": {"value": 5}})

    value: float = Field(allow_inf_nan=False)
    """In the parameter's own unit."""
    force: bool = False
    """Set the value even if it is outside the range in the vehicle's metadata."""


def param_view(vehicle: Vehicle, param: Param) -> dict[str, object]:
    """A parameter as `ParameterView`."""
    metadata = vehicle.params.metadata_of(param.name)
    return {
        "name": param.name,
        "value": param.value,
        "is_integer": param.is_integer,
        "is_default": None if metadata is None else is_default(metadata, param.value),
        "facts": metadata,
    }


@router.get("/{v}/params", response_model=ParametersView)
async def all_params(vehicle: VehicleDep) -> Response:
    """All known parameters; sends nothing to the vehicle. `POST …/params/refresh` reads them."""
    known = vehicle.params.all()
    head = encode({"vehicle": vehicle.id, "list": vehicle.params.list})
    parts: list[bytes] = []
    for begin in range(0, len(known), MAX_ENCODED_AT_ONCE):
        parts += [encode(param_view(vehicle, param)) for param in known[begin : begin + MAX_ENCODED_AT_ONCE]]
        await asyncio.sleep(0)
    content = b'%s,"params":[%s]}' % (head[:-1], b",".join(parts))
    return Response(content, media_type="application/json")


@router.post(
    "/{v}/params/refresh",
    response_model=ListModel,
    responses={202: {"model": ListModel, "description": "The parameters are being read."}},
)
async def refresh_params(
    vehicle: VehicleDep,
    station: StationDep,
    principal: PrincipalDep,
    body: Annotated[RefreshRequest | None, Body()] = None,
) -> Response:
    """Reads all parameters (929 on PX4), unless the vehicle's checksum shows that they are unchanged.

    Answers immediately with the progress; with `wait`, answers once all parameters have been read. The header
    `Location` is the URL of the operation, which can be followed and cancelled. Descriptions are read from
    the vehicle's files, once per firmware.
    """
    request = body or RefreshRequest()
    vehicle.require("parameters")
    params = vehicle.params

    async def read(report: ReportProgress) -> dict[str, object]:
        def report_progress(state: ParamList) -> None:
            fraction = None if not state.count else state.received / state.count
            report(f"{state.received} of {state.count or 'unknown'} parameters received.", fraction)

        state = await params.refresh(ignore_cache=request.ignore_cache, progress=report_progress)
        return {"received": state.received, "source": state.source}

    operation = station.operations.start(
        "parameters/read",
        read,
        text=f"Reading the parameters of vehicle {vehicle.id}.",
        vehicle=vehicle.id,
        by=(principal.name, principal.key),
        needs_vehicle=True,
    )
    if request.wait:
        operation = await station.operations.wait(operation.id)
        if operation.state == "cancelled":
            raise Refused(f"Reading the parameters of vehicle {vehicle.id} was cancelled.")
        return json_response(params.list)
    if params.list.state != "reading":
        params.mark_reading()
    response = json_response(params.list, 202)
    response.headers["Location"] = f"{API}/operations/{operation.id}"
    return response


@router.get("/{v}/params/{name}", response_model=ParameterView)
async def get_param(vehicle: VehicleDep, name: str) -> Response:
    """Reads one parameter from the vehicle. A vehicle does not answer for an unknown name (504)."""
    return json_response(param_view(vehicle, await vehicle.params.get(name)))


@router.put("/{v}/params/{name}", response_model=ParameterView)
async def set_param(
    v: str, name: str, body: ParamRequest, station: StationDep, principal: PrincipalDep
) -> Response:
    """Sets one parameter and returns the value that the vehicle reports afterwards.

    If the parameters have been read, a value outside the documented range or choices is refused (422), except
    with `force`.
    """
    arguments: dict[str, object] = {"name": name, "value": body.value}
    if body.force:
        arguments["force"] = True
    with authorized_command(station, principal, "param", v, arguments):
        vehicle = station.fleet.get(v)
        before = vehicle.params.known(name)
        param = await vehicle.params.set(name, body.value, force=body.force)
        vehicle.service(ParamChanges).note(before, param)
        return json_response(param_view(vehicle, param))
