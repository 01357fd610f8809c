"""Replies to commands, requests and mission items with little effect on a multicopter, as recorded from
PX4."""

import pytest

from tests.support.snapshot import snapshot
from tests.unit.vehicle_sim.plan_station import PlanStation
from tests.unit.vehicle_sim.sim_station import EVENT_NAMES
from vehicle_sim.px4_version import V1_16

VTOL_TAKEOFF_MODE = 4 << 16 | 10 << 24
LOCAL_POSITION_NED, PING, BASIC_ID = 32, 4, 12900
UNSUPPORTED_ITEM = 3
EXTERNAL_POSITION, MOUNT_CONFIGURE, ACTUATOR_TEST, REQUEST_MESSAGE = 43003, 204, 310, 512
VTOL_TAKEOFF, SET_SERVO, CAMERA_ZOOM, VTOL_TRANSITION, TAKEOFF, WAYPOINT = 84, 183, 531, 3000, 22, 16
_READY_STATIONS: list[PlanStation] = []


@pytest.fixture
def station() -> PlanStation:
    """A station whose vehicle can be armed; it boots once, and each test gets a copy."""
    if not _READY_STATIONS:
        station = PlanStation(sensor_noise=False, parameters={"MNT_MODE_IN": 4}, px4=V1_16)
        station.wait_until_ready_to_arm()
        _READY_STATIONS.append(station)
    return snapshot(_READY_STATIONS[0])


def acks_of(station: PlanStation, command: int, *parameters: float) -> list[int]:
    requested_s = station.now_s
    station.command(command, *parameters)
    station.run(0.1)
    return station.acks(command, requested_s)


@pytest.mark.parametrize(
    ("command", "parameters", "results"),
    [
        (EXTERNAL_POSITION, (0, 0, 0, 0, 47.4, 8.5, 490), [1]),
        (MOUNT_CONFIGURE, (2,), [0]),
        (ACTUATOR_TEST, (0.1, 1, 0, 0, 1), [0]),
        (ACTUATOR_TEST, (0.1, 1, 0, 0, 25), []),
        (REQUEST_MESSAGE, (PING,), [0]),
        (REQUEST_MESSAGE, (BASIC_ID,), [0]),
        (REQUEST_MESSAGE, (LOCAL_POSITION_NED,), [2]),
    ],
)
def test_commands_get_the_recorded_results(
    station: PlanStation, command: int, parameters: tuple[float, ...], results: list[int]
) -> None:
    assert acks_of(station, command, *parameters) == results


def test_requested_messages_are_sent(station: PlanStation) -> None:
    begin_s = station.now_s
    acks_of(station, REQUEST_MESSAGE, PING)
    acks_of(station, REQUEST_MESSAGE, BASIC_ID)
    assert station.received("PING", since_s=begin_s)[-1].target_system == 0
    (identity,) = station.received("OPEN_DRONE_ID_BASIC_ID", since_s=begin_s)
    assert (identity.id_type, identity.ua_type) == (1, 2)
    assert any(identity.uas_id)


def test_a_multicopter_on_the_ground_accepts_the_vtol_takeoff_mode(station: PlanStation) -> None:
    assert acks_of(station, VTOL_TAKEOFF) == [0]
    station.run(1.1)
    assert station.mode == VTOL_TAKEOFF_MODE
    assert not station.armed


@pytest.mark.parametrize("command", [SET_SERVO, CAMERA_ZOOM])
def test_an_unknown_item_is_refused_when_it_is_uploaded(station: PlanStation, command: int) -> None:
    begin_s = station.now_s
    plan = [station.item(TAKEOFF), station.item(WAYPOINT, 10.0), station.command_item(command, 1, 1500)]
    assert station.upload(plan) == UNSUPPORTED_ITEM
    assert "IGN MISSION_ITEM: Invalid item\t" in station.status_texts(begin_s)


def test_a_mission_with_a_vtol_transition_is_stored_and_reported(station: PlanStation) -> None:
    begin_s = station.now_s
    plan = [station.item(TAKEOFF), station.command_item(VTOL_TRANSITION, 4), station.item(WAYPOINT, 20.0)]
    assert station.upload(plan) == 0
    station.run(0.2)
    events = [EVENT_NAMES[m.values["id"]] for m in station.received("EVENT", since_s=begin_s)]
    assert "navigator_mis_vtol_items" in events
