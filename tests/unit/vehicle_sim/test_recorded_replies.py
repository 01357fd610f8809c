"""Replies to commands, requests and mission items with little effect on a multicopter, as recorded from
PX4."""

import pytest

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.plan_station import PlanStation
from tests.unit.vehicle_sim.sim_station import EVENT_NAMES

VTOL_TAKEOFF_MODE = 4 << 16 | 10 << 24
LOCAL_POSITION_NED, PING, BASIC_ID = 32, 4, 12900
UNSUPPORTED_ITEM = 3
_READY: list[PlanStation] = []


@pytest.fixture
def station() -> PlanStation:
    """A station whose vehicle can be armed; it boots once, and each test gets a copy."""
    if not _READY:
        station = PlanStation(sensor_noise=False, parameters={"MNT_MODE_IN": 4})
        station.wait_until_ready_to_arm()
        _READY.append(station)
    return snapshot(_READY[0])


def acks_of(station: PlanStation, command: int, *parameters: float) -> list[int]:
    requested_s = station.now_s
    station.command(command, *parameters)
    station.run(0.1)
    return station.acks(command, requested_s)


@pytest.mark.parametrize(
    ("command", "parameters", "results"),
    [
        (43003, (0, 0, 0, 0, 47.4, 8.5, 490), [1]),
        (204, (2,), [0]),
        (310, (0.1, 1, 0, 0, 1), [0]),
        (310, (0.1, 1, 0, 0, 25), []),
        (512, (PING,), [0]),
        (512, (BASIC_ID,), [0]),
        (512, (LOCAL_POSITION_NED,), [2]),
    ],
)
def test_commands_get_the_recorded_results(
    station: PlanStation, command: int, parameters: tuple[float, ...], results: list[int]
) -> None:
    assert acks_of(station, command, *parameters) == results


def test_requested_messages_are_sent(station: PlanStation) -> None:
    begin_s = station.now_s
    acks_of(station, 512, PING)
    acks_of(station, 512, BASIC_ID)
    assert station.received("PING", since_s=begin_s)[-1].target_system == 0
    (identity,) = station.received("OPEN_DRONE_ID_BASIC_ID", since_s=begin_s)
    assert (identity.id_type, identity.ua_type) == (1, 2)
    assert any(identity.uas_id)


def test_a_multicopter_on_the_ground_accepts_the_vtol_takeoff_mode(station: PlanStation) -> None:
    assert acks_of(station, 84) == [0]
    station.run(1.1)
    assert station.mode == VTOL_TAKEOFF_MODE
    assert not station.armed


@pytest.mark.parametrize("command", [183, 531])
def test_an_unknown_item_is_refused_when_it_is_uploaded(station: PlanStation, command: int) -> None:
    begin_s = station.now_s
    plan = [station.item(22), station.item(16, 10.0), station.command_item(command, 1, 1500)]
    assert station.upload(plan) == UNSUPPORTED_ITEM
    assert "IGN MISSION_ITEM: Invalid item\t" in station.texts(begin_s)


def test_a_mission_with_a_vtol_transition_is_stored_and_reported(station: PlanStation) -> None:
    begin_s = station.now_s
    assert station.upload([station.item(22), station.command_item(3000, 4), station.item(16, 20.0)]) == 0
    station.run(0.2)
    events = [EVENT_NAMES[m.values["id"]] for m in station.received("EVENT", since_s=begin_s)]
    assert "navigator_mis_vtol_items" in events
