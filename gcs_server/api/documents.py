"""Documents in the bodies of requests: they stay JSON text, which only plan work reads (`plans/work.py`),
because a large one would keep the event loop busy for a fifth of a second.

A route with such a body belongs to a router with `route_class=DocumentRoute`.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Coroutine
from typing import Annotated, Any, ClassVar, Self

import msgspec
from fastapi import Request, Response
from fastapi.routing import APIRoute
from pydantic import Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema
from starlette.types import Receive, Scope

from gcs_server.api.json_limits import REFUSED_REMEDY, json_fault
from gcs_server.api.strict_body import StrictBody
from gcs_server.errors import InvalidRequest
from gcs_server.flights.chosen import PlanSource
from gcs_server.plans.work import UnreadDocument
from missions import documents
from missions.documents import Document, PlanKind
from missions.offboard.document import OffboardMission
from missions.pattern_settings import PatternDocument
from missions.plan import Plan

FIELDS = frozenset({"plan", "mission"})
"""Names of the fields with a document."""
MAX_OTHER_BYTES = 65_536
"""Maximum size of the other fields of such a body."""


class _UnreadAs:
    """Annotation of a field with a document; the API description shows the document's type."""

    def __init__(self, document_type: Any, kind: PlanKind | None) -> None:
        self._document_type = document_type
        self._kind: PlanKind | None = kind

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        described = handler.generate_schema(self._document_type)
        return core_schema.no_info_wrap_validator_function(self._keep, described)

    def _keep(self, value: object, _: object) -> UnreadDocument:
        if isinstance(value, UnreadDocument):
            return UnreadDocument(value.text, self._kind)
        if isinstance(value, Plan | OffboardMission):
            return UnreadDocument(documents.write(value), self._kind)
        return UnreadDocument(msgspec.json.encode(value), self._kind)


PlanBody = Annotated[
    UnreadDocument,
    _UnreadAs(Plan, "waypoint_plan"),
    Field(description="The plan's document (docs/missions.md)."),
]
MissionBody = Annotated[
    UnreadDocument,
    _UnreadAs(OffboardMission, "offboard_mission"),
    Field(description="An offboard mission's document (docs/missions.md)."),
]
DocumentBody = Annotated[
    UnreadDocument,
    _UnreadAs(Document, None),
    Field(description="A waypoint plan or an offboard mission, depending on `format` (docs/missions.md)."),
]


PatternBody = Annotated[UnreadDocument, _UnreadAs(PatternDocument, None)]
"""A whole body that is a pattern."""


class SourceBody(StrictBody):
    """A request with a plan that is stored on the server, or a document in its field `DOCUMENT`."""

    DOCUMENT: ClassVar[str] = "plan"

    plan_id: str | None = Field(default=None, max_length=40)
    """Id of a stored plan."""
    version: int | None = Field(default=None, ge=1)
    """Version of that plan; default: the newest."""

    @model_validator(mode="after")
    def _check_one_plan(self) -> Self:
        if (self.plan_id is None) == (getattr(self, self.DOCUMENT) is None):
            raise ValueError(f"give exactly one of plan_id and {self.DOCUMENT}")
        if self.version is not None and self.plan_id is None:
            raise ValueError("version belongs to plan_id")
        return self

    @property
    def source(self) -> PlanSource:
        """Where the plan comes from."""
        return PlanSource(self.plan_id, self.version, getattr(self, self.DOCUMENT), self.DOCUMENT)


class _DocumentRequest(Request):
    """A request whose JSON is parsed without its documents.

    Args:
        is_document: whether the whole body is a document.
    """

    def __init__(self, scope: Scope, receive: Receive, *, is_document: bool) -> None:
        super().__init__(scope, receive)
        self._is_document = is_document

    async def json(self) -> Any:
        """The fields of the body; documents as `UnreadDocument`. Raises json.JSONDecodeError."""
        body = await self.body()
        if self._is_document:
            return UnreadDocument(body)
        try:
            fields = msgspec.json.decode(body, type=_Fields)
        except (msgspec.DecodeError, RecursionError) as error:
            return _small_json(body, str(error))
        return {name: _value(name, bytes(raw)) for name, raw in fields.items()}

    async def require_small_fields(self) -> None:
        """Raises InvalidRequest if the fields beside the documents are too large."""
        body = await self.body()
        if len(body) <= MAX_OTHER_BYTES or self._is_document:
            return
        with contextlib.suppress(msgspec.DecodeError, RecursionError):
            fields = msgspec.json.decode(body, type=_Fields)
            others = b",".join(bytes(raw) for name, raw in fields.items() if name not in FIELDS)
            if len(others) + sum(map(len, fields)) > MAX_OTHER_BYTES:
                fault = f"the fields beside the document are larger than {MAX_OTHER_BYTES:,} bytes"
            else:
                fault = json_fault(others)
            if fault is not None:
                raise InvalidRequest("body", f"The request body was refused: {fault}.", remedy=REFUSED_REMEDY)


_Fields = dict[str, msgspec.Raw]


def _small_json(body: bytes, problem: str) -> Any:
    """The value of a body that is not an object; raises JSONDecodeError if it is not JSON."""
    text = body[:MAX_OTHER_BYTES].decode(errors="replace")
    try:
        value = json.loads(text)
    except RecursionError:
        raise json.JSONDecodeError("it is nested too deep", "", 0) from None
    if isinstance(value, dict):
        raise json.JSONDecodeError(problem, "", 0)  # JSON has no NaN, which Python reads
    return value


def _value(name: str, raw: bytes) -> Any:
    if name in FIELDS and raw != b"null":
        return UnreadDocument(raw)
    return json.loads(raw)


class DocumentRoute(APIRoute):
    """A route whose body contains a document."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler, with a request that leaves documents unread."""
        handler = super().get_route_handler()
        is_document = self.body_field is not None and self.body_field.field_info.annotation is UnreadDocument

        async def handle(request: Request) -> Response:
            document_request = _DocumentRequest(request.scope, request.receive, is_document=is_document)
            await document_request.require_small_fields()
            return await handler(document_request)

        return handle
