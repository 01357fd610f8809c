"""Completes the API description: describes the fields of plans, and adds to each operation the errors that
can occur before its route runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from gcs_server.api import refusals
from gcs_server.api.reflect import attribute_docs, field_description
from missions.values import Model

PROBLEM_JSON = "application/problem+json"
_PROBLEM = {"schema": {"$ref": "#/components/schemas/Problem"}}
_PROBLEM_SCHEMAS = ("Problem", "HTTPValidationError")

COMMON_ERRORS: dict[str, str] = {
    "400": "Not valid HTTP, or not exactly one Host header.",
    "401": "The token is missing or wrong.",
    "403": "The page belongs to another site, the Host is not this server, the Origin is missing, or the "
    "role lacks the permission.",
    **{str(refusal.status): refusal.detail for refusal in refusals.ALL if refusal.status not in (400, 503)},
    "422": "Invalid request; names the field.",
    "503": f"The link to the vehicle was lost, or: {refusals.SERVER_FULL.detail}",
}
"""Description of each error, by HTTP status."""


def describe_refusals(openapi: dict[str, Any]) -> None:
    """Describes all errors as problem+json, and adds the errors of access control and of the limits to each
    operation."""
    openapi["components"]["responses"] = {
        f"Refused{status}": {"description": text, "content": {PROBLEM_JSON: _PROBLEM}}
        for status, text in COMMON_ERRORS.items()
    }
    openapi["components"]["responses"]["Refused401"]["content"]["text/html"] = {"schema": {"type": "string"}}
    for operations in openapi["paths"].values():
        for operation in operations.values():
            responses = cast("dict[str, dict[str, Any]]", operation["responses"])
            for response in responses.values():
                if _is_problem(response):
                    response["content"] = {PROBLEM_JSON: _PROBLEM}
            common = {status: {"$ref": f"#/components/responses/Refused{status}"} for status in COMMON_ERRORS}
            operation["responses"] = dict(sorted({**responses, **common}.items()))
    schemas = openapi["components"]["schemas"]
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)


def flatten_unions(openapi: dict[str, Any]) -> None:
    """Flattens nested discriminated unions, because OpenAPI has none."""
    schemas = openapi["components"]["schemas"]

    def branches(schema: dict[str, Any]) -> list[dict[str, Any]]:
        parts = cast("list[dict[str, Any]]", schema.get("oneOf") or schema.get("anyOf") or [])
        return [each for part in parts for each in branches(part)] if parts else [schema]

    def walk(node: Any) -> None:
        if isinstance(node, list):
            for part in cast("list[Any]", node):
                walk(part)
        elif isinstance(node, dict):
            schema = cast("dict[str, Any]", node)
            discriminator = schema.get("discriminator")
            if isinstance(discriminator, dict) and not all(
                isinstance(v, str) for v in discriminator.get("mapping", {}).values()
            ):
                flat = branches(schema)
                schema.pop("anyOf", None)
                schema["oneOf"] = flat
                kinds = [schemas[each["$ref"].rpartition("/")[2]]["properties"] for each in flat]
                discriminator["mapping"] = {
                    kind[discriminator["propertyName"]]["const"]: each["$ref"]
                    for kind, each in zip(kinds, flat, strict=True)
                }
            for part in schema.values():
                walk(part)

    walk(openapi)


def rename_schemas(openapi: dict[str, Any], new_names: Mapping[str, str]) -> None:
    """Renames schemas, also in all references to them."""
    prefix = "#/components/schemas/"
    references = {prefix + old: prefix + new for old, new in new_names.items()}

    def renamed(node: Any) -> Any:
        if isinstance(node, list):
            return [renamed(part) for part in cast("list[Any]", node)]
        if isinstance(node, dict):
            return {key: renamed(part) for key, part in cast("dict[str, Any]", node).items()}
        return references.get(node, node) if isinstance(node, str) else node

    openapi["paths"] = renamed(openapi["paths"])
    schemas = {new_names.get(name, name): renamed(schema) for name, schema in _schemas(openapi).items()}
    for name in new_names.values():
        if name in schemas:
            schemas[name]["title"] = name
    openapi["components"]["schemas"] = dict(sorted(schemas.items()))


def _schemas(openapi: dict[str, Any]) -> dict[str, Any]:
    return openapi["components"]["schemas"]


def describe_plans(openapi: dict[str, Any]) -> None:
    """Describes the fields of plans by their docstrings, or else by name, frame and unit."""
    schemas = openapi["components"]["schemas"]
    for model in _all_subclasses(Model):
        full_name = f"{model.__module__}.{model.__name__}".replace(".", "__")  # for models that share a name
        fields = (schemas.get(model.__name__) or schemas.get(full_name) or {}).get("properties", {})
        # The last three classes are Model, Pydantic's BaseModel and object.
        docs = {name: text for base in model.__mro__[:-3] for name, text in _docs(base).items()}
        for name, field in fields.items():
            if not {"description", "const", "$ref"} & set(field):
                field["description"] = docs.get(name) or field_description(name)


def _docs(model: type) -> dict[str, str]:
    return attribute_docs(model) if model.__module__.startswith("missions.") else {}


def _all_subclasses(base: type) -> list[type]:
    direct = base.__subclasses__()
    return [*direct, *(indirect for subclass in direct for indirect in _all_subclasses(subclass))]


def _is_problem(response: dict[str, Any]) -> bool:
    schema = response.get("content", {}).get("application/json", {}).get("schema", {})
    return str(schema.get("$ref", "")).rpartition("/")[2] in _PROBLEM_SCHEMAS
