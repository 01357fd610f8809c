"""Which client may command a vehicle: refusals send nothing; Hold, Land now and Stop motors work for all."""

import contextlib
from types import SimpleNamespace

import pytest
from starlette.requests import HTTPConnection, Request

from gcs_server.api import command_routes, control_models, control_routes, models, offboard_routes
from gcs_server.api.authorized import enter
from gcs_server.api.principals import SCOPE_KEY
from gcs_server.api.setpoints import SetpointRequest
from gcs_server.control.commands import BY_NAME
from gcs_server.control.principal import Principal
from gcs_server.errors import InvalidRequest, NotInControl, Refused, UnknownVehicle
from tests.protocol.api_calls import (
    ANNA,
    BOB,
    FORCED_CONTROL_REQUEST,
    MISSION_MODE,
    START_REQUEST,
    journal_entries,
    json_of,
    new_station,
    run_with_routes,
)
from tests.protocol.command_numbers import ARM_DISARM, DO_SET_MODE, GIMBAL_CONFIGURE
from tests.protocol.fake_autopilot import HOLD_MODE, LAND_MODE, OFFBOARD_MODE, POSITION_MODE, RTL_MODE
from tests.protocol.offboard_testbed import (
    OffboardTestbed,
    assert_nothing_sent,
    mode_requests,
    sleep,
)
from vehicle_sim.mavlink import generated_dialect as sim

SETPOINT = SetpointRequest.model_validate(
    {"setpoint": {"type": "position", "position_ned_m": [0, 0, -6]}, "valid_for_s": 60}
)


def scope_of(station, kind):
    """The scope of a connection of ANNA, for a route that takes control."""
    state = SimpleNamespace(station=station, commands={None: BY_NAME["control/take"]})
    return {"type": kind, "app": SimpleNamespace(state=state), "endpoint": None, SCOPE_KEY: ANNA}


def control_changes(vehicle):
    return [(e.data["action"], e.text) for e in vehicle.events.since() if e.kind == "control"]


def test_a_command_without_control_is_refused_sends_nothing_and_names_the_client_in_control(run_simulated):
    async def scenario(rig):
        await command_routes.mode("1", models.ModeRequest(mode="position"), rig.station, ANNA)
        count = len(rig.autopilot.received_commands(DO_SET_MODE))
        for send_command in (
            lambda: command_routes.rtl("1", rig.station, BOB),
            lambda: command_routes.disarm("1", rig.station, BOB),
            lambda: command_routes.land("1", rig.station, BOB),
            lambda: offboard_routes.start("1", START_REQUEST, rig.station, BOB),
            lambda: offboard_routes.stop("1", rig.station, BOB),
        ):
            with pytest.raises(
                NotInControl, match="anna has control of vehicle 1, not you: nothing was sent"
            ):
                await send_command()
        await sleep(2)
        assert len(rig.autopilot.received_commands(DO_SET_MODE)) == count
        assert not rig.autopilot.received_commands(ARM_DISARM)
        assert journal_entries(rig.station)[-1] == ("bob", "offboard/stop", "1", "not_in_control")

    run_with_routes(run_simulated, scenario)


@pytest.mark.parametrize("command", ["hold", "land_now", "kill"])
def test_hold_land_now_and_kill_need_no_control_and_the_client_in_control_is_informed(run_simulated, command):
    async def scenario(rig):
        await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        if command == "hold":
            await command_routes.hold("1", rig.station, BOB)
        elif command == "land_now":
            body = control_models.LandNowRequest(confirm="vehicle 1 lands now")
            await command_routes.land_now("1", body, rig.station, BOB)
        else:
            body = models.KillRequest(confirm="motors stop, vehicle 1 falls")
            await command_routes.kill("1", body, rig.station, BOB)
        await assert_nothing_sent(rig.autopilot, None, settle_s=0.2)
        assert (
            rig.autopilot.mode == {"hold": HOLD_MODE, "land_now": LAND_MODE, "kill": OFFBOARD_MODE}[command]
        )
        assert rig.autopilot.armed == (command != "kill")
        name = {"hold": "Hold", "land_now": "Land now", "kill": "Stop motors"}[command]
        assert control_changes(rig.vehicle)[-1] == (
            "intervened",
            f"bob commanded {name} of vehicle 1; anna still has control.",
        )
        assert journal_entries(rig.station)[-1] == ("bob", command, "1", "ok")
        assert json_of(await control_routes.show("1", rig.station, ANNA))["yours"]

    run_with_routes(run_simulated, scenario)


def test_land_now_without_confirmation_sends_nothing(run_simulated):
    async def scenario(rig):
        for confirm in ("yes", "vehicle 2 lands now", ""):
            with pytest.raises(InvalidRequest, match="is not the required text"):
                await command_routes.land_now(
                    "1", control_models.LandNowRequest(confirm=confirm), rig.station, BOB
                )
        assert not mode_requests(rig.autopilot, LAND_MODE)
        assert control_changes(rig.vehicle) == []

    run_with_routes(run_simulated, scenario)


def test_control_is_granted_while_the_vehicle_keeps_flying(run_simulated):
    async def scenario(rig):
        with rig.station.authority.connected(ANNA), rig.station.authority.connected(BOB):
            await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
            reason = control_models.RequestControl(reason="I see it")
            request_response = json_of(await control_routes.request("1", rig.station, BOB, reason))
            assert (request_response["holder"], request_response["yours"]) == ("anna", False)
            assert [(r["client"], r["reason"]) for r in request_response["requests"]] == [("bob", "I see it")]
            receiver = control_models.AnswerControl(client=BOB.key)
            grant_response = json_of(await control_routes.grant("1", receiver, rig.station, ANNA))
            assert (grant_response["holder"], grant_response["holder_key"], grant_response["yours"]) == (
                "bob",
                BOB.key,
                False,
            )
            await sleep(0.5)
            assert rig.autopilot.mode == OFFBOARD_MODE
            assert rig.vehicle.offboard.status().client == "anna"
            with pytest.raises(NotInControl):
                await offboard_routes.stop("1", rig.station, ANNA)
            await offboard_routes.stop("1", rig.station, BOB)
            await assert_nothing_sent(rig.autopilot, None, settle_s=0.1)
            assert rig.autopilot.mode == HOLD_MODE
        assert [action for action, _ in control_changes(rig.vehicle)] == ["taken", "requested", "granted"]

    run_with_routes(run_simulated, scenario)


def test_control_taken_by_force_is_journaled_and_reported_to_the_previous_client(run_simulated):
    async def scenario(rig):
        with rig.station.authority.connected(ANNA):
            await control_routes.take("1", rig.station, ANNA)
            with pytest.raises(Refused, match="has not been asked"):
                await control_routes.take("1", rig.station, BOB, FORCED_CONTROL_REQUEST)
            await control_routes.request("1", rig.station, BOB)
            await sleep(15.1)  # longer than `control_answer_s`
            assert json_of(await control_routes.take("1", rig.station, BOB, FORCED_CONTROL_REQUEST))["yours"]
        action, text = control_changes(rig.vehicle)[-1]
        assert (action, text) == ("forced", "bob has taken control of vehicle 1 from anna by force.")
        [event] = [e for e in rig.vehicle.events.since() if e.data.get("action") == "forced"]
        assert (event.severity, event.data["previous_key"]) == (4, ANNA.key)
        assert journal_entries(rig.station)[-1] == ("bob", "control/take", "1", "ok")

    run_with_routes(run_simulated, scenario)


def test_any_request_renews_control_and_leaving_releases_control(run_simulated):
    async def scenario(rig):
        await control_routes.take("1", rig.station, ANNA)
        for _ in range(5):
            await sleep(20)
            rig.station.authority.renew(ANNA)
        assert json_of(await control_routes.me(rig.station, ANNA))["controls"] == ["1"]
        assert json_of(await control_routes.leave(rig.station, ANNA))["controls"] == []
        assert control_changes(rig.vehicle)[-1][0] == "released"
        assert journal_entries(rig.station)[-1] == ("anna", "control/release", "1", "ok")

    run_with_routes(run_simulated, scenario)


def test_a_long_request_keeps_its_clients_control_until_it_is_answered(run_simulated):
    async def scenario(rig):
        await control_routes.take("1", rig.station, ANNA)
        request = enter(Request(scope_of(rig.station, "http")))
        await anext(request)
        await sleep(100)
        assert rig.station.authority.controlled_by(ANNA) == ["1"]
        await request.aclose()
        await sleep(29)
        assert rig.station.authority.controlled_by(ANNA) == ["1"]
        await sleep(2)
        assert rig.station.authority.controlled_by(ANNA) == []
        socket = enter(HTTPConnection(scope_of(rig.station, "websocket")))
        await control_routes.take("1", rig.station, ANNA)
        await anext(socket)
        await sleep(31)
        assert rig.station.authority.controlled_by(ANNA) == []
        await socket.aclose()

    run_with_routes(run_simulated, scenario)


def test_control_of_an_unknown_vehicle_cannot_be_taken(run_simulated):
    async def scenario(rig):
        with pytest.raises(UnknownVehicle):
            await control_routes.take("77", rig.station, ANNA)

    run_with_routes(run_simulated, scenario)


# --- control expires ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("on_expiry", "mode", "mode_after"),
    [
        ("nothing", MISSION_MODE, MISSION_MODE),
        ("hold", MISSION_MODE, HOLD_MODE),
        ("land", MISSION_MODE, LAND_MODE),
        ("rtl", HOLD_MODE, RTL_MODE),
        ("hold", POSITION_MODE, POSITION_MODE),
        ("rtl", POSITION_MODE, POSITION_MODE),
        ("hold", OFFBOARD_MODE, OFFBOARD_MODE),
    ],
)
def test_the_action_on_expiry_is_executed_except_in_a_pilots_mode_or_offboard(
    run_simulated, on_expiry, mode, mode_after
):
    async def scenario(rig):
        rig.autopilot.has_stream = lambda: True  # another program's setpoints keep the vehicle in Offboard
        rig.autopilot.mode = mode
        await sleep(2.5)
        body = control_models.TakeControl(on_expiry=on_expiry)
        await control_routes.take("1", rig.station, ANNA, body)
        await sleep(29)  # control expires after 30 s
        assert not rig.autopilot.received_commands(DO_SET_MODE)
        await sleep(5)
        assert rig.autopilot.mode == mode_after
        assert control_changes(rig.vehicle)[-1][0] == "expired"
        server_lines = [line for line in journal_entries(rig.station) if line[0] == "server"]
        assert server_lines[0] == ("server", "control/expired", "1", "ok")
        assert server_lines[1:] == ([] if mode_after == mode else [("server", on_expiry, "1", "ok")])

    run_with_routes(run_simulated, scenario)


def test_expired_control_commands_nothing_on_the_ground(run_simulated):
    async def scenario(rig):
        rig.autopilot.mode = MISSION_MODE
        await sleep(2.5)
        await control_routes.take("1", rig.station, ANNA, control_models.TakeControl(on_expiry="rtl"))
        await sleep(40)
        assert not rig.autopilot.received_commands(DO_SET_MODE)

    run_with_routes(run_simulated, scenario, flying=False)


# --- external control -----------------------------------------------------------------------------


def mode_changes(vehicle):
    return [(e.text, e.severity, e.data["cause"]) for e in vehicle.events.since() if e.kind == "mode_changed"]


def report_transmitter(autopilot):
    """Reports in SYS_STATUS that an RC transmitter is connected."""
    rc_receiver = sim.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    autopilot.send(
        sim.MAVLink_sys_status_message(
            rc_receiver, rc_receiver, rc_receiver, 0, 12000, 0, 50, 0, 0, 0, 0, 0, 0
        )
    )


def test_a_pilots_switch_to_position_is_reported_and_never_reversed(run_simulated):
    async def scenario(rig):
        report_transmitter(rig.autopilot)
        await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        assert mode_changes(rig.vehicle)[-1] == ("Mode Offboard", 5, "command")
        rig.autopilot.mode = rig.autopilot.requested_mode = POSITION_MODE
        rig.autopilot.send_current_mode()
        await assert_nothing_sent(rig.autopilot, None, duration_s=40.0, settle_s=0.1)
        assert rig.autopilot.mode == POSITION_MODE
        assert mode_changes(rig.vehicle)[-1] == ("Mode Position: the RC pilot", 4, "pilot")
        cause = json_of(await control_routes.show("1", rig.station, BOB))["mode_cause"]
        assert (cause["source"], cause["text"]) == ("pilot", "the RC pilot")

    run_with_routes(run_simulated, scenario)


def test_another_stations_command_is_detected_by_its_acknowledgement(run_simulated):
    async def scenario(rig):
        await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        rig.autopilot.send(sim.MAVLink_command_ack_message(DO_SET_MODE, 0, 0, 0, 245, 190))
        rig.autopilot.mode = rig.autopilot.requested_mode = RTL_MODE
        rig.autopilot.send_current_mode()
        await assert_nothing_sent(rig.autopilot, None, settle_s=0.1)
        assert mode_changes(rig.vehicle)[-1] == (
            "Mode Return: another ground station (station 245/190)",
            4,
            "station",
        )
        assert rig.autopilot.mode == RTL_MODE

    run_with_routes(run_simulated, scenario)


def test_the_servers_commands_and_the_vehicles_mode_changes_are_not_external_control(run_simulated):
    async def scenario(rig):
        await command_routes.rtl("1", rig.station, ANNA)
        await sleep(1)
        assert mode_changes(rig.vehicle)[-1] == ("Mode Return", 5, "command")
        await sleep(15)
        rig.autopilot.mode = HOLD_MODE
        rig.autopilot.send_current_mode()
        await sleep(0.1)
        assert mode_changes(rig.vehicle)[-1] == ("Mode Hold", 5, "vehicle")

    run_with_routes(run_simulated, scenario)


def test_a_failsafe_is_reported_as_failsafe(run_simulated):
    async def scenario(rig):
        await sleep(10)
        rig.autopilot.mode = RTL_MODE
        rig.autopilot.send(sim.MAVLink_current_mode_message(0, RTL_MODE, HOLD_MODE))
        await sleep(0.1)
        assert mode_changes(rig.vehicle)[-1] == ("Mode Return: the failsafe", 4, "failsafe")

    run_with_routes(run_simulated, scenario)


def test_after_a_failsafe_landing_the_commanded_mode_is_not_reported_as_commanded_again(run_simulated):
    async def scenario(rig):
        await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        rig.autopilot.mode = LAND_MODE
        rig.autopilot.send(sim.MAVLink_current_mode_message(0, LAND_MODE, OFFBOARD_MODE))
        await sleep(2)
        assert mode_changes(rig.vehicle)[-1][2] == "failsafe"
        rig.autopilot.land_and_disarm()
        await sleep(0.2)
        assert mode_changes(rig.vehicle)[-1] == ("Mode Offboard", 5, "vehicle")

    run_with_routes(run_simulated, scenario)


def test_a_mode_change_first_seen_in_a_heartbeat_is_reclassified_as_failsafe(run_simulated):
    async def scenario(rig):
        await sleep(10)
        rig.autopilot.mode = RTL_MODE
        rig.autopilot.send_heartbeat()
        await sleep(0.1)
        assert mode_changes(rig.vehicle)[-1][2] == "unknown"
        rig.autopilot.send(sim.MAVLink_current_mode_message(0, RTL_MODE, HOLD_MODE))
        await sleep(0.1)
        assert rig.vehicle.mode_cause.source == "failsafe"

    run_with_routes(run_simulated, scenario)


def test_a_gimbal_taken_by_another_station_is_reported_and_not_taken_back(run_simulated):
    async def scenario(rig):
        await rig.vehicle.gimbal.take_control()
        await sleep(2.5)
        count = len(rig.autopilot.received_commands(GIMBAL_CONFIGURE))
        rig.autopilot.gimbal_control = (245, 190)
        await sleep(5)
        assert control_changes(rig.vehicle)[-1] == (
            "gimbal_taken",
            "Station 245/190 has taken the gimbal from this server.",
        )
        assert len(rig.autopilot.received_commands(GIMBAL_CONFIGURE)) == count
        with pytest.raises(Refused, match="controlled by system 245"):
            await rig.vehicle.gimbal.set_angles(-10, 0)

    run_with_routes(run_simulated, scenario)


def test_a_recording_has_no_control_lease(run_simulated):
    async def run():
        testbed = OffboardTestbed()
        link = testbed.link("replay", replay=True)
        testbed.offboard_autopilot(link)
        try:
            await sleep(8)
            [vehicle] = testbed.fleet.all()
            station = new_station(testbed)
            with pytest.raises(Refused, match="recording"):
                await control_routes.take(vehicle.id, station, ANNA)
            with contextlib.suppress(Refused):
                await command_routes.arm(vehicle.id, station, ANNA)
            assert vehicle.control.status().holder is None
        finally:
            await testbed.close()

    run_simulated(run)


def test_a_stream_depends_on_the_validity_of_its_setpoints_not_on_its_clients_control(run_simulated):
    async def scenario(rig):
        await offboard_routes.start("1", START_REQUEST, rig.station, ANNA)
        await sleep(31)
        assert control_changes(rig.vehicle)[-1][0] == "expired"
        assert rig.autopilot.mode == OFFBOARD_MODE
        await sleep(40)
        assert rig.autopilot.mode == HOLD_MODE

    run_with_routes(run_simulated, scenario)


def test_a_stream_reports_its_clients_key(run_simulated):
    first_tab, second_tab = (
        Principal.from_identity("anna", "one tab"),
        Principal.from_identity("anna", "another tab"),
    )

    async def scenario(rig):
        await offboard_routes.start("1", START_REQUEST, rig.station, first_tab)
        status = rig.vehicle.offboard.status()  # the stream process reports only the name
        assert (status.client, status.client_key) == ("anna", first_tab.key)
        await control_routes.release("1", rig.station, first_tab)
        await offboard_routes.setpoint("1", SETPOINT, rig.station, second_tab)
        await sleep(0.5)
        assert rig.vehicle.offboard.status().client_key == second_tab.key != first_tab.key

    run_with_routes(run_simulated, scenario)
