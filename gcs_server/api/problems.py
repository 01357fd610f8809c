"""Converts all errors to HTTP responses: problem+json (RFC 9457) with field, reason and remedy."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from gcs_server.api.headers import security_headers
from gcs_server.errors import (
    ClientHasTooMany,
    Disconnected,
    GcsError,
    Interrupted,
    InvalidRequest,
    LinkError,
    LogUnusable,
    NoReply,
    NotInControl,
    NotPermitted,
    PlanConflict,
    RecordingUnusable,
    Refused,
    Rejected,
    ServerBusy,
    UnknownDryRun,
    UnknownFlight,
    UnknownGroup,
    UnknownLink,
    UnknownOperation,
    UnknownPlan,
    UnknownProof,
    UnknownRecording,
    UnknownVehicle,
)
from gcs_server.maps.sources import UnknownSource
from gcs_server.maps.tiles import MapSourceFailed
from gcs_server.storage.maps import MapError
from gcs_server.telemetry.wire import encode
from gcs_server.vehicle.services.ftp_codec import FtpFailed
from gcs_server.vehicle.services.metadata import MetadataMissing
from missions.setpoints import KINDS

log = logging.getLogger(__name__)

UNION_TAGS = frozenset(KINDS) | {"hold", "land", "stop_stream", "polygon", "circle"}
"""Names of union branches, which Pydantic adds to the paths of fields."""

MAX_ERRORS = 20
"""Maximum number of invalid values in one response."""
MAX_VALUE_LENGTH = 300
RETRY_AFTER_S = 2

_STATUS: tuple[tuple[type[GcsError], int, str], ...] = (
    (UnknownVehicle, 404, "Unknown vehicle"),
    (UnknownGroup, 404, "Unknown group"),
    (UnknownLink, 404, "Unknown link"),
    (UnknownOperation, 404, "Unknown operation"),
    (UnknownPlan, 404, "Unknown plan"),
    (UnknownDryRun, 404, "Unknown dry run"),
    (UnknownProof, 404, "Unknown proof"),
    (UnknownRecording, 404, "Unknown recording"),
    (RecordingUnusable, 409, "Recording unusable"),
    (UnknownFlight, 404, "Unknown flight"),
    (LogUnusable, 409, "Log unusable"),
    (MapError, 409, "Map unusable"),
    (UnknownSource, 404, "Unknown map source"),
    (MapSourceFailed, 502, "The map source does not answer"),
    (PlanConflict, 409, "Changed by another client"),
    (InvalidRequest, 422, "Invalid request"),
    (NotPermitted, 403, "Not permitted"),
    (Rejected, 409, "The vehicle refused"),
    (NotInControl, 409, "Another client has control"),
    (ClientHasTooMany, 429, "Too many requests"),
    (ServerBusy, 503, "The server is busy"),
    (Interrupted, 409, "Interrupted"),
    (Refused, 409, "Not sent"),
    (FtpFailed, 409, "The vehicle's file could not be read"),
    (MetadataMissing, 409, "No component metadata"),
    (NoReply, 504, "No answer"),
    (Disconnected, 503, "No connection to the vehicle"),
    (LinkError, 409, "Link unusable"),
)


class FieldError(BaseModel):
    """One invalid value."""

    model_config = ConfigDict(frozen=True)

    field: str = Field(description="Path of the value in the request, joined by dots.")
    message: str = Field(description="What is wrong with the value.")


class Problem(BaseModel):
    """Why a request was not executed."""

    model_config = ConfigDict(frozen=True)

    type: str = Field(description="Identifier of this kind of problem, as a URI reference.")
    title: str = Field(description="The kind of problem in a few words.")
    status: int = Field(description="The HTTP status.")
    code: str = Field(
        description="Code of this kind of problem, for programs: refused, rejected, no_reply, …"
    )
    detail: str = Field(description="What happened and why.")
    remedy: str | None = Field(default=None, description="What the operator can do about it.")
    field: str | None = Field(default=None, description="With 422: the first invalid field.")
    errors: list[FieldError] | None = Field(default=None, description="With 422: all invalid fields.")
    reasons: list[str] | None = Field(default=None, description="Texts from the vehicle.")
    mav_result: int | None = Field(default=None, description="MAV_RESULT of the vehicle's acknowledgement.")
    vehicle: str | None = Field(default=None, description="With an unknown vehicle: the id.")
    holder: str | None = Field(
        default=None, description="With `not_in_control`: name of the client in control."
    )
    holder_key: str | None = Field(default=None, description="Distinguishes clients with the same name.")
    permission: str | None = Field(default=None, description="With `not_permitted`: the missing permission.")
    vehicles: list[str] | None = Field(
        default=None, description="With `not_together`: ids of the vehicles that prevent the group's start."
    )
    distance_m: float | None = Field(
        default=None,
        description="With `not_together`: the smallest distance that two members would have [m].",
    )
    plan: str | None = Field(default=None, description="With `conflict`: the plan's id.")
    version: int | None = Field(default=None, description="With `conflict`: the plan's newest version.")
    changed_by: str | None = Field(
        default=None, description="With `conflict`: name of the client that saved that version."
    )
    changed_unix_s: float | None = Field(
        default=None, description="With `conflict`: time at which that version was saved [s since 1970 UTC]."
    )
    codes: list[str] | None = Field(
        default=None, description="With `plan_findings`: the codes to list in `despite`."
    )
    deadline_s: float | None = Field(default=None, description="With 504: how long the server waited [s].")


RESPONSES: dict[int | str, dict[str, object]] = {
    status: {"model": Problem, "description": text}
    for status, text in (
        (404, "No such vehicle, group, link, plan, recording or operation."),
        (409, "Refused by this server or by the vehicle, with the reason."),
        (422, "Invalid request; names the field."),
        (503, "The link to the vehicle was lost."),
        (504, "The vehicle did not answer."),
    )
}


def status_of(error: GcsError) -> tuple[int, str]:
    """HTTP status and title of the response to an error."""
    for error_type, status, title in _STATUS:
        if isinstance(error, error_type):
            return status, title
    return 500, "The server failed"


def problem(status: int, title: str, code: str, detail: str, **more: object) -> Response:
    """A problem+json response; fields that are None are left out."""
    body = _body(status, title, code, detail, more)
    return Response(encode(body), status_code=status, media_type="application/problem+json")


def problem_of(error: GcsError) -> dict[str, object]:
    """An error's problem+json inside another document, such as an operation or an event."""
    status, title = status_of(error)
    return _body(status, title, error.code, error.message, {"remedy": error.remedy, **error.details()})


def _body(status: int, title: str, code: str, detail: str, more: Mapping[str, object]) -> dict[str, object]:
    body = {"type": f"/problems/{code}", "title": title, "status": status, "code": code, "detail": detail}
    return body | {key: value for key, value in more.items() if value is not None}


def validation_errors(error: RequestValidationError) -> list[dict[str, str]]:
    """(field, message) of the first invalid values; the names of union branches are left out of the path."""
    field_errors: list[dict[str, str]] = []
    errors = [
        item for item in error.errors() if item["type"] != "too_short" or not _is_consequence(item, error)
    ]
    for item in errors[:MAX_ERRORS]:
        parts = [str(part) for part in item["loc"]]
        if len(parts) > 1 and parts[0] in ("body", "query", "path", "header"):
            parts = parts[1:]
        parts = [part for part in parts if part not in UNION_TAGS]
        message = str(item["msg"]).removeprefix("Value error, ")
        if item["type"] == "unexpected_keyword_argument":  # a setpoint is a dataclass
            message = "Extra inputs are not permitted"
        if item["type"] == "json_invalid":
            parts, message = ["body"], f"not JSON: {item.get('ctx', {}).get('error', message)}"
        if item["type"] == "document_field":
            parts = [item["ctx"]["field"]]
        field_errors.append({"field": _shortened(".".join(parts) or "body"), "message": _shortened(message)})
    if len(errors) > MAX_ERRORS:
        field_errors.append(
            {"field": "body", "message": f"and {len(errors) - MAX_ERRORS} more invalid values"}
        )
    return field_errors


def _is_consequence(item: dict[str, Any], error: RequestValidationError) -> bool:
    """Whether a list counts as too short only because validation stopped at its first invalid item."""
    path = tuple(item["loc"])
    return any(other["loc"][: len(path)] == path and other is not item for other in error.errors())


def _shortened(text: str) -> str:
    """Shortens names and values from the client, which may have any length."""
    return text if len(text) <= MAX_VALUE_LENGTH else f"{text[:MAX_VALUE_LENGTH]}…"


def install(app: FastAPI) -> None:
    """Registers the handlers that turn every error into problem+json."""

    async def gcs_error(_: Request, error: Exception) -> Response:
        assert isinstance(error, GcsError)
        status, title = status_of(error)
        response = problem(status, title, error.code, error.message, remedy=error.remedy, **error.details())
        if isinstance(error, ClientHasTooMany | ServerBusy):
            response.headers["Retry-After"] = str(RETRY_AFTER_S)
        return response

    async def invalid_request(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        errors = validation_errors(error)
        detail = "; ".join(f"{e['field']}: {e['message']}" for e in errors)
        record_invalid_request = getattr(request.app.state, "record_invalid_request", None)
        if record_invalid_request is not None:
            record_invalid_request(request, detail)
        return problem(
            422, "Invalid request", "invalid_request", detail, field=errors[0]["field"], errors=errors
        )

    async def http_error(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        code = {404: "not_found", 405: "method_not_allowed"}.get(error.status_code, "http_error")
        detail = f"{request.method} {request.url.path}: {error.detail}"
        return problem(error.status_code, str(error.detail), code, detail)

    async def unexpected_error(request: Request, error: Exception) -> Response:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        response = problem(
            500,
            "The server failed",
            "internal",
            f"{type(error).__name__} while handling {request.method} {request.url.path}.",
            remedy="Check the vehicle's state before you try again; the server's log has the details.",
        )
        response.headers.update(security_headers(request.scope))  # no middleware processes this response
        return response

    app.add_exception_handler(GcsError, gcs_error)
    app.add_exception_handler(RequestValidationError, invalid_request)
    app.add_exception_handler(HTTPException, http_error)
    app.add_exception_handler(Exception, unexpected_error)
