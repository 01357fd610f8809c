"""Requests that can crash a vehicle: without the exact confirmation nothing is sent."""

import json
import math

import pytest
from pydantic import ValidationError

from gcs_server.api import command_routes, control_models, hold_routes, models, offboard_routes
from gcs_server.api.setpoints import SetpointRequest, StartRequest
from gcs_server.control.principal import Principal
from gcs_server.errors import Disconnected, InvalidRequest, NoReply, NotInControl, Refused, UnknownVehicle
from tests.protocol.api_calls import journal_entries, new_station
from tests.protocol.command_numbers import ARM_DISARM, DO_SET_MODE
from tests.protocol.fake_autopilot import HOLD_MODE, LAND_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.offboard_testbed import OffboardTestbed, sleep

ME, ANNA, BERT, CARLA = (Principal.from_identity(name, name) for name in ("me", "anna", "bert", "carla"))
HOVER = {"type": "position", "position_ned_m": [0, 0, -5]}


def setpoint_request(setpoint, **fields):
    return SetpointRequest.model_validate({"setpoint": setpoint, **fields})


def run_with_equal_system_ids(run_simulated, scenario):
    async def run():
        testbed = OffboardTestbed()
        autopilots = {}
        for number, name in enumerate(("one", "two")):
            autopilots[name] = testbed.offboard_autopilot(
                testbed.link(name), uid=number + 7, booted_at_s=900.0 - 50 * number
            )
            autopilots[name].set_hovering()
        try:
            for vehicle_id in ("1", "1~2"):
                await testbed.wait_for_vehicle(vehicle_id)
            await sleep(1.5)
            first_autopilot, second_autopilot = (
                autopilots[testbed.fleet.get(i).links[0]] for i in ("1", "1~2")
            )
            await scenario(testbed, new_station(testbed), first_autopilot, second_autopilot)
        finally:
            await testbed.close()

    run_simulated(run)


@pytest.mark.parametrize(
    ("vehicle_id", "confirm"),
    [
        ("1~2", "motors stop, vehicle 1 falls"),
        ("1", "motors stop, vehicle 1~2 falls"),
        ("1", "motors stop, vehicle 2 falls"),
        ("1", "Motors stop, vehicle 1 falls"),
        ("1", "motors stop, vehicle 1 falls "),
        ("1", "yes"),
        ("1", ""),
    ],
)
def test_kill_with_a_wrong_confirmation_sends_nothing(run_simulated, vehicle_id, confirm):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        with pytest.raises(InvalidRequest, match="nothing was sent"):
            await command_routes.kill(vehicle_id, models.KillRequest(confirm=confirm), station, ME)
        await sleep(1)
        for autopilot in (first_autopilot, second_autopilot):
            assert autopilot.armed
            assert not autopilot.received_commands(ARM_DISARM)
        assert journal_entries(station) == [("me", "kill", vehicle_id, "invalid_request")]

    run_with_equal_system_ids(run_simulated, scenario)


@pytest.mark.parametrize("vehicle_id", ["1", "1~2"])
def test_kill_is_sent_only_to_the_named_vehicle(run_simulated, vehicle_id):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        confirm = f"motors stop, vehicle {vehicle_id} falls"
        await command_routes.kill(vehicle_id, models.KillRequest(confirm=confirm), station, ME)
        named_autopilot, other_autopilot = (
            (first_autopilot, second_autopilot) if vehicle_id == "1" else (second_autopilot, first_autopilot)
        )
        assert not named_autopilot.armed
        assert other_autopilot.armed
        assert not other_autopilot.received_commands(ARM_DISARM)

    run_with_equal_system_ids(run_simulated, scenario)


def test_kill_is_sent_to_a_vehicle_without_connection(run_simulated):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        first_autopilot.send_raw = lambda raw: None
        await sleep(4)
        with pytest.raises(Disconnected):
            await command_routes.land("1", station, ME)
        with pytest.raises((NoReply, Disconnected)):
            confirm = "motors stop, vehicle 1 falls"
            await command_routes.kill("1", models.KillRequest(confirm=confirm), station, ME)
        assert not first_autopilot.armed
        assert second_autopilot.armed

    run_with_equal_system_ids(run_simulated, scenario)


@pytest.mark.parametrize("action", ["hold", "hold_several", "land_now"])
def test_hold_and_land_now_are_sent_to_a_vehicle_that_is_received_no_more(run_simulated, action):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        first_autopilot.mode = POSITION_MODE
        first_autopilot.send_raw = lambda raw: None
        await sleep(4)
        for other_action in (command_routes.land, command_routes.rtl):
            with pytest.raises(Disconnected, match="not connected"):
                await other_action("1", station, ME)
        assert first_autopilot.mode == POSITION_MODE
        if action == "hold_several":
            answer = await hold_routes.hold_several(
                hold_routes.HoldRequest(vehicles=("1", "1~2")), station, ME
            )
            results = json.loads(answer.body)["results"]
            assert [result["held"] for result in results] == [False, True]
            assert "did not answer" in results[0]["problem"]["detail"]
        else:
            with pytest.raises(NoReply, match="did not answer the request to switch to"):
                if action == "hold":
                    await command_routes.hold("1", station, ANNA)
                else:
                    body = control_models.LandNowRequest(confirm="vehicle 1 lands now")
                    await command_routes.land_now("1", body, station, ANNA)
        assert first_autopilot.mode == (LAND_MODE if action == "land_now" else HOLD_MODE)
        assert action == "hold_several" or second_autopilot.received_commands(DO_SET_MODE) == []

    run_with_equal_system_ids(run_simulated, scenario)


def test_kill_of_an_unknown_vehicle_is_refused_and_journaled(run_simulated):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        with pytest.raises(UnknownVehicle):
            body = models.KillRequest(confirm="motors stop, vehicle 3 falls")
            await command_routes.kill("3", body, station, ME)
        assert journal_entries(station) == [("me", "kill", "3", "unknown_vehicle")]

    run_with_equal_system_ids(run_simulated, scenario)


def test_a_handover_of_control_journals_both_clients(run_simulated):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        body = StartRequest.model_validate({"setpoint": HOVER, "valid_for_s": 60})
        await offboard_routes.start("1", body, station, ANNA)
        for number in range(30):
            target = setpoint_request({"type": "position", "position_ned_m": [number, 0, -5]}, valid_for_s=60)
            client, other_client = (ANNA, BERT) if number < 15 else (BERT, ANNA)
            if number == 15:
                lease = station.authority.control("1").lease
                lease.request(BERT)
                lease.grant(ANNA, "bert")
            response = await offboard_routes.setpoint("1", target, station, client)
            assert json.loads(response.body)["client"] == client.name
            with pytest.raises(NotInControl, match=f"{client} has control"):
                await offboard_routes.setpoint("1", target, station, other_client)
            await sleep(0.1)
        with pytest.raises(NotInControl, match="bert has control"):
            await offboard_routes.stop("1", station, CARLA)
        await offboard_routes.stop("1", station, BERT)
        with pytest.raises(Refused, match="no setpoint stream"):
            await offboard_routes.setpoint("1", setpoint_request(HOVER), station, BERT)
        journal = journal_entries(station)
        assert journal[0] == ("anna", "offboard/start", "1", "ok")
        setpoints = {
            (client, result) for client, command, _, result in journal if command == "offboard/setpoint"
        }
        expected = {(name, result) for name in ("anna", "bert") for result in ("ok", "not_in_control")}
        assert setpoints == expected | {("bert", "refused")}
        assert len(journal) < 20, "the journal has more than one entry per second for frequent setpoints"
        assert journal[-3:] == [
            ("carla", "offboard/stop", "1", "not_in_control"),
            ("bert", "offboard/stop", "1", "ok"),
            ("bert", "offboard/setpoint", "1", "refused"),
        ]
        assert not second_autopilot.setpoints

    run_with_equal_system_ids(run_simulated, scenario)


def test_hold_by_another_client_ends_the_stream(run_simulated):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        body = StartRequest.model_validate({"setpoint": HOVER, "valid_for_s": 60})
        await offboard_routes.start("1", body, station, ANNA)
        assert first_autopilot.mode == OFFBOARD_MODE
        await command_routes.hold("1", station, BERT)
        await sleep(0.15)
        count = len(first_autopilot.setpoints)
        await sleep(3)
        assert len(first_autopilot.setpoints) == count
        assert "bert" in testbed.fleet.get("1").offboard.status().ended

    run_with_equal_system_ids(run_simulated, scenario)


INVALID_FIELDS = [
    {"position_ned_m": [0, 0, math.nan]},
    {"position_ned_m": [0, 0, math.inf]},
    {"position_ned_m": [1e30, 0, 0]},
    {"position_ned_m": [0, 0]},
    {"position_ned_m": [0, 0, 0, 0]},
    {"position_ned_m": [True, None, 0]},
    {"position_ned_m": "000"},
    {"yaw_ned_rad": 1e9},
    {"yaw_ned_rad": math.nan},
    {"yaw_rate_ned_rad_s": 100},
    {"yaw_ned_rad": 0, "yaw_rate_ned_rad_s": 0},
    {"velocity_ned_m_s": [0, 0, 0]},
    {"valid_for_s": 0},
    {"valid_for_s": -1},
    {"valid_for_s": 3601},
    {"valid_for_s": math.inf},
    {"on_expiry": {"action": "hold", "hold_for_s": -1}},
    {"on_expiry": {"action": "hold", "hold_for_s": 1e30}},
    {"on_expiry": {"action": "land", "hold_for_s": 1}},
    {"on_expiry": {"action": "crash"}},
]


@pytest.mark.parametrize("invalid_fields", INVALID_FIELDS)
def test_invalid_setpoints_are_refused_before_the_stream(invalid_fields):
    with pytest.raises(ValidationError):
        SetpointRequest.model_validate({"setpoint": HOVER} | invalid_fields)


@pytest.mark.parametrize("invalid_fields", [{"rate_hz": r} for r in (0, -5, 1.9, 101, 1e30, math.nan)])
def test_invalid_rates_are_refused_before_the_stream(invalid_fields):
    with pytest.raises(ValidationError):
        StartRequest.model_validate({"setpoint": HOVER} | invalid_fields)


@pytest.mark.parametrize(
    "position_ned_m", [[1100.0, 0, -5], [0, -1100.0, -5], [0, 0, -1100.0], [800, 800, -5]]
)
def test_targets_more_than_a_kilometre_away_are_refused_at_the_start_and_in_flight(
    run_simulated, position_ned_m
):
    async def scenario(testbed, station, first_autopilot, second_autopilot):
        far_setpoint = {"type": "position", "position_ned_m": position_ned_m}
        with pytest.raises(Refused, match="at most 1000 m"):
            body = StartRequest.model_validate({"setpoint": far_setpoint})
            await offboard_routes.start("1", body, station, ME)
        assert not first_autopilot.setpoints
        start_request = StartRequest.model_validate({"setpoint": HOVER, "valid_for_s": 60})
        await offboard_routes.start("1", start_request, station, ME)
        with pytest.raises(Refused, match="at most 1000 m"):
            await offboard_routes.setpoint("1", setpoint_request(far_setpoint), station, ME)
        await sleep(0.2)
        assert first_autopilot.setpoints[-1][1].z == -5.0

    run_with_equal_system_ids(run_simulated, scenario)
