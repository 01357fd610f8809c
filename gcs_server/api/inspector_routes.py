"""Routes of the MAVLink inspector: what arrives of a vehicle, plotted fields, the dialect, and sending."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query, Response
from pydantic import Field

from gcs_server.api.authorized import authorized_command
from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.control.commands import BY_NAME
from gcs_server.mavlink import definitions
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.services.inspector import (
    FieldSeries,
    MessageInspector,
    Received,
    ReceivedLoss,
    ReceivedMessage,
)
from gcs_server.vehicle.services.raw_messages import PURPOSE_MADE, RawMessages

router = Routes(tags=["mavlink"], responses=RESPONSES)

ReceivedMessageModel = model_of(ReceivedMessage, "ReceivedMessage")
ReceivedLossModel = model_of(ReceivedLoss, "ReceivedLoss")
ReceivedModel = model_of(
    Received,
    "ReceivedMessages",
    messages=tuple[ReceivedMessageModel, ...],
    loss=tuple[ReceivedLossModel, ...],
)
FieldSeriesModel = model_of(FieldSeries, "FieldSeries")
EnumValueModel = model_of(definitions.EnumValue, "EnumValue")
MessageFieldModel = model_of(definitions.MessageField, "MessageField", values=tuple[EnumValueModel, ...])
MessageDefinitionModel = model_of(
    definitions.MessageDefinition, "MessageDefinition", fields=tuple[MessageFieldModel, ...]
)
MAX_FIELDS = 16
Scalar = float | int | str | None


class MessageNames(ResponseBody):
    """The messages of the dialect."""

    messages: list[str]
    """Names that can be sent, sorted."""
    refused: dict[str, str]
    """Messages that are not sent as they are, and the call that does it."""


class RawMessage(StrictBody):
    """A message for the vehicle, as it is."""

    message: str = Field(max_length=60, examples=["COMMAND_LONG"])
    """Name of the message."""
    fields: dict[str, Scalar | list[Scalar]] = Field(max_length=64)
    """Its fields: numbers (null: NaN), lists for arrays, texts. What is not given is 0; `target_system` is
    the vehicle, `target_component` the autopilot."""
    while_armed: bool = False
    """Send it also while the vehicle is armed. It acts at once, and nothing of it is checked."""
    confirm: str = Field(max_length=150)
    """Exactly `{message} is sent unchecked to vehicle {vehicle}`."""


class RawMessageAnswer(ResponseBody):
    """How the vehicle answered."""

    acknowledged: bool | None
    """Whether an acknowledgement came; null: the message has none."""
    result: str | None
    """MAV_RESULT of the acknowledgement."""


@router.get("/mavlink/messages", response_model=MessageNames)
async def message_names() -> Response:
    """The messages of the server's dialect."""
    names = sorted(name for name in definitions.IDS if name not in PURPOSE_MADE)
    return json_response({"messages": names, "refused": PURPOSE_MADE})


@router.get("/mavlink/messages/{name}", response_model=MessageDefinitionModel)
async def message_definition(name: str) -> Response:
    """The fields of a message: type, unit, enumeration."""
    return json_response(definitions.definition(name))


@router.get("/vehicles/{v}/mavlink", response_model=ReceivedModel)
async def received(vehicle: VehicleDep) -> Response:
    """What arrives of the vehicle: every message of every component with rate, age and fields as they come,
    and what is lost. The server counts only while somebody looks, so that the first answer is empty; it ends
    ten seconds after the last look. For continuous values subscribe to the telemetry topic
    `mavlink_messages`."""
    return json_response(vehicle.service(MessageInspector).received())


@router.get("/vehicles/{v}/mavlink/series", response_model=FieldSeriesModel)
async def series(
    vehicle: VehicleDep,
    message: Annotated[str, Query(max_length=60, description="Name of the message.")],
    field: Annotated[
        list[Annotated[str, Field(max_length=60)]],
        Query(
            min_length=1, max_length=MAX_FIELDS, description="`name` or `name[index]`; repeated for several."
        ),
    ],
    component: Annotated[int, Query(ge=0, le=255, description="Component that sends it.")] = 1,
    after_s: Annotated[
        float,
        Query(ge=0, le=1e12, description="Time of the last value that the client has; 0: all that is kept."),
    ] = 0.0,
) -> Response:
    """All values of fields of one message, at its full rate: those that arrived after `after_s`. The server
    keeps the newest 4,000 messages from the first request on, of at most eight kinds, while it is asked."""
    return json_response(vehicle.service(MessageInspector).series(message, component, field, after_s))


@router.post("/vehicles/{v}/mavlink/send", response_model=RawMessageAnswer)
async def send(v: str, body: RawMessage, station: StationDep, principal: PrincipalDep) -> Response:
    """Sends one message as it is. Needs control; refused for what has a command of its own, and while the
    vehicle is armed unless `while_armed` is set. It is sent once; of a command the acknowledgement is
    awaited."""
    arguments: dict[str, object] = {"message": body.message, "fields": body.fields, "confirm": body.confirm}
    with authorized_command(station, principal, "mavlink/send", v, arguments):
        BY_NAME["mavlink/send"].require_confirmation(body.confirm, message=body.message, vehicle=v)
        service = station.fleet.get(v).service(RawMessages)
        awaited, result = await service.send(body.message, body.fields, while_armed=body.while_armed)
    entry = d.enums["MAV_RESULT"].get(result) if result is not None else None
    name = None if result is None else str(result) if entry is None else entry.name
    return json_response({"acknowledged": result is not None if awaited else None, "result": name})
