"""Base classes of bodies. Requests with unknown fields are refused, and numbers must be JSON numbers.

By default Pydantic reads `true` as 1.0 and `"30"` as 30, and a vehicle would climb to that altitude. With
these base classes, float fields accept any JSON number, and every other field accepts only its own JSON type.
NaN and infinity are refused.
"""

from __future__ import annotations

from typing import Annotated, Any, cast

from pydantic import ConfigDict, Field, GetCoreSchemaHandler, JsonValue
from pydantic_core import CoreSchema

from gcs_server.api.reflect import Described

_SCALARS = ("float", "int", "bool", "str")
Latitude = Annotated[float, Field(ge=-90, le=90, description="Degrees north, WGS 84.")]
Longitude = Annotated[float, Field(ge=-180, le=180, description="Degrees east, WGS 84.")]


def example(**fields: JsonValue) -> ConfigDict:
    """An example of the body, for the API reference."""
    examples: list[JsonValue] = [fields]
    return ConfigDict(json_schema_extra={"examples": examples})


def make_strict(node: object, handler: GetCoreSchemaHandler | None = None) -> None:
    """Marks every scalar below a node of a core schema; with the schema's handler, also in other classes."""
    if isinstance(node, dict):
        schema = cast(dict[str, Any], node)
        if handler is not None and schema.get("type") == "definition-ref":
            schema = cast(dict[str, Any], handler.resolve_ref_schema(cast(CoreSchema, schema)))
        if schema.get("type") in _SCALARS:
            schema["strict"] = True
        if schema.get("type") == "float":
            schema["allow_inf_nan"] = False
        for part in schema.values():
            make_strict(part, handler)
    elif isinstance(node, list | tuple):
        for part in cast(list[object], node):
            make_strict(part, handler)


class StrictBody(Described):
    """Base of all request bodies."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        # `strict=True` for the whole model would also refuse a JSON list for a tuple.
        schema = handler(source)
        make_strict(schema)
        return schema


class ResponseBody(Described):
    """Base class of response bodies, which have only the described fields. Their schemas are built for the
    API's description only."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
