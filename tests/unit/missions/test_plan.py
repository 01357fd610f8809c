"""The plan document: refused values, and their error messages."""

from __future__ import annotations

import json

import pytest

from missions import plan
from missions.errors import PlanError
from missions.items import Jump, Takeoff, Waypoint
from missions.plan import Plan
from missions.values import Altitude, FencePolygon, HomePosition, Point


def an_altitude(value_m: float = 20.0) -> Altitude:
    return Altitude(value_m=value_m, reference="home")


def a_plan() -> Plan:
    return Plan(
        planned_home=HomePosition(lat_deg=47.0, lon_deg=8.0, alt_amsl_m=480.0),
        items=(
            Takeoff(lat_deg=47.0, lon_deg=8.0, altitude=an_altitude()),
            Waypoint(lat_deg=47.001, lon_deg=8.0, altitude=an_altitude()),
            Jump(target_index=1, repeat=2),
        ),
        fence=(
            FencePolygon(
                inclusion=True,
                polygon=tuple(Point(lat_deg=lat, lon_deg=lon) for lat, lon in ((46, 7), (48, 7), (48, 9))),
            ),
        ),
    )


def plan_json_with(path: list[str | int], value: object) -> bytes:
    """The plan's JSON with one value replaced."""
    document = json.loads(plan.write(a_plan()))
    part = document
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    return json.dumps(document).encode()


def test_a_written_plan_is_read_unchanged() -> None:
    assert plan.read(plan.write(a_plan())) == a_plan()


@pytest.mark.parametrize(
    ("path", "value", "place", "reason"),
    [
        (["items", 1, "lat_deg"], 95.0, "item 2 (waypoint), field lat_deg", "less than or equal to 90"),
        (["items", 1, "lat_deg"], "47", "item 2 (waypoint), field lat_deg", "valid number"),
        (["items", 1, "hold_s"], True, "item 2 (waypoint), field hold_s", "valid number"),
        (["items", 1, "hold_s"], 1e308, "item 2 (waypoint), field hold_s", "less than or equal"),
        (["items", 0, "altitude"], 20, "item 1 (takeoff), field altitude", "should be an object"),
        (
            ["items", 0, "altitude", "reference"],
            "agl",
            "item 1 (takeoff), field altitude.reference",
            "'home', 'amsl'",
        ),
        (["items", 1, "colour"], "red", "item 2 (waypoint), field colour", "not permitted"),
        (["items", 1, "kind"], "teleport", "item 2", "'waypoint'"),
        (["items", 2, "target_index"], 1.5, "item 3 (jump), field target_index", "valid integer"),
        (["fence", 0, "polygon"], [], "geofence zone 1 (polygon), field polygon", "at least 3"),
        (["planned_home", "alt_amsl_m"], None, "field planned_home.alt_amsl_m", "valid number"),
        (["surprise"], 1, "field surprise", "not permitted"),
    ],
)
def test_the_error_for_an_invalid_value_names_its_item_and_field(
    path: list[str | int], value: object, place: str, reason: str
) -> None:
    with pytest.raises(PlanError) as caught:
        plan.read(plan_json_with(path, value))
    assert caught.value.place == place
    assert reason in caught.value.reason
    assert caught.value.fix.endswith(".")


def test_more_items_than_the_vehicle_can_store_are_refused() -> None:
    too_long_plan = a_plan().model_copy(
        update={"items": (Jump(target_index=0, repeat=1),) * (plan.MAX_ITEMS + 1)}
    )
    with pytest.raises(PlanError, match="Split the plan"):
        plan.read(plan.write(too_long_plan))


def test_an_altitude_is_converted_to_amsl_only_if_its_reference_is_known() -> None:
    assert Altitude(value_m=20.0, reference="home").amsl_m(480.0) == 500.0
    assert Altitude(value_m=20.0, reference="home").amsl_m(None) is None
    assert Altitude(value_m=20.0, reference="amsl").amsl_m(None) == 20.0
    assert Altitude(value_m=20.0, reference="terrain").amsl_m(480.0) is None
    assert Altitude(value_m=20.0, reference="terrain", resolved_amsl_m=512.0).amsl_m(480.0) == 512.0
