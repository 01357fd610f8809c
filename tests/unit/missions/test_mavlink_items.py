"""Plans are converted to MAVLink mission items and back; the items match the dialect."""

from __future__ import annotations

import inspect
import math

import pytest
from hypothesis import given, settings

from gcs_server.mavlink import dialect
from missions.camera_items import Digicam
from missions.errors import PlanError
from missions.formats import mavlink_items
from missions.formats.mavlink_items import WireItem
from missions.items import CommandItem, Waypoint
from missions.plan import TYPED_ITEMS, Plan
from missions.values import Altitude
from tests.support.plan_strategies import plans


def test_constants_match_the_dialect() -> None:
    names = [name for name, _ in inspect.getmembers(mavlink_items) if name.startswith("MAV_")]
    dialect_constants = {name: value for name, value in vars(dialect).items() if name.startswith("MAV_")}
    assert len(names) > 10
    assert {name: getattr(mavlink_items, name) for name in names} == {
        name: dialect_constants[name] for name in names
    }


@pytest.mark.parametrize("cls", TYPED_ITEMS, ids=lambda cls: cls.__name__)
def test_each_item_is_a_command_of_the_dialect_and_uses_each_parameter_once(cls: type) -> None:
    command = dialect.enums["MAV_CMD"][cls.COMMAND]
    assert command.name.startswith("MAV_CMD_")
    has_position = "lat_deg" in cls.model_fields
    assert len(cls.SLOTS) == (4 if has_position else 7)
    parameter_names = [slot for slot in cls.SLOTS if isinstance(slot, str)]
    assert len(set(parameter_names)) == len(parameter_names)
    parameter_fields = set(cls.model_fields) - {
        "kind",
        "autocontinue",
        "spare_params",
        "original",
        "lat_deg",
        "lon_deg",
        "altitude",
    }
    assert parameter_fields == set(parameter_names)
    for number, slot in enumerate(cls.SLOTS, start=1):
        if isinstance(slot, str):
            assert not command.param[number].lower().startswith(("empty", "reserved")), (number, slot)


def test_kinds_and_commands_are_unique() -> None:
    assert len({cls.COMMAND for cls in TYPED_ITEMS}) == len(TYPED_ITEMS)
    assert len({cls.model_fields["kind"].default for cls in TYPED_ITEMS}) == len(TYPED_ITEMS)


@settings(deadline=None, max_examples=150)
@given(plan=plans())
def test_any_plan_is_unchanged_after_encoding_and_decoding(plan: Plan) -> None:
    assert mavlink_items.items_from_wire(mavlink_items.mission_items(plan)) == plan.items
    assert mavlink_items.fence_from_wire(mavlink_items.fence_items(plan)) == plan.fence
    assert mavlink_items.rally_from_wire(mavlink_items.rally_items(plan)) == plan.rally_points


def a_waypoint(**changes: object) -> Waypoint:
    fields = {
        "lat_deg": 47.0,
        "lon_deg": 8.0,
        "altitude": Altitude(value_m=20.0, reference="home"),
        **changes,
    }
    return Waypoint(**fields)


def test_the_frame_of_an_item_states_the_reference_of_its_altitude() -> None:
    above_home = a_waypoint()
    above_sea = a_waypoint(altitude=Altitude(value_m=500.0, reference="amsl"))
    above_terrain = a_waypoint(altitude=Altitude(value_m=30.0, reference="terrain"))
    resolved_terrain = a_waypoint(altitude=Altitude(value_m=30.0, reference="terrain", resolved_amsl_m=512.5))
    items = mavlink_items.mission_items(Plan(items=(above_home, above_sea, above_terrain, resolved_terrain)))
    # MAV_FRAME: 6 is above home, 5 above mean sea level, 11 above terrain.
    assert [(item.frame, item.z) for item in items] == [(6, 20.0), (5, 500.0), (11, 30.0), (5, 512.5)]
    assert [item.current for item in items] == [True, False, False, False]


def test_unusual_values_of_unused_parameters_are_kept() -> None:
    received = WireItem(0, 6, 22, 15.0, 1.0, math.nan, math.nan, 470_000_000, 80_000_000, 20.0, current=True)
    (item,) = mavlink_items.items_from_wire([received])
    assert item.spare_params == ((2, 1.0), (3, None))
    (encoded,) = mavlink_items.mission_items(Plan(items=(item,)))
    assert repr(encoded) == repr(received)


def test_invalid_items_from_a_vehicle_are_kept_as_command_items() -> None:
    received = WireItem(0, 6, 16, math.inf, 0, 0, 0, 950_000_000, 0, math.nan)
    (item,) = mavlink_items.items_from_wire([received])
    assert isinstance(item, CommandItem)
    assert item.params == (None, 0, 0, 0, 95.0, 0.0, None)


def test_a_fraction_in_an_integer_field_is_refused_with_its_parameter() -> None:
    plan = Plan(items=(a_waypoint(), Digicam(shoot=0.5)))
    with pytest.raises(PlanError, match=r"item 2, parameter 5: 0\.5 is not a whole number"):
        mavlink_items.mission_items(plan)


def test_an_item_without_a_position_is_never_sent_with_zero_degrees() -> None:
    without_position = CommandItem(command=22, frame=3, params=(0.0, 0.0, 0.0, None, None, None, 20.0))
    with pytest.raises(PlanError, match="item 1, parameter 5: the position is missing"):
        mavlink_items.mission_items(Plan(items=(without_position,)))


@pytest.mark.parametrize("count", [2.0, 5.0, math.nan, 1e30])
def test_a_fence_with_missing_corners_is_refused(count: float) -> None:
    corner_items = [WireItem(n, 6, 5001, count, 0, 0, 0, n, n, 0.0) for n in range(4)]
    with pytest.raises(PlanError, match="fence item 1: its polygon does not have"):
        mavlink_items.fence_from_wire(corner_items)


def test_a_waypoint_in_a_fence_is_refused() -> None:
    with pytest.raises(PlanError, match="fence item 1: command 16 is not a geofence command"):
        mavlink_items.fence_from_wire([WireItem(0, 6, 16, 4.0, 0, 0, 0, 0, 0, 0.0)])


def test_a_rally_point_is_sent_in_a_frame_that_px4s_return_supports() -> None:
    plan = Plan.model_validate_json(
        '{"rally_points": [{"lat_deg": 47, "lon_deg": 8, "altitude": {"value_m": 15, "reference": "home"}}]}'
    )
    (item,) = mavlink_items.rally_items(plan)
    assert (item.frame, item.command, item.z) == (3, 5100, 15.0)
