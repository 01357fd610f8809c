"""The inferred cause of a mode change: the vehicle itself after a failsafe, and the Return of a plan."""

from types import SimpleNamespace

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.mode_cause import cause_of
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.services.mission import MissionService
from gcs_server.vehicle.services.mission_on_vehicle import ItemsOnVehicle
from missions.formats.mavlink_items import WireItem


def state(mode, *, intended=None, armed=True, status=d.MAV_STATE_ACTIVE):
    return FlightState(
        armed=armed,
        custom_mode=BY_NAME[mode].custom_mode,
        intended_custom_mode=None if intended is None else BY_NAME[intended].custom_mode,
        system_status=status,
    )


def source(
    before, after, *, was_failsafe=False, plan_returns=False, has_transmitter=False, stick_client=None
):
    return cause_of(
        before, after, requested=None, foreign=None, has_transmitter=has_transmitter,
        stick_client=stick_client, was_failsafe=was_failsafe, plan_returns=lambda: plan_returns,
        now_s=10.0, unix_s=1e9,
    ).source  # fmt: skip


def test_the_return_to_the_commanded_mode_after_a_failsafe_is_the_vehicles_own():
    failsafe = state("position", intended="offboard", status=d.MAV_STATE_CRITICAL)
    assert source(failsafe, state("offboard"), was_failsafe=True) == "vehicle"
    assert source(failsafe, state("hold"), was_failsafe=True) == "unknown"
    assert source(failsafe, state("altitude"), was_failsafe=True, has_transmitter=True) == "pilot"


@pytest.mark.parametrize(
    ("before", "after", "plan_returns", "expected"),
    [
        ("mission", "rtl", True, "vehicle"),
        ("mission", "rtl", False, "unknown"),
        ("mission", "land", True, "unknown"),
        ("hold", "rtl", True, "unknown"),
    ],
)
def test_only_the_plans_own_return_is_no_external_control(before, after, plan_returns, expected):
    assert source(state(before), state(after), plan_returns=plan_returns) == expected


@pytest.mark.parametrize(
    ("current", "mission_id", "expected"),
    [(1, 7, True), (2, 7, True), (0, 7, False), (3, 7, False), (2, 8, False)],
)
def test_a_plan_is_at_its_return_only_at_that_item_and_on_this_vehicle(current, mission_id, expected):
    commands = (d.MAV_CMD_NAV_TAKEOFF, d.MAV_CMD_NAV_WAYPOINT, d.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    items = [WireItem(seq, 3, command, 0, 0, 0, 0, 0, 0, 0) for seq, command in enumerate(commands)]
    ids = {"mission": 7, "fence": 0, "rally": 0}
    sample = SimpleNamespace(value=Mission(current, 3, None, mission_id, 0, 0))
    service = MissionService(SimpleNamespace(topic=lambda _name: sample))
    assert not service.is_at_return()
    service.items_on_vehicle = ItemsOnVehicle({"mission": items}, ids, None, 1e9)
    assert service.is_at_return() == expected
