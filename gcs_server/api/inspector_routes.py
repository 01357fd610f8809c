"""Routes of the MAVLink inspector: what arrives of a vehicle, plotted fields, the dialect, and sending."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query, Response
from pydantic import Field

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.control.accepted import authorized_command
from gcs_server.control.commands import BY_NAME
from gcs_server.logbook.expressions import MAX_LENGTH
from gcs_server.logbook.live import LiveSeries, LiveValues, live_values
from gcs_server.mavlink import definitions
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.services.inspector import (
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
LiveSeriesModel = model_of(LiveSeries, "LiveSeries")
LiveValuesModel = model_of(LiveValues, "LiveValues", series=tuple[LiveSeriesModel, ...])
EnumValueModel = model_of(definitions.EnumValue, "EnumValue")
MessageFieldModel = model_of(definitions.MessageField, "MessageField", values=tuple[EnumValueModel, ...])
MessageDefinitionModel = model_of(
    definitions.MessageDefinition, "MessageDefinition", fields=tuple[MessageFieldModel, ...]
)
MAX_FIELDS = 32
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


@router.get("/vehicles/{v}/mavlink/series", response_model=LiveValuesModel)
async def series(
    vehicle: VehicleDep,
    field: Annotated[
        list[Annotated[str, Field(max_length=MAX_LENGTH)]],
        Query(
            min_length=1,
            max_length=MAX_FIELDS,
            description="`message:system.component/name`, `name[index]` of an array, or an expression with "
            "such names in braces; repeated for several.",
        ),
    ],
    after: Annotated[
        int, Query(ge=0, le=2**53, description="`after` of the last answer; 0: all that is kept.")
    ] = 0,
) -> Response:
    """All values of numbers of the vehicle's messages at their full rate, those that arrived since an answer;
    of a message with several instances (batteries) those of one by `message:system.component.instance`. The
    same expressions as in a log. The server keeps messages from the first request on, while it is asked: the
    newest 500 of each of 64 kinds. An answer has the values of at most 1,500 messages, and `more` if there
    are others."""
    inspector = vehicle.service(MessageInspector)
    return json_response(live_values(inspector, vehicle.identity.system_id, field, after))


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
