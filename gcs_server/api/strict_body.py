"""Base classes of bodies. Requests with unknown fields are refused, and numbers must be JSON numbers.

By default Pydantic reads `true` as 1.0 and `"30"` as 30, and a vehicle would climb to that altitude. With
these base classes, float fields accept any JSON number, and every other field accepts only its own JSON type.
NaN and infinity are refused.
"""

from __future__ import annotations

from typing import Any, cast

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler
from pydantic_core import CoreSchema

_SCALARS = ("float", "int", "bool", "str")


def _make_strict(node: object) -> None:
    """Marks every scalar below a node of a core schema."""
    if isinstance(node, dict):
        schema = cast(dict[str, Any], node)
        if schema.get("type") in _SCALARS:
            schema["strict"] = True
        if schema.get("type") == "float":
            schema["allow_inf_nan"] = False
        for part in schema.values():
            _make_strict(part)
    elif isinstance(node, list | tuple):
        for part in cast(list[object], node):
            _make_strict(part)


class StrictBody(BaseModel):
    """Base of all request bodies."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        # `strict=True` for the whole model would also refuse a JSON list for a tuple.
        schema = handler(source)
        _make_strict(schema)
        return schema


class ResponseBody(BaseModel):
    """Base class of response bodies, which have only the described fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")
