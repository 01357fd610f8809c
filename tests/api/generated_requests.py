"""Generates valid and invalid requests from the API's OpenAPI description; the same seed gives the same
requests."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote

INVALID_VALUES: list[Any] = [
    None,
    True,
    -1,
    10**30,
    0.5,
    math.nan,
    math.inf,
    "",
    "x" * 400,
    "\x00\u2028é",
    [],
    {},
    [[[[]]]],
    {"a": {"b": 1}},
]
PLAUSIBLE_TEXTS = [
    "1",
    "77",
    "motors stop, vehicle 1 falls",
    "vehicle 1 lands now",
    "hold",
    "anna",
    "a b/c",
    "%00",
    "é",
    "flight.tlog",
    "world.pmtiles",
    "world.mbtiles",
]


@dataclass
class GeneratedRequest:
    """A request to the API; it may be invalid."""

    method: str
    path: str
    query: dict[str, str] = field(default_factory=dict[str, str])
    body: bytes | None = None
    headers: dict[str, str] = field(default_factory=dict[str, str])


class RequestGenerator:
    """Generates requests.

    Args:
        description: the OpenAPI description.
        seed: seed of the random choices.
    """

    def __init__(self, description: dict[str, Any], seed: int) -> None:
        self._schemas = description["components"]["schemas"]
        self._random = random.Random(seed)

    def requests(
        self, method: str, path: str, operation: dict[str, Any], count: int
    ) -> Iterator[GeneratedRequest]:
        """Requests for one operation."""
        for number in range(count):
            is_invalid = number % 3 == 2  # every third request
            request = GeneratedRequest(method.upper(), path)
            for parameter in operation.get("parameters", []):
                text = self._parameter_text(parameter["schema"], is_invalid)
                if parameter["in"] == "path":
                    if parameter["name"] in ("v", "g") and self._random.random() < 0.8:
                        text = "1"  # vehicle 1 exists
                    request.path = request.path.replace(
                        f"{{{parameter['name']}}}", quote(text, safe="") or "1"
                    )
                elif parameter["in"] == "query" and (
                    parameter.get("required") or self._random.random() < 0.5
                ):
                    request.query[parameter["name"]] = text
            content = operation.get("requestBody", {}).get("content", {}).get("application/json")
            if content is not None:
                value = self.valid_value(content["schema"])
                request.body = json.dumps(self._invalidated(value) if is_invalid else value).encode()
            if self._random.random() < 0.05:
                request.body = self._random.choice(
                    [b"", b"{", b"\xff\xfe", b"[" * 50_000, b"9" * 5000, b"null"]
                )
            request.headers["Content-Type"] = "application/json"
            if self._random.random() < 0.05:
                request.headers["Content-Type"] = self._random.choice(
                    ["text/plain", "multipart/form-data", "a/b; é"]
                )
            if self._random.random() < 0.3:
                request.headers["Range"] = self._random.choice(
                    ["bytes=0-9", "bytes=9999999-", "bytes=-", "x=1"]
                )
            yield request

    def valid_value(self, schema: dict[str, Any], depth: int = 0) -> Any:
        """A value that the schema allows, as far as the schema can express it."""
        r = self._random
        if "$ref" in schema:
            return self.valid_value(self._schemas[schema["$ref"].rpartition("/")[2]], depth + 1)
        for key in ("anyOf", "oneOf", "allOf"):
            if key in schema:
                return self.valid_value(r.choice(schema[key]), depth + 1)
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            return r.choice(schema["enum"])
        if schema.get("examples") and r.random() < 0.3:
            return r.choice(schema["examples"])
        if schema.get("example") is not None and r.random() < 0.3:
            return schema["example"]
        json_type = schema.get("type")
        if json_type == "object":
            required = set(schema.get("required", []))
            return {
                name: self.valid_value(property_schema, depth + 1)
                for name, property_schema in schema.get("properties", {}).items()
                if name in required or r.random() < 0.5
            }
        if json_type == "array":
            min_items = schema.get("minItems", 0)
            size = r.randint(min_items, min(schema.get("maxItems", min_items + 3), min_items + 3))
            item_schemas = schema.get("prefixItems")
            return (
                [self.valid_value(item_schema, depth + 1) for item_schema in item_schemas]
                if item_schemas
                else [self.valid_value(schema.get("items", {}), depth + 1) for _ in range(size)]
            )
        if json_type in ("number", "integer"):
            low = schema.get("minimum", schema.get("exclusiveMinimum", -50))
            high = schema.get("maximum", schema.get("exclusiveMaximum", 50))
            return (
                r.randint(math.ceil(low), math.floor(high))
                if json_type == "integer"
                else r.uniform(low, high)
            )
        if json_type == "boolean":
            return r.random() < 0.5
        if json_type == "null":
            return None
        return r.choice(PLAUSIBLE_TEXTS)

    def _parameter_text(self, schema: dict[str, Any], is_invalid: bool) -> str:
        value = self._random.choice(INVALID_VALUES) if is_invalid else self.valid_value(schema)
        return value if isinstance(value, str) else json.dumps(value)

    def _invalidated(self, value: Any) -> Any:
        """A copy of the value with one error."""
        r = self._random
        if isinstance(value, dict) and value and r.random() < 0.8:
            key = r.choice(list(value))
            choice = r.random()
            if choice < 0.3:
                return {name: part for name, part in value.items() if name != key}
            if choice < 0.5:
                return {**value, r.choice(["other", "é" * 500]): r.choice(INVALID_VALUES)}
            return {**value, key: self._invalidated(value[key])}
        if isinstance(value, list) and value and r.random() < 0.6:
            index = r.randrange(len(value))
            return [*value[:index], self._invalidated(value[index]), *value[index + 1 :]]
        return r.choice(INVALID_VALUES)
