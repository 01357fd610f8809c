"""Faults in flight: the vehicle's events from the first command until minutes after the fault, and the
vehicle's final mode."""

import pytest

from gcs_server.api import command_routes, control_models, control_routes, models, offboard_routes
from gcs_server.api.setpoints import SetpointRequest, StartRequest
from gcs_server.errors import NotInControl, Refused
from tests.protocol.api_calls import ANNA, BOB, FORCED_CONTROL_REQUEST, MISSION_MODE, run_with_routes
from tests.protocol.fake_autopilot import HOLD_MODE, LAND_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.offboard_testbed import assert_nothing_sent, mode_requests, sleep
from vehicle_sim.mavlink import generated_dialect as sim

HOVER = {"type": "position", "position_ned_m": [0, 0, -5]}
START_VALID_1_S = StartRequest.model_validate(
    {"setpoint": HOVER, "valid_for_s": 1.0, "on_expiry": {"action": "hold", "hold_for_s": 2.0}}
)
START_VALID_1_H = StartRequest.model_validate({"setpoint": HOVER, "valid_for_s": 3600.0})
NEXT_SETPOINT = SetpointRequest.model_validate({"setpoint": HOVER, "valid_for_s": 1.0})
LOSSES = [(0.0, 0), (0.05, 1), (0.2, 2)]
"""The share of packets lost in each direction, and the seed of the losses."""


def event_summary(vehicle):
    """The vehicle's events in short form: control, mode and its cause, stream, link."""
    events = []
    for event in vehicle.events.since():
        data = event.data
        if event.kind == "control":
            events.append(f"control {data['action']}")
        elif event.kind == "mode_changed":
            events.append(f"mode {data['mode']} by {data['cause']}")
        elif data.get("source") == "offboard":
            events.append(f"stream {data['code']}")
        elif event.kind == "link":
            events.append(event.text)
    return events


async def send_setpoints(rig, client, duration_s, every_s=0.3):
    for _ in range(round(duration_s / every_s)):
        await offboard_routes.setpoint("1", NEXT_SETPOINT, rig.station, client)
        await sleep(every_s)


@pytest.mark.parametrize(("loss", "seed"), LOSSES)
def test_a_killed_client_leaves_the_vehicle_in_hold_and_releases_control(run_simulated, loss, seed):
    async def scenario(rig):
        await offboard_routes.start("1", START_VALID_1_S, rig.station, ANNA)
        await send_setpoints(rig, ANNA, 3.0)
        # 1 s of validity, 2 s of position hold, and up to 6 s of repeated requests for Hold.
        await sleep(1.0 + 2.0 + 6.0)
        assert rig.autopilot.mode == HOLD_MODE
        await assert_nothing_sent(rig.autopilot, None, duration_s=30.0)
        assert event_summary(rig.vehicle) == [
            "control taken",
            "mode offboard by command",
            "stream expired",
            "mode hold by command",
            "stream held",
            "control expired",
        ]
        assert rig.autopilot.failsafe_count == 0
        await command_routes.rtl("1", rig.station, BOB)  # control is free again

    run_with_routes(run_simulated, scenario, loss=loss, seed=seed)


@pytest.mark.story
def test_a_suspended_browser_tab_keeps_control_but_not_the_stream(run_simulated):
    async def scenario(rig):
        # The browser keeps its socket open; the page does not run.
        with rig.station.authority.connected(ANNA):
            await offboard_routes.start("1", START_VALID_1_S, rig.station, ANNA)
            await send_setpoints(rig, ANNA, 3.0)
            await sleep(8.0)
            assert rig.autopilot.mode == HOLD_MODE
            await assert_nothing_sent(rig.autopilot, None, duration_s=300.0)
            with pytest.raises(Refused, match="no setpoint stream"):
                await offboard_routes.setpoint("1", NEXT_SETPOINT, rig.station, ANNA)
            with pytest.raises(NotInControl):
                await offboard_routes.start("1", START_VALID_1_S, rig.station, BOB)
        assert event_summary(rig.vehicle) == [
            "control taken",
            "mode offboard by command",
            "stream expired",
            "mode hold by command",
            "stream held",
        ]

    run_with_routes(run_simulated, scenario)


@pytest.mark.parametrize("on_expiry", [pytest.param("nothing", marks=pytest.mark.broad), "hold"])
def test_when_control_expires_the_server_executes_the_action_that_the_client_chose(run_simulated, on_expiry):
    async def scenario(rig):
        with rig.station.authority.connected(ANNA):
            await control_routes.take("1", rig.station, ANNA, control_models.TakeControl(on_expiry=on_expiry))
            await command_routes.mode(
                "1", models.ModeRequest(mode="mission", despite=["plan_not_known"]), rig.station, ANNA
            )
            await sleep(100)
        await sleep(29)  # the socket is closed; 1 s before the 30 s control lease expires
        assert rig.autopilot.mode == MISSION_MODE
        await sleep(4)
        await assert_nothing_sent(rig.autopilot, None, duration_s=60.0)
        expected = ["control taken", "mode mission by command", "control expired"]
        if on_expiry == "hold":
            expected.append("mode hold by command")
        assert event_summary(rig.vehicle) == expected
        assert rig.autopilot.mode == (HOLD_MODE if on_expiry == "hold" else MISSION_MODE)

    run_with_routes(run_simulated, scenario)


def test_a_lost_link_ends_in_the_vehicles_failsafe_and_nothing_is_sent_after_the_link_is_restored(
    run_simulated,
):
    async def scenario(rig):
        await offboard_routes.start("1", START_VALID_1_H, rig.station, ANNA)
        rig.autopilot.loss = 1.0
        await sleep(15)
        assert not rig.vehicle.offboard.status().streaming
        assert rig.autopilot.mode == POSITION_MODE, "PX4's failsafe did not act"
        rig.autopilot.loss = 0.0
        await assert_nothing_sent(rig.autopilot, None, duration_s=30.0, settle_s=0.5)
        assert event_summary(rig.vehicle) == [
            "control taken",
            "mode offboard by command",
            "Connection lost",
            "stream lost",
            "stream not_confirmed",
            "mode position by unknown",
            "Connection restored",
            "control expired",
        ]

    run_with_routes(run_simulated, scenario)


def test_a_second_client_takes_control_and_the_first_client_can_no_longer_move_the_vehicle(run_simulated):
    async def scenario(rig):
        with rig.station.authority.connected(ANNA), rig.station.authority.connected(BOB):
            await offboard_routes.start("1", START_VALID_1_H, rig.station, ANNA)
            await control_routes.request("1", rig.station, BOB)
            await sleep(15.5)
            await control_routes.take("1", rig.station, BOB, FORCED_CONTROL_REQUEST)
            assert rig.autopilot.mode == OFFBOARD_MODE, "the flight mode changed"
            sent_down_m = rig.autopilot.setpoints[-1][1].z
            setpoint = {"type": "position", "position_ned_m": [9, 0, -9]}
            new_request = SetpointRequest.model_validate({"setpoint": setpoint})
            for call in (
                lambda: offboard_routes.setpoint("1", new_request, rig.station, ANNA),
                lambda: offboard_routes.stop("1", rig.station, ANNA),
            ):
                with pytest.raises(NotInControl, match="bob has control"):
                    await call()
            await sleep(1)
            assert rig.autopilot.setpoints[-1][1].z == sent_down_m
            await offboard_routes.setpoint("1", new_request, rig.station, BOB)
            await sleep(0.1)
            assert rig.autopilot.setpoints[-1][1].z == -9
            await offboard_routes.stop("1", rig.station, BOB)
            await assert_nothing_sent(rig.autopilot, None)
            assert rig.autopilot.mode == HOLD_MODE
        assert event_summary(rig.vehicle) == [
            "control taken",
            "mode offboard by command",
            "control requested",
            "control forced",
            "mode hold by command",
        ]

    run_with_routes(run_simulated, scenario)


@pytest.mark.parametrize(("loss", "seed"), LOSSES)
def test_after_a_pilot_switches_to_position_mode_the_server_sends_nothing(run_simulated, loss, seed):
    async def scenario(rig):
        await offboard_routes.start("1", START_VALID_1_H, rig.station, ANNA)
        requests_before = len(mode_requests(rig.autopilot, HOLD_MODE)) + len(
            mode_requests(rig.autopilot, OFFBOARD_MODE)
        )
        rig.autopilot.mode = rig.autopilot.requested_mode = POSITION_MODE
        rig.autopilot.send_current_mode()
        await assert_nothing_sent(rig.autopilot, None, duration_s=60.0, settle_s=2.5)
        assert (
            len(mode_requests(rig.autopilot, HOLD_MODE)) + len(mode_requests(rig.autopilot, OFFBOARD_MODE))
            == requests_before
        )
        assert rig.autopilot.mode == POSITION_MODE
        events = event_summary(rig.vehicle)
        assert sorted(events[2:4]) == ["mode position by unknown", "stream left_offboard"]
        assert (events[:2], events[4:]) == (
            ["control taken", "mode offboard by command"],
            ["control expired"],
        )

    run_with_routes(run_simulated, scenario, loss=loss, seed=seed)


def test_after_the_vehicles_failsafe_for_a_lost_estimate_the_server_sends_nothing(run_simulated):
    async def scenario(rig):
        await offboard_routes.start("1", START_VALID_1_H, rig.station, ANNA)
        rig.autopilot.has_estimates = False
        await sleep(2.0)
        rig.autopilot.mode = LAND_MODE
        rig.autopilot.send(sim.MAVLink_current_mode_message(0, LAND_MODE, OFFBOARD_MODE))
        await assert_nothing_sent(rig.autopilot, None, duration_s=20.0, settle_s=0.1)
        assert rig.autopilot.mode == LAND_MODE
        with pytest.raises(Refused):
            await offboard_routes.start("1", START_VALID_1_S, rig.station, ANNA)
        events = event_summary(rig.vehicle)
        assert sorted(events[2:]) == ["mode land by failsafe", "stream left_offboard"]

    run_with_routes(run_simulated, scenario)
