"""Pydantic models of dataclasses for the OpenAPI description, so that fields, units and descriptions are
written once.

Descriptions are the attribute docstrings of the class, or else derived from the frame and unit in the name.
They are read when the API is described, because reading all sources would take a fifth of the server's
start. Responses themselves are encoded by msgspec (`telemetry/wire.py`) and never pass through these models.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import sys
import typing
from typing import Any

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, create_model
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

_UNITS = {
    "_rad_s": "[rad/s]",
    "_m_s2": "[m/s²]",
    "_m_s": "[m/s]",
    "_deg_s": "[deg/s]",
    "_unix_s": "[s since 1970 UTC]",
    "_hz": "[Hz]",
    "_rad": "[rad]",
    "_deg": "[deg]",
    "_percent": "[%]",
    "_mah": "[mAh]",
    "_us": "[µs]",
    "_m": "[m]",
    "_s": "[s]",
    "_v": "[V]",
    "_a": "[A]",
}
_FRAMES = {
    "_ned_frd": "taking body FRD to NED, order w, x, y, z",
    "_ned": "north, east, down of the local origin",
    "_frd": "forward, right, down of the body",
    "_amsl": "above mean sea level",
    "_home": "above home",
}


def field_description(name: str) -> str:
    """Description of a field without a docstring: its name, frame and unit."""
    unit = next((text for suffix, text in _UNITS.items() if name.endswith(suffix)), "")
    frame = next((text for part, text in _FRAMES.items() if f"{part}_" in f"{name}_"), "")
    description = name
    for suffix in _UNITS:
        if unit and name.endswith(suffix):
            description = name[: -len(suffix)]
            break
    label = description.replace("_", " ").capitalize()
    return " ".join(part for part in (label, f"({frame})" if frame else "", unit) if part) + "."


_SOURCES: dict[type, type] = {}
"""The dataclass of each model that `model_of` has made."""


def attribute_docs(cls: type) -> dict[str, str]:
    """The docstrings of the attributes of a class and of its base dataclasses; each field of a model of a
    dataclass has a description."""
    source = _SOURCES.get(cls)
    if source is not None:
        return {each.name: field_description(each.name) for each in dataclasses.fields(source)} | (
            attribute_docs(source)
        )
    docs: dict[str, str] = {}
    for base in cls.__bases__:
        if dataclasses.is_dataclass(base) or issubclass(base, BaseModel):
            docs |= attribute_docs(base)
    tree = _classes(cls.__module__).get(cls.__qualname__)
    if tree is None:  # made by a function
        return docs
    for before, after in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(before, ast.AnnAssign)
            and isinstance(before.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
            and isinstance(after.value.value, str)
        ):
            docs[before.target.id] = inspect.cleandoc(after.value.value)
    return docs


class Described(BaseModel):
    """Describes each field by the docstring below it, when the API is described."""

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        reference = handler(core_schema)
        properties = handler.resolve_ref_schema(reference).get("properties", {})
        describe_properties(properties, attribute_docs(cls))
        return reference


def describe_properties(properties: dict[str, Any], docs: dict[str, str]) -> None:
    """Describes the properties of a JSON schema that have no description."""
    for name, text in docs.items():
        if name in properties:
            properties[name].setdefault("description", text)


@functools.cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """The syntax trees of a module's classes."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}


class _Reflected(Described):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


def model_of(dataclass_type: type, name: str | None = None, **overrides: Any) -> type[BaseModel]:
    """Creates a model with the fields of a dataclass.

    Args:
        dataclass_type: the dataclass.
        name: name of the schema; default: the class's name.
        overrides: other types for some fields, and the types of further fields.
    """
    hints = typing.get_type_hints(dataclass_type)
    own = {field.name: hints[field.name] for field in dataclasses.fields(dataclass_type)}
    fields: dict[str, Any] = {name: (kind, ...) for name, kind in (own | overrides).items()}
    model = create_model(
        name or dataclass_type.__name__, __base__=_Reflected, __doc__=dataclass_type.__doc__, **fields
    )
    _SOURCES[model] = dataclass_type
    return model
