"""Numbers in request bodies must be numbers: true, "30", NaN and infinity are refused."""

import copy
import json

import pytest
from fastapi.routing import APIRoute
from pydantic import BaseModel, TypeAdapter, ValidationError

from gcs_server.api.schema import api_routes
from gcs_server.api.setpoints import SetpointRequest
from gcs_server.api.strict_body import StrictBody
from missions.values import Model
from tests.support.api_client import api_client

NOT_NUMBERS = {
    "true": True,
    "false": False,
    "text": "5",
    "empty text": "",
    "list": [5],
    "NaN": float("nan"),
    "Infinity": float("inf"),
    "-Infinity": float("-inf"),
    "1e400": json.loads("1e400"),
    "400 digits": 10**400,
}


def body_adapters():
    routes = [route for route in api_routes() if isinstance(route, APIRoute)]
    return [
        (route.path, TypeAdapter(route.body_field.field_info.annotation))
        for route in routes
        if route.body_field is not None
    ]


def models_of(schema, found_models):
    """Every model class below a core schema."""
    if isinstance(schema, dict):
        model = schema.get("cls")
        if schema.get("type") == "model" and isinstance(model, type) and issubclass(model, BaseModel):
            found_models.add(model)
        for part in schema.values():
            models_of(part, found_models)
    elif isinstance(schema, list | tuple):
        for part in schema:
            models_of(part, found_models)
    return found_models


def number_nodes(schema, strict=False):
    """Every number and boolean of a core schema; each is strict itself or part of a strict model."""
    if isinstance(schema, dict):
        strict = strict or bool((schema.get("config") or {}).get("strict"))
        if schema.get("type") in ("float", "int", "bool"):
            assert strict or schema.get("strict") is True, schema
            yield schema
        for part in schema.values():
            yield from number_nodes(part, strict)
    elif isinstance(schema, list | tuple):
        for part in schema:
            yield from number_nodes(part, strict)


ADAPTERS = [*body_adapters(), ("WS …/offboard/stream", TypeAdapter(SetpointRequest))]


def all_models():
    models = set()
    for _, adapter in ADAPTERS:
        models_of(adapter.core_schema, models)
    return sorted(models, key=lambda model: model.__name__)


def test_each_number_of_each_body_is_strict():
    assert len(ADAPTERS) > 20
    models = all_models()
    assert len(models) > 40
    document_models = [m for m in models if issubclass(m, Model)]
    assert [m.__name__ for m in models if not issubclass(m, StrictBody) and m not in document_models] == []
    assert [m.__name__ for m in document_models if not m.model_config["strict"]] == []
    numbers = [node for _, adapter in ADAPTERS for node in number_nodes(adapter.core_schema)]
    assert len(numbers) > 100
    floats = [node for node in numbers if node["type"] == "float"]
    assert [node for node in floats if node.get("allow_inf_nan") is not False] == []


def number_paths(value, path=()):
    """Paths of the numbers in an example."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield path
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from number_paths(part, (*path, key))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from number_paths(part, (*path, index))


def examples():
    for model in all_models():
        extra = model.model_config.get("json_schema_extra")
        if isinstance(extra, dict):
            for example in extra.get("examples", [extra.get("example")]):
                yield model, example


def with_value(example, path, value):
    copy_of_example = copy.deepcopy(example)
    parent = copy_of_example
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = value
    return copy_of_example


WHOLE_NUMBERS = (
    "bytes",
    "version",
    "item",
    "min_zoom",
    "max_zoom",
    "zoom",
    "axis",
    "button",
    "number",
    "point",
)
"""Fields that accept no float, not even a whole one."""


@pytest.mark.parametrize("name", list(NOT_NUMBERS))
def test_values_that_are_not_numbers_are_refused_in_every_field(name):
    count = 0
    for model, example in examples():
        model.model_validate(example)
        for path in number_paths(example):
            if "t_s" not in path and path[-1] not in WHOLE_NUMBERS:
                model.model_validate(with_value(example, path, example_number(example, path)))
            count += 1
            with pytest.raises(ValidationError):
                model.model_validate(with_value(example, path, NOT_NUMBERS[name]))
    assert count > 40


def example_number(example, path):
    """The number at this path as a float: a float field also accepts whole numbers."""
    value = example
    for key in path:
        value = value[key]
    return float(value)


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with api_client(tmp_path_factory.mktemp("data"), raise_server_exceptions=False) as client:
        yield client


@pytest.mark.parametrize(
    "text", ["true", '"30"', "NaN", "Infinity", "-Infinity", "1e400", "9" * 400, "9" * 5000, "[" * 5000]
)
@pytest.mark.parametrize(
    ("path", "body", "field"),
    [
        ("takeoff", '{"alt_home_m": %s}', "alt_home_m"),
        ("goto", '{"lat_deg": 47, "lon_deg": 8, "alt_home_m": %s}', "alt_home_m"),
        ("gimbal/angles", '{"pitch_deg": %s, "yaw_deg": 0}', "pitch_deg"),
        (
            "offboard/setpoint",
            '{"setpoint": {"type": "position", "position_ned_m": [0, %s, -5]}}',
            "setpoint.position_ned_m.1",
        ),
    ],
)
def test_an_invalid_number_in_a_request_gets_an_error_that_names_the_field(client, path, body, field, text):
    response = client.post(
        f"/api/v1/vehicles/1/{path}", content=body % text, headers={"Content-Type": "application/json"}
    )
    assert response.status_code in (400, 422)
    if text[:2] not in ("99", "[["):  # the JSON parser may refuse these bodies
        assert response.status_code == 422
        assert response.json()["field"] == field
